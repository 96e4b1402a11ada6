"""What happens at an edge: inputs are read, the plant continues, outputs change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from virtual_cdaq.model.channels import Channel, repeated
from virtual_cdaq.model.clock import TICKS_PER_SECOND
from virtual_cdaq.model.converters import Floats, decode
from virtual_cdaq.model.engines import Engine, Ticks
from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.model.faults import Faults
from virtual_cdaq.model.plant import Plant
from virtual_cdaq.model.task import Task


def exchange(
    tasks: Sequence[Task],
    plant: Plant,
    levels: Mapping[str, float],
    faults: Faults,
    points: Ticks,
    edges: dict[Engine, Ticks],
) -> list[tuple[str, float]]:
    """Let outputs follow their edges and inputs read at theirs; the level of each output after the last point."""
    outputs = {physical: np.full(points.size, level) for physical, level in levels.items()}
    updates: list[tuple[str, float]] = []
    for task in tasks:
        if task.kind == "ao" and task.clock in edges and not task.armed and not task.done and task.hardware_timed:
            updates += _generate(task, levels, faults, points, edges[task.clock], outputs)
    terminals = plant.advance(points / TICKS_PER_SECOND, outputs)
    for task in tasks:
        if task.kind == "ai" and task.clock in edges and not task.armed and not task.done and task.hardware_timed:
            _acquire(task, faults, points, edges[task.clock], terminals)
    return updates


def _generate(
    task: Task, levels: Mapping[str, float], faults: Faults, points: Ticks, edges: Ticks, outputs: dict[str, Floats]
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
        level = levels[channel.physical]
        if taken and not faults.stuck:
            outputs[channel.physical] = np.concatenate(([level], volts))[before]
            updates.append((channel.physical, float(volts[-1])))
    task.edges += edges.size
    if taken < wanted:
        task.edges -= edges.size - taken
        task.fail(ChassisError(-200290, f"Samples generated: {buffer.generated}\nTask: {task.name}"))
    elif finite and task.clock is not task.engine and task.edges > task.timing.samples:
        task.ended = True
    return updates


def _acquire(task: Task, faults: Faults, points: Ticks, edges: Ticks, terminals: Mapping[str, Floats]) -> None:
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
        values = faults.distort(channel, terminal_of(terminals, channel), points)[at]
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


def terminal_of(terminals: Mapping[str, Floats], channel: Channel) -> Floats:
    """What is at the terminal of a channel: nothing is wired to one that the plant does not name."""
    values = terminals.get(channel.physical)
    if values is None:
        return np.array(np.inf if channel.module.resistive else 0.0)
    return np.asarray(values, dtype=np.float64)
