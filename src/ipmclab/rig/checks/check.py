"""Whether a rig is fit for a strip: every channel of it, first on paper, then read with the output at 0 V."""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import IpmclabError
from ipmclab.rig.bench import Bench
from ipmclab.rig.chambers.chamber import Chamber, Conditions
from ipmclab.rig.channels import Channel, Rig
from ipmclab.rig.checks.chamber import chamber_findings
from ipmclab.rig.checks.ranges import calibrations, expected_peak, ranges
from ipmclab.rig.checks.rest import at_rest, temperature_findings
from ipmclab.rig.safety.readback import left_at_output
from ipmclab.run import Finding
from ipmclab.signals import Step

if TYPE_CHECKING:
    from ipmclab.model import Actuator

FloatArray = npt.NDArray[np.float64]

READ_TIME: Final = 2.0
RATE: Final = 50.0
"""How long [s] and how fast [Hz] each channel is read."""


_GONE: Final = (
    *("bench-lost", "bench-frozen", "bench-in-use", "bench-unreachable", "no-driver", "no-nidaqmx", "no-grpc"),
    *("server-too-old", "server-overloaded"),
)
"""Errors after which no channel can be read."""


@dataclass(frozen=True)
class ChannelCheck:
    """What a channel can read, and what it reads at rest.

    Parameters
    ----------
    channel : Channel
    expected : float [SI unit of the channel], optional
        Largest value that is expected; None where nothing is known of it.
    reading, noise : float [SI unit of the channel], optional
        Mean and standard deviation at 0 V; None where it could not be read.
    """

    channel: Channel
    expected: float | None = None
    reading: float | None = None
    noise: float | None = None


@dataclass(frozen=True)
class RigCheck:
    """A rig that was looked at.

    Parameters
    ----------
    rig : Rig
    bench : str
        The bench as a text.
    peak_current : float [A]
        Expected at an edge from rest; a polarity reversal draws twice as much.
    channels : tuple of ChannelCheck
    temperature : float [degC], optional
        What the thermometer read.
    findings : tuple of Finding
    chamber : Conditions, optional
        What the chamber says of itself; None where there is none, or none that answers.
    """

    rig: Rig
    bench: str
    peak_current: float
    channels: tuple[ChannelCheck, ...]
    temperature: float | None
    findings: tuple[Finding, ...]
    chamber: Conditions | None = None


def check_rig(
    bench: Bench,
    actuator: Actuator,
    *,
    amplitude: float = 1.0,
    today: datetime.date | None = None,
    chamber: Chamber | None = None,
) -> RigCheck:
    """Look at every channel of a rig.

    Parameters
    ----------
    bench : Bench
        Closed. It is opened and read for some seconds with its output at 0 V; nothing else is given out.
    actuator : Actuator
        The strip that is to be driven.
    amplitude : float [V]
        Largest voltage of either polarity.
    today : date, optional
        Against which calibrations age.
    chamber : Chamber, optional
        It is read, and continues with what it does.

    Raises
    ------
    IpmclabError
        The bench cannot be read at all.
    """
    rig = bench.rig
    peak = expected_peak(rig, actuator, amplitude)
    findings = [*ranges(rig, amplitude, peak), *calibrations(rig, today or datetime.date.today())]
    read, temperature, found = _read(bench)
    findings += found
    expected = {"voltage": amplitude, "current": 2.0 * peak}
    rows = []
    for channel in rig.channels:
        values = read.get(channel.name)
        if values is None:
            rows.append(ChannelCheck(channel, expected.get(channel.name)))
            continue
        scaled = channel.gain * values + channel.offset
        rows.append(ChannelCheck(channel, expected.get(channel.name), float(scaled.mean()), float(scaled.std())))
        findings += at_rest(channel, values)
    if "voltage" in read:
        left = left_at_output(rig, {name: float(values.mean()) for name, values in read.items()})
        if left is not None:
            findings.append(
                Finding(
                    "output-not-zero",
                    "error",
                    f"the output was set to 0 V and gives {left:.3g} V",
                    "switch the amplifier off; look at its wiring, its offset and at that of the input",
                    "voltage",
                    values={"voltage": left},
                )
            )
    findings += temperature_findings(rig, temperature, was_read=bool(read))
    conditions = None
    if chamber is not None:
        humid = next((row.reading for row in rows if row.channel.name == "relative_humidity"), None)
        conditions, found_there = chamber_findings(chamber, temperature, humid)
        findings += found_there
    return RigCheck(rig, bench.description, peak, tuple(rows), temperature, tuple(findings), conditions)


def _read(bench: Bench) -> tuple[dict[str, FloatArray], float | None, list[Finding]]:
    """Every channel at 0 V: the readings [V], the temperature [degC], and what could not be read."""
    names = [channel.name for channel in bench.rig.channels]
    # The load cell holds the tip, so that a bench does not read it together with the laser.
    groups = [[name for name in names if name != other] for other in ("displacement", "force") if other in names]
    if len(groups) < 2:
        groups = [names]
    readings: dict[str, FloatArray] = {}
    temperatures: list[FloatArray] = []
    errors: dict[str, IpmclabError] = {}
    for group in groups:
        try:
            _read_group(bench, group, readings, temperatures)
        except IpmclabError as error:
            if error.code in _GONE:
                raise
            errors |= _one_by_one(bench, group, readings, temperatures, error)
    read = np.concatenate(temperatures) if temperatures else np.empty(0)
    return readings, float(read.mean()) if len(read) else None, list(_unread(errors))


def _unread(errors: dict[str, IpmclabError]) -> Iterator[Finding]:
    """What could not be read, and why: once for all channels that have the same fault."""
    same: dict[tuple[str, str, str], list[str]] = {}
    for name, error in errors.items():
        same.setdefault((error.code, error.message, error.repair), []).append(name)
    for (code, message, repair), names in same.items():
        if len(names) == 1:
            where = errors[names[0]].where
            yield Finding(code, "error", f"{where}: {message}" if where else message, repair, names[0] or None)
        else:
            yield Finding(code, "error", f"{', '.join(names)}: {message}", repair)


def _read_group(
    bench: Bench, group: Sequence[str], readings: dict[str, FloatArray], temperatures: list[FloatArray]
) -> None:
    try:
        bench.open(group, RATE)
        blocks = list(bench.apply(Step(0.0), round(READ_TIME * RATE)))
    finally:
        bench.close()
    for name in group:
        readings.setdefault(name, np.concatenate([block.readings[name] for block in blocks]))
    temperatures += [block.temperature for block in blocks]


def _one_by_one(
    bench: Bench,
    group: Sequence[str],
    readings: dict[str, FloatArray],
    temperatures: list[FloatArray],
    first: IpmclabError,
) -> dict[str, IpmclabError]:
    """Which channels keep the bench from reading them all; the name is empty where each alone can be read.

    Raises
    ------
    IpmclabError
        It is none of them: the bench cannot be read at all.
    """
    errors: dict[str, IpmclabError] = {}
    for name in group:
        try:
            _read_group(bench, [name], readings, temperatures)
        except IpmclabError as error:
            errors[name] = error
    if len(errors) == len(group) and len({str(error) for error in errors.values()}) == 1:
        raise first
    return errors or {"": first}
