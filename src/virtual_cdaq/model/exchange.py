"""What happens at an edge: inputs are read, the plant goes on, outputs change."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from virtual_cdaq.model.channels import Channel, repeated
from virtual_cdaq.model.clock import TICKS_PER_SECOND
from virtual_cdaq.model.converters import Floats, decode
from virtual_cdaq.model.engines import Engine, Ticks
from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.model.task import Task

if TYPE_CHECKING:
    from virtual_cdaq.model.chassis import Chassis


def exchange(chassis: Chassis, points: Ticks, edges: dict[Engine, Ticks]) -> None:
    """Let outputs follow their edges and inputs read at theirs."""
    outputs = {physical: np.full(points.size, level) for physical, level in chassis.levels.items()}
    updates: list[tuple[str, float]] = []
    for task in chassis.tasks:
        if task.kind == "ao" and task.clock in edges and not task.armed and not task.done and task.hardware_timed:
            updates += _generate(chassis, task, points, edges[task.clock], outputs)
    terminals = chassis.plant.advance(points / TICKS_PER_SECOND, outputs)
    for task in chassis.tasks:
        if task.kind == "ai" and task.clock in edges and not task.armed and not task.done and task.hardware_timed:
            _acquire(chassis, task, points, edges[task.clock], terminals)
    for physical, level in updates:
        chassis.set_level(physical, level)


def _generate(
    chassis: Chassis, task: Task, points: Ticks, edges: Ticks, outputs: dict[str, Floats]
) -> list[tuple[str, float]]:
    buffer = task.output_buffer
    assert buffer is not None
    finite = task.finite
    wanted = edges.size
    if finite:
        wanted = min(wanted, task.timing.samples - buffer.generated)
    codes = buffer.take(wanted, again=task.regenerate)
    taken = codes.shape[1]
    updates = []
    # On an edge the new level comes after the reading: it acts on the points after it.
    before = np.searchsorted(edges[:taken], points, side="left")
    for channel, row in zip(task.channels, codes, strict=True):
        volts = decode(channel.module, channel.chosen, row)
        level = chassis.levels[channel.physical]
        if taken and not chassis.faults.stuck:
            outputs[channel.physical] = np.concatenate(([level], volts))[before]
            updates.append((channel.physical, float(volts[-1])))
    task.edges += edges.size
    if taken < wanted:
        task.edges -= edges.size - taken
        task.fail(ChassisError(-200290, f"Samples generated: {buffer.generated}\nTask: {task.name}"))
    elif finite and task.clock is not task.engine and task.edges > task.timing.samples:
        task.ended = True
    return updates


def _acquire(chassis: Chassis, task: Task, points: Ticks, edges: Ticks, terminals: object) -> None:
    buffer = task.input_buffer
    assert buffer is not None
    assert task.clock is not None
    if task.finite:
        edges = edges[: task.timing.samples - buffer.acquired]
    if not edges.size:
        return
    at = slice(None) if edges.size == points.size else np.searchsorted(points, edges)
    codes = np.empty((len(task.channels), edges.size), dtype=np.int32)
    conversion = owner = starts = None
    if any(channel.module.slow for channel in task.channels):
        conversion = (edges - task.clock.start) // task.slow_period
        owner, starts = repeated(conversion, task.conversion)
    for row, (channel, converter) in enumerate(zip(task.channels, task.converters, strict=True)):
        values = chassis.faults.distort(channel, _terminal(terminals, channel), points)[at]
        if channel.module.slow and conversion is not None and owner is not None and starts is not None:
            # A slow module converts when it can, and repeats itself in between.
            fresh = converter.convert_at(values[starts], conversion[starts])
            held = np.concatenate((task.held[row], fresh))
            codes[row] = held[owner]
            task.held[row, 0] = held[-1]
        else:
            codes[row] = converter.convert(values, buffer.acquired)
    if conversion is not None:
        task.conversion = int(conversion[-1])
    buffer.put(codes)
    task.edges += edges.size
    if task.finite and buffer.acquired >= task.timing.samples:
        task.ended = True


def _terminal(terminals: object, channel: Channel) -> Floats:
    values = terminals.get(channel.physical)  # type: ignore[attr-defined]
    if values is None:
        return np.array(np.inf if channel.module.resistive else 0.0)
    return np.asarray(values, dtype=np.float64)


def point(chassis: Chassis) -> tuple[Ticks, object]:
    """Let the plant come to the present, with the outputs as they are, and look at its terminals."""
    tick = max(chassis.clock.now(), chassis.tick) + 1
    chassis.run_to(tick)
    points = np.array([tick + 1], dtype=np.int64)
    chassis.tick = tick + 1
    outputs = {physical: np.array([level]) for physical, level in chassis.levels.items()}
    return points, chassis.plant.advance(points / TICKS_PER_SECOND, outputs)


def read_now(chassis: Chassis, task: Task, count: int) -> np.ndarray:
    """Codes of `count` samples taken one after the other, shape (channels, count)."""
    codes = np.empty((len(task.channels), count), dtype=np.int32)
    for k in range(count):
        points, terminals = point(chassis)
        for row, (channel, converter) in enumerate(zip(task.channels, task.converters, strict=True)):
            value = chassis.faults.distort(channel, _terminal(terminals, channel), points)[0]
            codes[row, k] = converter.convert_one(float(value), task.edges)
        task.edges += 1
    return codes


def write_now(chassis: Chassis, task: Task, volts: Sequence[float]) -> None:
    """Set the outputs of a task."""
    point(chassis)
    for channel, level in zip(task.channels, volts, strict=True):
        chassis.set_level(channel.physical, level)
    chassis.show()
