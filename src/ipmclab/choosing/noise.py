"""The noise of autocorrelated residuals, its likelihood, and how many readings it leaves.

A residual is taken as white noise plus up to two Ornstein-Uhlenbeck processes (correlations that fade
exponentially with time): one for what a model misses for a moment, one for a drift. The time is continuous, so
runs of different rates and records with gaps share one noise. The density of a row given the rows before comes
from a Kalman filter, hence exactly (Rasmussen and Williams, Gaussian Processes for Machine Learning, app. B).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.statespace.kernels import whiten

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

MOST_PARTS: Final = 2  # fading noises together (a limit)
_FLOOR: Final = 1e-9  # of the extent: a residual below is arithmetic
_ALIKE: Final = 9  # digits of a step, in shortest steps
_LONGEST: Final = 10.0  # records: a process slower than that is a constant


@dataclass(frozen=True, eq=False)
class ResidualSeries:
    """The residual of one output of one run, with the two yardsticks of its noise.

    Parameters
    ----------
    time : float array, shape (n_time,) [s]
    residual : float array, shape (n_time,) [SI]
    observed : bool array, shape (n_time,)
    noise : float [SI]
        Scatter between neighbouring readings: white noise is counted in it.
    extent : float [SI]
        Range of the readings: what a model misses is counted in it.
    """

    time: FloatArray
    residual: FloatArray
    observed: Mask
    noise: float
    extent: float

    @cached_property
    def steps(self) -> tuple[IndexArray, FloatArray, IndexArray]:
        """The rows that are observed, the steps of time that lead to them [s], and of which size each is."""
        return _steps(self.time, self.observed)


def _steps(time: FloatArray, observed: Mask) -> tuple[IndexArray, FloatArray, IndexArray]:
    rows = np.flatnonzero(observed)
    passed = np.diff(time[rows], prepend=time[rows[:1]])
    shortest = passed[1:].min() if len(rows) > 1 else 1.0
    # Steps that only rounding distinguishes are of one kind, so that an even record soon has one gain.
    sizes, kinds = np.unique(np.round(passed / shortest, _ALIKE), return_inverse=True)
    return rows, sizes * shortest, kinds


class Filtered(NamedTuple):
    """Log density of the observed rows; of each row its error [SI], the variance of that [SI^2], and columns
    whitened."""

    total: float
    innovation: FloatArray
    variance: FloatArray
    whitened: FloatArray


class Part(NamedTuple):
    """One fading correlation: standard deviation in extents of the output, and how long it lasts [s]."""

    amplitude: float
    time_constant: float


@dataclass(frozen=True)
class FadingNoise:
    """White noise and fading correlations.

    Parameters
    ----------
    white : float
        Standard deviation of the white noise, in scatters of neighbouring readings.
    parts : tuple of Part
    """

    white: float
    parts: tuple[Part, ...] = ()

    @property
    def parameters(self) -> int:
        """How many numbers were fitted."""
        return 1 + 2 * len(self.parts)

    def filter(
        self, series: ResidualSeries, observed: Mask | None = None, columns: FloatArray | None = None
    ) -> Filtered:
        """The density of a residual, of all its observed rows or of those that ``observed`` names.

        Rows that are not observed only let time pass, so that gaps and unequal steps are exact. Columns of shape
        (n_time, n_columns) are foreseen and divided as the residual is.
        """
        rows, sizes, kinds = series.steps if observed is None else _steps(series.time, observed)
        matrix = series.residual[rows, None]
        if columns is not None:
            matrix = np.hstack([matrix, columns[rows]])
        rates = np.array([1.0 / part.time_constant for part in self.parts])
        stationary = np.array([(part.amplitude * series.extent) ** 2 for part in self.parts])
        passed = np.outer(sizes, rates)
        each = np.eye(len(rates))
        white = (self.white * series.noise) ** 2 + (_FLOOR * series.extent) ** 2 + 1e-300
        of_rows = np.empty(len(rows))
        logarithm = whiten(
            matrix,
            np.ones(len(rows), dtype=np.int64),
            kinds,
            each * np.exp(-passed)[:, None],
            each * (-stationary * np.expm1(-2.0 * passed))[:, None],
            np.ones(len(rates)),
            white,
            each * stationary,
            of_rows,
        )
        error = matrix[:, 0]
        total = -0.5 * (len(rows) * math.log(2.0 * math.pi) + logarithm + float(error @ error))
        innovation, variance = np.full(len(series.time), np.nan), np.full(len(series.time), np.nan)
        whitened = np.full((len(series.time), matrix.shape[1] - 1), np.nan)
        innovation[rows], variance[rows], whitened[rows] = error * np.sqrt(of_rows), of_rows, matrix[:, 1:]
        return Filtered(total, innovation, variance, whitened)

    def effective_readings(self, series: ResidualSeries) -> float:
        """How many independent readings would fix a mean as well as these do.

        The variance of one reading over the variance of the mean of all: n for white noise; for a
        correlation that lasts tau in a record of length T about T/(2 tau), never below 1.

        Examples
        --------
        >>> time = np.arange(1000) * 0.1
        >>> series = ResidualSeries(time, np.zeros(1000), np.full(1000, True), 1.0, 1.0)
        >>> FadingNoise(1.0).effective_readings(series)
        1000.0
        >>> round(FadingNoise(0.0, (Part(1.0, 1.0),)).effective_readings(series), 1)
        50.5
        """
        count = int(np.count_nonzero(series.observed))
        if count < 2:
            return float(count)
        white = (self.white * series.noise) ** 2 + (_FLOOR * series.extent) ** 2
        of_one, of_mean = white, white / count
        observed = series.time[series.observed]
        length = float(observed[-1] - observed[0])
        for part in self.parts:
            square, ratio = (part.amplitude * series.extent) ** 2, part.time_constant / length
            of_one += square
            of_mean += square * 2.0 * ratio * (1.0 + ratio * math.expm1(-1.0 / ratio))
        if of_mean <= 0.0:
            return float(count)
        return min(max(of_one / of_mean, 1.0), float(count))


def fit_noise(series: Sequence[ResidualSeries]) -> FadingNoise:
    """The noise under which residuals are most likely, with as many fading correlations as they call for (BIC).

    Parameters
    ----------
    series : sequence of ResidualSeries
        Of one output, one for each run.

    Examples
    --------
    >>> time = np.arange(2000) * 0.02
    >>> white = np.random.default_rng(20261121).standard_normal(2000)
    >>> fit_noise([ResidualSeries(time, white, np.full(2000, True), 1.0, 5.0)]).parts
    ()
    """
    used = [one for one in series if one.observed.any()]
    count = sum(int(np.count_nonzero(one.observed)) for one in used)
    scatter = math.sqrt(
        sum(float(np.sum((one.residual[one.observed] / one.noise) ** 2)) for one in used) / max(count, 1)
    )
    best = FadingNoise(max(scatter, 1e-12))
    likely = sum(best.filter(one).total for one in used)
    penalty = 0.5 * math.log(max(count, 2))
    for _ in range(MOST_PARTS):
        found = max((_refine(used, start) for start in _richer(used, best)), key=lambda pair: pair[1])
        if found[1] - likely < 2.0 * penalty:
            break
        best, likely = found
    return best


def _richer(series: Sequence[ResidualSeries], noise: FadingNoise) -> list[FadingNoise]:
    """Where to look for one more correlation: short and long ones."""
    length = max(float(one.time[-1] - one.time[0]) for one in series)
    step = min(float(np.min(np.diff(one.time))) for one in series)
    relative = np.concatenate([one.residual[one.observed] / one.extent for one in series])
    amplitude = max(0.7 * float(np.sqrt(np.mean(relative**2))), 1e-9)
    between = max(0.3 * noise.white, 1e-12)
    times = (5.0 * step, math.sqrt(5.0 * step * 0.2 * length), 0.2 * length)
    if noise.parts:
        taken = noise.parts[0].time_constant
        return [
            FadingNoise(noise.white, (noise.parts[0], Part(amplitude, time))) for time in times if abs(time - taken) > 0
        ]
    return [FadingNoise(between, (Part(amplitude, time),)) for time in times]


def _refine(series: Sequence[ResidualSeries], start: FadingNoise) -> tuple[FadingNoise, float]:
    """The most likely noise near a start, in logarithms."""
    from scipy.optimize import minimize

    step = min(float(np.min(np.diff(one.time))) for one in series)
    length = max(float(one.time[-1] - one.time[0]) for one in series)
    limits = [(math.log(1e-3), math.log(1e9))]
    entries = [math.log(max(start.white, 1e-3))]
    for part in start.parts:
        entries += [math.log(part.amplitude), math.log(part.time_constant)]
        limits += [(math.log(1e-10), math.log(1e3)), (math.log(0.5 * step), math.log(_LONGEST * length))]

    def noise(theta: FloatArray) -> FadingNoise:
        values = [float(value) for value in np.exp(theta)]
        return FadingNoise(values[0], tuple(map(Part, values[1::2], values[2::2])))

    def negative_log_likelihood(theta: FloatArray) -> float:
        return -sum(noise(theta).filter(one).total for one in series)

    found = minimize(
        negative_log_likelihood, np.array(entries), method="L-BFGS-B", bounds=limits, options={"maxiter": 60}
    )
    return noise(found.x), -float(found.fun)
