"""What is asked of a bench, checked before it does anything: every bench refuses the same things in the same words."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, suggest
from ipmclab.rig.channels import Rig
from ipmclab.rig.rows import ClampedRows, RowSource, SignalRows
from ipmclab.signals import Signal

FloatArray = npt.NDArray[np.float64]

_CHUNK: Final = 2**18
"""Rows of a signal that are looked at at once: a signal may last for hours."""

SLOWEST: Final = 25.0
"""Lowest rate [Hz] on a chassis: with fewer rows a second a block lasts longer than 40 ms, and with it the time
until the guard, a request or the guardian can act."""


def check_measured(rig: Rig, measured: Collection[str]) -> None:
    """Refuse channels that the rig cannot read.

    Raises
    ------
    InputError
        An unknown channel, displacement and force at once, or two channels on one physical input.
    """
    known = [channel.name for channel in rig.channels]
    for name in measured:
        if name not in known:
            raise InputError(
                f"the bench has no channel {name!r}",
                code="unknown-channel",
                where="measured",
                repair=suggest(name, known),
            )
    if "displacement" in measured and "force" in measured:
        raise InputError(
            "displacement and force cannot be measured in one run: the load cell holds the tip",
            code="blocked-tip",
            where="measured",
            repair="record two runs, one with each",
        )
    taken: dict[str, str] = {}
    for name in dict.fromkeys(measured):
        physical = rig[name].physical
        if physical and physical in taken:
            raise InputError(
                f"{taken[physical]} and {name} are both on {physical}",
                code="duplicate-channel",
                where=f"channels.{name}.physical",
                repair="give each channel its own input",
            )
        taken[physical] = name


def check_voltage(rig: Rig, voltage: float) -> None:
    """Refuse a single voltage [V] that the output cannot give.

    Raises
    ------
    InputError
    """
    low, high = rig.output.low, rig.output.high
    if not low <= voltage <= high:  # not a number is refused here too
        raise InputError(
            f"{voltage:g} V is asked for, the output gives {low:g} V to {high:g} V",
            code="out-of-range",
            where="voltage",
            repair="give a smaller voltage",
        )


def check_rate(rig: Rig, rate: float) -> None:
    """Refuse a rate [Hz] at which what protects the strip would come too late.

    Raises
    ------
    InputError
        Below ``SLOWEST`` on a chassis; a virtual bench, whose time passes as it is asked for, can do any.
    """
    if rig.bench == "ni" and rate < SLOWEST:
        raise InputError(
            f"{rate:g} Hz is asked for, on a chassis it is {SLOWEST:g} Hz at least: the guard looks at every block",
            code="bad-rate",
            where="rate",
            repair=f"record at {SLOWEST:g} Hz or more",
        )


def check_rows(rig: Rig, source: RowSource, rate: float) -> None:
    """Refuse a source of rows that may go beyond what the output can give.

    Raises
    ------
    InputError
        A signal, with its first row that is beyond; a source that is neither known beforehand nor clamped.
    """
    low, high = rig.output.low, rig.output.high
    if isinstance(source, ClampedRows) and low <= source.low and source.high <= high:
        return
    if not isinstance(source, SignalRows):
        raise InputError(
            "its voltages are not known beforehand, and nothing holds them within a limit",
            code="unclamped",
            where="signal",
            repair="hand it to the bench through a GuardedBench",
        )
    check_signal(rig, source.signal, source.length, rate)


def check_signal(rig: Rig, signal: Signal, rows: int, rate: float) -> None:
    """Refuse a signal of which a row is beyond what the output can give.

    Raises
    ------
    InputError
        With the first such row.
    """
    low, high = rig.output.low, rig.output.high
    for first, voltage in chunks(signal, rows, rate):
        beyond = np.flatnonzero(~((voltage >= low) & (voltage <= high)))
        if len(beyond):
            row = int(beyond[0])
            raise InputError(
                f"the signal needs {voltage[row]:g} V at {(first + row) / rate:g} s, "
                f"the output gives {low:g} V to {high:g} V",
                code="out-of-range",
                where="signal",
                repair="give a smaller amplitude or offset",
            )


def chunks(signal: Signal, rows: int, rate: float) -> Iterator[tuple[int, FloatArray]]:
    """A signal in pieces: the first row of each, and its voltages [V]."""
    for first in range(0, rows, _CHUNK):
        yield first, signal.voltage(np.arange(first, min(first + _CHUNK, rows)) / rate)
