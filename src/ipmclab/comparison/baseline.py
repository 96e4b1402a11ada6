"""The curl of a strip without voltage, and a run without it.

In room air a strip curls while it dries (Friend: 2 mm in 6 minutes). A record at 0 V of the same strip shows how fast;
along a straight line, that is taken from the displacement of its runs. It curls ever more slowly: a run that was
clamped again begins as wet as the baseline did, one in the same clamping continues where the baseline ended.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Final

import numpy as np

from ipmclab.consistency.fact import in_one_air
from ipmclab.quality.check import check
from ipmclab.quality.noise import noise_of_readings
from ipmclab.quality.record import NO_VOLTAGE
from ipmclab.quality.usable import unmasked
from ipmclab.run import FloatArray, Run, RunMetadata

BASELINE: Final = "baseline"
NO_SIGNAL: Final = "step 0 V"
"""What a run notes that was recorded without voltage: as its purpose, or as its signal."""

_FEWEST: Final = 20
"""Readings that make a rate: two in each of the blocks."""

_WARMER: Final = 4.0
_WETTER: Final = 6.0
"""With a larger difference [K, percent], the air of two runs is another: twice what counts as one level of a factor."""

_BLOCKS: Final = 10
"""Pieces of a baseline whose own rates show how straight its curl is."""

_STRETCH: Final = 40.0
"""At the beginning and at the end of a baseline [s]: as long as a run (Friend, appendix A.2)."""


@dataclass(frozen=True)
class Air:
    """The air around a strip, as far as it is known.

    Parameters
    ----------
    temperature : float [degC], optional
    relative_humidity : float [percent], optional
    """

    temperature: float | None = None
    relative_humidity: float | None = None

    def is_other(self, other: Air) -> bool:
        """Whether a strip curls otherwise in the other air; not where that is not known."""
        return not in_one_air(self, other, warmer=_WARMER, wetter=_WETTER)


def air_of(run: Run) -> Air:
    """The mean temperature and humidity that a run read, or else those that it notes.

    Examples
    --------
    >>> air_of(Run.from_arrays(time=[0.0, 1.0], voltage=[0.0, 0.0], temperature=[20.0, 22.0])).temperature
    21.0
    """
    noted = run.metadata
    return Air(_mean(run.temperature, noted.temperature), _mean(run.relative_humidity, noted.relative_humidity))


def _mean(values: FloatArray | None, noted: float | None) -> float | None:
    read = np.zeros(0) if values is None else values[np.isfinite(values)]
    return float(read.mean()) if len(read) else noted


@dataclass(frozen=True)
class Drift:
    """How fast a strip moves without voltage.

    Parameters
    ----------
    rate : float [m/s]
    standard_error : float [m/s]
        By noise, and by how far the rate changes along the baseline.
    name : str
        Of the baseline run.
    sample, mounting : str, optional
    recorded_at : str
        Empty where it is not known.
    air : Air
        Around the strip meanwhile.
    first, last : pair of float [m/s], optional
        Rate and standard error in the first and in the last stretch of it; None where it is too short.
    """

    rate: float
    standard_error: float
    name: str
    sample: str | None = None
    mounting: str | None = None
    recorded_at: str = ""
    air: Air = Air()
    first: tuple[float, float] | None = None
    last: tuple[float, float] | None = None

    def during(self, about: RunMetadata) -> Drift:
        """The drift that a run has: that of the baseline's beginning where it was clamped again, of its end after it.

        Where nobody knows which, it is the whole baseline's.

        Examples
        --------
        >>> drift = Drift(2e-6, 1e-6, "baseline.nc", None, "a", "2026-03-01", first=(3e-6, 1e-7), last=(1e-6, 1e-7))
        >>> from ipmclab.run import RunMetadata
        >>> [drift.during(RunMetadata(mounting_id=one, recorded_at="2026-03-02")).rate for one in ("a", "b", None)]
        [1e-06, 3e-06, 2e-06]
        """
        if self.mounting is None or about.mounting_id is None:
            return self
        is_other_mounting = about.mounting_id != self.mounting
        after = -math.inf < _moment(self.recorded_at) <= _moment(about.recorded_at or "")
        part = self.first if is_other_mounting else self.last if after else None
        return self if part is None else replace(self, rate=part[0], standard_error=part[1])


def is_baseline(run: Run) -> bool:
    """Whether a run was recorded without voltage.

    Examples
    --------
    >>> is_baseline(Run.from_arrays(time=[0.0, 1.0], voltage=[0.0, 0.0]))
    True
    """
    return run.metadata.purpose == BASELINE or float(np.abs(run.voltage).max()) < NO_VOLTAGE


def drift_of(run: Run) -> Drift | None:
    """How fast the displacement of a baseline moves, without the rows that ``check`` masks; None where it has none.

    Examples
    --------
    >>> time = np.arange(100) / 10.0
    >>> drift = drift_of(Run.from_arrays(time=time, voltage=0.0 * time, displacement=1e-6 * time))
    >>> round(drift.rate, 12)
    1e-06
    """
    if run.displacement is None:
        return None
    there = unmasked(run, check(run))["displacement"]
    if np.count_nonzero(there) < _FEWEST:
        return None
    time, values = run.time[there], run.displacement[there]
    rate, error = _line(time, values)
    parts = zip(np.array_split(time, _BLOCKS), np.array_split(values, _BLOCKS), strict=True)
    rates, errors = np.array([_line(part, read) for part, read in parts]).T
    variance = float(np.var(rates, ddof=1))
    # A straight curl has pieces that differ by noise alone; what they differ by beyond it, a run may have too.
    bent = max(variance - float(np.mean(errors**2)), 0.0)
    error = math.hypot(max(error, math.sqrt(variance / _BLOCKS)), math.sqrt(bent))
    sample = run.metadata.sample
    return Drift(
        rate=rate,
        standard_error=error,
        name=run.name or "baseline",
        sample=None if sample is None else sample.id,
        mounting=run.metadata.mounting_id,
        recorded_at=run.metadata.recorded_at or "",
        air=air_of(run),
        first=_stretch(time, values),
        last=_stretch(time[-1] - time[::-1], -values[::-1]),
    )


def _stretch(time: FloatArray, values: FloatArray) -> tuple[float, float] | None:
    """The rate in the first stretch of a record, and its standard error; None where there are not two of them.

    Another run begins somewhat earlier or later: half of what the rate changes by until the next stretch counts too.
    """
    since = time - time[0]
    ends = np.searchsorted(since, [_STRETCH, 2.0 * _STRETCH])
    if since[-1] < 2.0 * _STRETCH or min(ends[0], ends[1] - ends[0]) < _FEWEST:
        return None
    (rate, error), (following, _) = (_line(time[i:k], values[i:k]) for i, k in ((0, ends[0]), (ends[0], ends[1])))
    return rate, math.hypot(error, 0.5 * (rate - following))


def _line(time: FloatArray, values: FloatArray) -> tuple[float, float]:
    """The slope of a straight line, and its standard error by the noise of the readings."""
    centred = time - time.mean()
    weight = float(centred @ centred)
    return float(centred @ values) / weight, noise_of_readings(values) / math.sqrt(weight)


def baseline_for(about: RunMetadata, drifts: Sequence[Drift], air: Air = Air()) -> Drift | None:
    """The baseline of the same strip that gives most information on a run: of its mounting, and the last one before it.

    A strip curls because it dries: a baseline in another air says nothing of the run, and none is better. Times are
    compared as moments, whatever time zone they are written in; one without a zone is taken as local. Where every
    baseline came after the run it is the first of them.

    Parameters
    ----------
    about : RunMetadata
        Of the run.
    drifts : sequence of Drift
    air : Air, optional
        Around the strip during the run.

    Returns
    -------
    drift : Drift or None
        None where no baseline is of the same sample in such air.
    """
    sample = None if about.sample is None else about.sample.id
    when = _moment(about.recorded_at or "")
    own = [one for one in drifts if one.sample == sample and sample is not None and not one.air.is_other(air)]
    own = [one for one in own if one.mounting == about.mounting_id] or own
    before = [one for one in own if _moment(one.recorded_at) <= when]
    if before:
        return max(before, key=lambda one: _moment(one.recorded_at))
    return min(own, key=lambda one: _moment(one.recorded_at), default=None)


def _moment(recorded_at: str) -> float:
    """Seconds since 1970; minus infinity where the time is not known, or is none."""
    try:
        return datetime.fromisoformat(recorded_at).timestamp()
    except (ValueError, OverflowError, OSError):
        return -math.inf


def without_drift(run: Run, drift: Drift) -> Run:
    """The run whose displacement has no curl, counted from its first row.

    Examples
    --------
    >>> run = Run.from_arrays(time=[0.0, 1.0, 2.0], voltage=[1.0, 1.0, 1.0], displacement=[0.0, 1e-3, 2e-3])
    >>> without_drift(run, Drift(1e-3, 0.0, "baseline.nc")).displacement.tolist()
    [0.0, 0.0, 0.0]
    """
    if run.displacement is None:
        return run
    return replace(run, displacement=run.displacement - drift.rate * (run.time - run.time[0]))
