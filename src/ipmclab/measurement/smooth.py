"""A fan's vibration taken out of a record: what is faster than the strip bends (Friend, section 3.5)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final
from uuid import uuid4

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.quality.check import check
from ipmclab.quality.usable import usable
from ipmclab.run import Finding, FloatArray, Run
from ipmclab.units import CHANNELS

CHANNELS_OF_THE_TIP: Final = ("displacement", "force")
"""The current jumps with the voltage: a filter would make another current of it."""

_KERNEL: Final = 5.0
"""How many standard deviations of its bell the filter reaches to both sides."""

_EVEN: Final = 1e-3
"""Of the time between rows, by which it may differ along the record."""

_LEAST_PERIODS: Final = 5.0
_MOST_OF_RATE: Final = 0.25
_LINE: Final = 0.1
"""Of its frequency, to both sides: what belongs to a line of the spectrum."""


@dataclass(frozen=True)
class TakenOut:
    """What a filter took out of one channel.

    Parameters
    ----------
    rms : float [SI unit of the channel]
    frequency : float [Hz]
        Where most of it was.
    share : float
        Part of its power within 10 % of that frequency: near 1 for a fan that turns evenly, small for noise.
    """

    rms: float
    frequency: float
    share: float


def smooth(run: Run, below: float) -> tuple[Run, Mapping[str, TakenOut]]:
    """A copy of a run without what is fast in its displacement and force.

    Each reading becomes the height of a straight line, laid through its neighbours with the weights of a bell. That
    shifts nothing in time, leaves every straight line as it is (at the ends and next to a gap too), halves the power at
    the frequency ``below`` and has no overshoot; a kink is rounded within a third of its period. Readings that a
    check leaves out, and bounds, are not used and stay as they are, and so do current and voltage.

    A fit needs no such copy: to it vibration is noise. What is left of the noise follows itself afterwards.

    Parameters
    ----------
    run : Run
        With rows at even times.
    below : float [Hz]
        What is slower stays.

    Returns
    -------
    smoothed : Run
        With a uuid of its own and a finding that says what was done.
    taken_out : mapping of channel to TakenOut

    Raises
    ------
    InputError
        Neither displacement nor force, uneven times, or a frequency that the record cannot be filtered at.

    Examples
    --------
    >>> time = np.arange(0.0, 20.0, 0.02)
    >>> tip = 1e-3 * (1.0 - np.exp(-time / 2.0))
    >>> shaken = Run.from_arrays(time=time, voltage=0 * time + 1, displacement=tip + 2e-5 * np.sin(70.0 * time))
    >>> quiet, taken_out = smooth(shaken, 3.0)
    >>> f"{1e6 * taken_out['displacement'].rms:.0f} um at {taken_out['displacement'].frequency:.0f} Hz"
    '14 um at 11 Hz'
    >>> f"{1e6 * np.abs(quiet.displacement - tip)[100:-100].max():.1f} um off"
    '0.3 um off'
    """
    names = [name for name in CHANNELS_OF_THE_TIP if name in run.channels]
    where = run.name or "run"
    if not names:
        raise InputError(
            "it has neither displacement nor force",
            code="no-channel",
            where=where,
            repair="give a run that shows the tip",
        )
    step = _step(run, below, where)
    good = usable(run, check(run))
    taken_out: dict[str, TakenOut] = {}
    values: dict[str, FloatArray] = {}
    for name in names:
        readings = run.channels[name]
        slow = _local_lines(
            np.where(good[name], readings, np.nan), step, math.sqrt(math.log(2.0)) / (2 * math.pi * below)
        )
        values[name] = np.where(good[name], slow, readings)
        taken_out[name] = _taken_out(np.where(good[name], readings - slow, 0.0), int(good[name].sum()), step)
    said = Finding(
        "smoothed",
        "info",
        f"{' and '.join(names)} were smoothed below {below:g} Hz: "
        + ", ".join(
            f"{CHANNELS[name].to_display(one.rms):.3g} {CHANNELS[name].display_unit} (root mean square) were taken out"
            for name, one in taken_out.items()
        ),
        f"the readings as they were are in {where}",
    )
    about = replace(
        run.metadata,
        uuid=None if run.metadata.uuid is None else str(uuid4()),
        source_file=run.metadata.source_file or run.name or None,
        findings=(*run.metadata.findings, said),
    )
    smoothed = replace(
        run,
        metadata=about,
        file="",
        displacement=values.get("displacement", run.displacement),
        force=values.get("force", run.force),
    )
    return smoothed, taken_out


def _step(run: Run, below: float, where: str) -> float:
    """Time between rows [s]."""
    steps = np.diff(run.time)
    step = float(np.median(steps)) if len(steps) else math.nan
    if not (len(steps) and np.abs(steps - step).max() <= _EVEN * step):
        raise InputError(
            "its rows are not at even times",
            code="uneven-times",
            where=where,
            repair="give a record with one time between its rows",
        )
    low, high = _LEAST_PERIODS / (step * len(run.time)), _MOST_OF_RATE / step
    if not low <= below <= high:
        raise InputError(
            f"{below:g} Hz is not between {low:.3g} Hz, of which the record has {_LEAST_PERIODS:g} periods, and "
            f"{high:.3g} Hz, a quarter of its rate",
            code="out-of-range",
            where="--below",
            repair="take a frequency between the strip's own motion and the vibration",
        )
    return step


def _local_lines(readings: FloatArray, step: float, width: float) -> FloatArray:
    """The local straight line at each row, with weights of a bell [s] around it; NaN readings have no weight."""
    from scipy.signal import oaconvolve

    reach = math.ceil(_KERNEL * width / step)
    offsets = np.arange(-reach, reach + 1) * step / width
    bell = np.exp(-0.5 * offsets**2)
    there = np.isfinite(readings)
    middle = float(readings[there].mean()) if there.any() else 0.0
    heights = np.where(there, readings - middle, 0.0)

    def around(values: npt.NDArray[np.float64], power: int) -> FloatArray:
        found: FloatArray = oaconvolve(values, (bell * offsets**power)[::-1], mode="full")[reach : reach + len(values)]
        return found

    weights = [around(there.astype(np.float64), power) for power in (0, 1, 2)]
    moments = [around(heights, power) for power in (0, 1)]
    spread = weights[0] * weights[2] - weights[1] ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        line = (weights[2] * moments[0] - weights[1] * moments[1]) / spread
    # A reading that is alone between gaps stays as it is.
    alone = spread <= 1e-6 * np.maximum(weights[0], 1.0) ** 2
    return middle + np.where(alone, heights, line)


def _taken_out(removed: FloatArray, count: int, step: float) -> TakenOut:
    power = np.abs(np.fft.rfft(removed)) ** 2
    frequencies = np.fft.rfftfreq(len(removed), step)
    total = float(power[1:].sum())
    if count == 0 or total == 0.0:
        return TakenOut(0.0, 0.0, 0.0)
    main = float(frequencies[1 + int(np.argmax(power[1:]))])
    near = np.abs(frequencies - main) <= _LINE * main
    rms = math.sqrt(float(removed @ removed) / count)
    return TakenOut(rms, main, float(power[near].sum()) / total)
