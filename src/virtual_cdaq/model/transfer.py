"""Reading from tasks, writing to them, waiting for them: with the lock of the chassis held."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from virtual_cdaq.model.buffers import OutputBuffer
from virtual_cdaq.model.chassis import HostedTask
from virtual_cdaq.model.converters import Codes, Floats, encode, step
from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.model.on_demand import read_now, write_now
from virtual_cdaq.model.task import State
from virtual_cdaq.model.waiting import gate, wait

ALL_AVAILABLE = -1
PIECES = 10  # of an output buffer, of which one must be free for a write to continue


def read(task: HostedTask, count: int, timeout: float) -> tuple[Codes, int]:
    """The next samples of an input task.

    Parameters
    ----------
    task : HostedTask
    count : int
        Samples per channel; -1 for all that are there (of a finite task: that there will be).
    timeout : float [s]

    Returns
    -------
    codes : array of int, shape (channels, n)
    status : int
        0, or -200284 when the time-out came before the last sample.
    """
    if task.kind != "ai":
        raise ChassisError(-200460 if task.channels else -200478, f"Task: {task.name}", done=0)
    chassis = task.chassis
    gate(chassis)
    chassis.check_present(task)
    task.raise_failure()
    if not task.hardware_timed:
        return _read_on_demand(task, 1 if count == ALL_AVAILABLE else count), 0
    if not task.running:
        if task.listeners:
            raise ChassisError(-200984, f"Task: {task.name}", done=0)
        task.start()
        task.started_by_read = True
    chassis.advance()
    buffer = task.input_buffer
    assert buffer is not None
    if task.overwrite:
        buffer.skip_lost()
    finite = task.finite
    left = task.timing.samples - buffer.position
    if count == ALL_AVAILABLE:
        count = left if finite else buffer.available
    if finite and left == 0 and count > 0:
        raise ChassisError(-200278, f"Samples acquired: {buffer.acquired}\nTask: {task.name}", done=0)
    wanted = min(count, left) if finite else count
    pieces, status = _collect(task, wanted, timeout)
    if task.started_by_read and finite and buffer.position == task.timing.samples:
        task.stop()
    return pieces, status


def _collect(task: HostedTask, wanted: int, timeout: float) -> tuple[Codes, int]:
    buffer = task.input_buffer
    assert buffer is not None
    pieces: list[NDArray[np.int32]] = []
    missing = wanted
    while missing:
        # The buffer of an endless task is emptied on the way: a read may be larger than it, or nearly.
        piece = missing if task.finite else min(missing, max(1, buffer.size // 2))
        goal = buffer.position + piece
        came = wait(
            task.chassis,
            lambda goal=goal: buffer.acquired >= goal or task.failure is not None or not task.running,  # type: ignore[misc]
            lambda goal=goal: task.edge_tick(goal - 1),  # type: ignore[misc]
            timeout,
        )
        task.raise_failure()
        if not came:
            pieces.append(buffer.take(min(missing, buffer.available)))
            return np.concatenate(pieces, axis=1), -200284
        if not task.running and buffer.acquired < goal:
            raise ChassisError(-88710, f"Task: {task.name}", done=0)
        pieces.append(buffer.take(piece))
        missing -= piece
    if not pieces:
        return buffer.take(0), 0
    return (pieces[0] if len(pieces) == 1 else np.concatenate(pieces, axis=1)), 0


def _read_on_demand(task: HostedTask, count: int) -> Codes:
    started = not task.running
    if started:
        task.start()
    try:
        task.chassis.pass_time()
        task.raise_failure()
        return read_now(task.chassis, task, count)
    finally:
        if started and task.running:
            task.stop()


def to_codes(task: HostedTask, values: Floats) -> Codes:
    """Values of shape (channels, n) in the units of their channels as codes; refused outside their limits."""
    if not len(task.channels) == values.shape[0]:
        raise ChassisError(-200524, f"Channels: {len(task.channels)}, in the data: {values.shape[0]}", done=0)
    codes = np.empty(values.shape, dtype=np.int32)
    for row, channel in enumerate(task.channels):
        bad = ~((values[row] >= channel.low - 1e-9) & (values[row] <= channel.high + 1e-9))
        if bad.any():
            at = int(np.argmax(bad))
            unit = " V" if channel.custom is None else ""
            raise ChassisError(
                -200561,
                f"Value: {values[row, at]:g}{unit}, sample {at}"
                f"\nAllowed: {channel.low:g}{unit} to {channel.high:g}{unit}"
                f"\nChannel: {channel.name}\nTask: {task.name}",
                done=0,
            )
        codes[row] = encode(channel.module, channel.chosen, channel.unscale(values[row]))
    return codes


def write(task: HostedTask, codes: Codes, *, auto_start: bool, timeout: float) -> int:
    """Hand samples to an output task.

    Parameters
    ----------
    task : HostedTask
    codes : array of int, shape (channels, n)
    auto_start : bool
    timeout : float [s]

    Returns
    -------
    int
        Samples per channel that were taken.
    """
    if task.kind != "ao":
        raise ChassisError(-200459 if task.channels else -200478, f"Task: {task.name}", done=0)
    chassis = task.chassis
    gate(chassis)
    chassis.check_present(task)
    chassis.advance()
    task.raise_failure()
    if not task.hardware_timed:
        _write_on_demand(task, codes, auto_start=auto_start)
        return int(codes.shape[1])
    count = int(codes.shape[1])
    if task.output_buffer is None:
        task.output_buffer = OutputBuffer(len(task.channels), task.output_size or max(1, count))
    buffer = task.output_buffer
    if not task.running and count > buffer.space:
        if count <= buffer.size or task.output_size is not None:
            raise ChassisError(-200292, f"Buffer: {buffer.size} samples\nTask: {task.name}", done=0)
        raise ChassisError(-200547, f"Buffer: {buffer.size} samples, written: {count}\nTask: {task.name}", done=0)
    put = 0
    while put < count:
        # To a task that runs samples go as room comes: an output whose buffer had to be empty first would run dry.
        piece = min(count - put, max(1, buffer.size // PIECES) if task.running else buffer.size)
        came = (
            wait(
                chassis,
                lambda piece=piece: buffer.space >= piece or task.failure is not None or task.done,  # type: ignore[misc]
                lambda piece=piece: task.edge_tick(buffer.written + piece - buffer.size - 1),  # type: ignore[misc]
                timeout,
            )
            if task.running
            else True
        )
        task.raise_failure()
        if task.running and task.done:
            raise ChassisError(-200288, f"Task: {task.name}", done=put)
        if not came:
            raise ChassisError(-200292, f"Buffer: {buffer.size} samples\nTask: {task.name}", done=put)
        buffer.put(codes[:, put : put + piece])
        put += piece
    if auto_start and not task.running:
        if task.listeners:
            raise ChassisError(-200985, f"Task: {task.name}", done=0)
        task.start()
    return count


def _write_on_demand(task: HostedTask, codes: Codes, *, auto_start: bool) -> None:
    started = not task.running
    if started and not auto_start:
        raise ChassisError(-200846, f"Task: {task.name}", done=0)
    if started:
        task.start()
    try:
        for column in codes.T:
            task.chassis.pass_time()
            volts = [
                int(code) * step(channel.module, channel.chosen)
                for channel, code in zip(task.channels, column, strict=True)
            ]
            write_now(task.chassis, task, volts)
    finally:
        if started and task.running:
            task.stop()


def wait_until_done(task: HostedTask, timeout: float) -> None:
    """Wait for a finite task to end.

    Raises
    ------
    ChassisError
        -200560 when it was not done in time, or what ended it.
    """
    chassis = task.chassis
    gate(chassis)
    came = wait(chassis, lambda: task.done, task.done_tick, timeout)
    task.raise_failure()
    if not came:
        raise ChassisError(-200560, f"Task: {task.name}")


def is_done(task: HostedTask) -> bool:
    """Whether nothing more comes of a task."""
    gate(task.chassis)
    if task.running and task.hardware_timed:
        task.chassis.pass_time()
    task.raise_failure()
    return task.done


def control(task: HostedTask, action: int) -> None:
    """Bring a task to a state: start 0, stop 1, verify 2, commit 3, reserve 4, unreserve 5, abort 6."""
    if action == 0:
        task.start()
    elif action == 1:
        task.stop()
    elif action == 2:
        task.verify()
    elif action in (3, 4):
        if task.running:
            return
        task.commit() if action == 3 else task.reserve()
        task.explicit = max(task.explicit, State.COMMITTED if action == 3 else State.RESERVED)
    elif action == 5:
        task.refuse_while_running()
        task.explicit = State.UNVERIFIED
        task.unreserve()
    elif action == 6:
        task.abort()
    else:
        raise ChassisError(-200077, f"Property: task action\nRequested value: {action}\nAllowed: 0 to 6")
