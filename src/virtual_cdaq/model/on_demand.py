"""Readings and levels without a sample clock: taken at the moment when the program asks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from virtual_cdaq.model.chassis import Chassis, HostedTask
from virtual_cdaq.model.exchange import terminal_of


def read_now(chassis: Chassis, task: HostedTask, count: int) -> np.ndarray:
    """Codes of `count` samples taken one after the other, shape (channels, count)."""
    codes = np.empty((len(task.channels), count), dtype=np.int32)
    for k in range(count):
        points, terminals = chassis.look()
        for row, (channel, converter) in enumerate(zip(task.channels, task.converters, strict=True)):
            value = chassis.faults.distort(channel, terminal_of(terminals, channel), points)[0]
            codes[row, k] = converter.convert_one(float(value), task.edges)
        task.edges += 1
    return codes


def write_now(chassis: Chassis, task: HostedTask, volts: Sequence[float]) -> None:
    """Set the outputs of a task."""
    chassis.look()
    for channel, level in zip(task.channels, volts, strict=True):
        chassis.set_level(channel.physical, level)
    chassis.show()
