"""The recorder: applies a signal at a bench, and makes a run of what the bench reads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, IpmclabError
from ipmclab.model.simulate import above_zero, count_rows
from ipmclab.rig.bench import Bench
from ipmclab.rig.channels import Channel
from ipmclab.run import QUALITY_FLAGS, Run, RunMetadata
from ipmclab.signals import Sequence as SignalSequence
from ipmclab.signals import Signal, Step, parse
from ipmclab.signals.signal import EDGE
from ipmclab.version import __version__

FloatArray = npt.NDArray[np.float64]

ZERO_TIME: Final = 10.0
"""How long [s] the channels are read at rest to find their zero."""


def record(
    bench: Bench,
    signal: Signal | str,
    *,
    duration: float,
    rate: float,
    measured: Sequence[str] = ("current", "force"),
    rest_before: float = 0.0,
    rest_after: float = 0.0,
    metadata: RunMetadata | None = None,
) -> Run:
    """Apply a signal at a bench and record the response.

    Before the record the channels are read at rest: what the laser and the load cell tell then (its
    preload) is subtracted from every reading. Each row is read just before the output changes, so
    that a signal which acts from row 0 shows from row 1 on, and the run has the hold ``zero-before``.
    The output is brought to 0 V at the end, also after an error.

    Parameters
    ----------
    bench : Bench
    signal : Signal or str
        Applied for ``duration``.
    duration : float [s]
    rate : float [Hz]
    measured : sequence of str
        ``"current"`` and ``"displacement"`` or ``"force"``; the voltage is always read.
    rest_before, rest_after : float [s]
        Time at 0 V that is recorded before and after the signal.
    metadata : RunMetadata, optional
        What is to be kept with the run: mounting, operator, notes... The recorder fills in what it knows.

    Returns
    -------
    run : Run
        With ``round((rest_before + duration + rest_after) * rate)`` rows. A lost reading is NaN and flagged, as
        is a reading at the limit of its converter.

    Raises
    ------
    InputError
        A signal that is longer than the duration or larger than the output gives, displacement and
        force at once, an unknown channel, fewer than 2 rows or more than 20 million.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> from ipmclab.rig import VirtualBench
    >>> run = record(VirtualBench(load_actuator("friend-2")), "step 1 V", duration=2.0, rate=50.0)
    >>> len(run), run.hold, sorted(run.channels)
    (100, 'zero-before', ['current', 'force', 'voltage'])
    """
    duration = above_zero("duration", duration, "s")
    for name, value in (("rest_before", rest_before), ("rest_after", rest_after)):
        if not 0.0 <= value < math.inf:
            raise InputError(f"{name} is {value:g}", code="out-of-range", where=name, repair="give 0 s or more")
    rows, rate = count_rows(rest_before + duration + rest_after, rate)
    commanded = _with_rest(parse(signal) if isinstance(signal, str) else signal, rest_before, duration, rest_after)
    names = tuple(dict.fromkeys(["voltage", *measured]))
    try:
        bench.open(names, rate)
        channels = [bench.rig[name] for name in names]
        at_rest = _read(bench, Step(0.0), max(1, round(ZERO_TIME * rate)), names)
        zeros = {channel.name: _zero(channel, at_rest[channel.name]) for channel in channels}
        readings = _read(bench, commanded, rows, names)
    finally:
        bench.close()
    quality = {channel.name: _flags(channel, readings[channel.name]) for channel in channels}
    values = {channel.name: _scale(channel, readings[channel.name], zeros[channel.name]) for channel in channels}
    about = metadata or RunMetadata()
    return Run.from_arrays(
        time=np.arange(rows) / rate,
        hold="zero-before",
        quality={name: flags for name, flags in quality.items() if flags.any()},
        metadata=replace(
            about,
            origin=bench.origin,
            sample=about.sample or bench.sample,
            signal=str(commanded),
            voltage_sensed=bench.rig.voltage_sensed,
            shunt_resistance=bench.rig.shunt_resistance,
            starts_from_rest=True,
            ranges={
                channel.name: (channel.range[0] - zeros[channel.name], channel.range[1] - zeros[channel.name])
                for channel in channels
            },
            calibrations={channel.name: channel.calibration(zeros[channel.name]) for channel in channels},
            bench=bench.description,
            software_version=__version__,
        ),
        **values,
    )


def _with_rest(signal: Signal, before: float, duration: float, after: float) -> Signal:
    """The signal in the time of the record."""
    signal.check_fits(duration)
    if not before and not after:
        return signal
    parts: tuple[Signal, ...] = (signal,)
    lasts: tuple[float, ...] = ()
    if isinstance(signal, SignalSequence):
        parts, lasts = signal.signals, signal.durations
    shown: list[tuple[Signal, float]] = [(Step(0.0), before)] if before else []
    left = duration
    for part, last in zip(parts, (*lasts, math.inf), strict=False):
        if left > EDGE:
            shown.append((part, min(last, left)))
        left -= last
    return SignalSequence(tuple(part for part, _ in shown), tuple(last for _, last in shown))


def _read(bench: Bench, signal: Signal, rows: int, names: Sequence[str]) -> dict[str, FloatArray]:
    blocks = list(bench.apply(signal, rows))
    return {name: np.concatenate([block.readings[name] for block in blocks]) for name in names}


def _zero(channel: Channel, readings: FloatArray) -> float:
    """What the channel tells at rest."""
    if not channel.zeroed:
        return 0.0
    if channel.is_lost(readings).any():
        raise IpmclabError(
            "the sensor sees no strip at rest",
            code="no-reading-at-rest",
            where=channel.name,
            repair="bring the strip into the middle of its range",
        )
    return channel.to_quantity(float(np.mean(readings)))


def _scale(channel: Channel, readings: FloatArray, zero: float) -> FloatArray:
    values = channel.gain * readings + (channel.offset - zero)
    return np.where(channel.is_lost(readings), np.nan, values)


def _flags(channel: Channel, readings: FloatArray) -> npt.NDArray[np.uint8]:
    lost = channel.is_lost(readings) * (QUALITY_FLAGS["missing"] | QUALITY_FLAGS["sentinel"])
    clipped = channel.converter.at_limit(readings) * QUALITY_FLAGS["clipped"]
    return (lost | clipped).astype(np.uint8)
