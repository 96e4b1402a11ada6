"""Disturbance: what moves a strip beside its voltage, a level whose rate is driven by noise and soon forgotten."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.identify.forecasting.filter_loop import filtered

FloatArray = npt.NDArray[np.float64]

_NOISE: Final = 0.1
"""Variance of a reading over that by which the level moves in a step: what the disturbance does is read well."""
_TURNS: Final = 12
_SETTLED: Final = 0.01
_ROUNDING: Final = 1e-5
"""Of the range of the readings: what is below it is taken as noise, so that a noise-free record can be filtered."""


@dataclass(frozen=True)
class Disturbance:
    """``level' = rate``, ``rate' = -rate/memory + noise``: an integrated Ornstein-Uhlenbeck process.

    For a short memory the level is a random walk, which holds its last value; for a long one it goes on as it went.
    In between it is a damped local trend.

    Parameters
    ----------
    memory : float [s]
    """

    memory: float

    def transition(self, seconds: float) -> FloatArray:
        """What becomes of level and rate, shape (2, 2).

        Examples
        --------
        >>> Disturbance(memory=2.0).transition(1e9).round(9).tolist()
        [[1.0, 2.0], [0.0, 0.0]]
        """
        kept = math.exp(-seconds / self.memory)
        return np.array([[1.0, self.memory * (1.0 - kept)], [0.0, kept]])

    def drive(self, seconds: float) -> FloatArray:
        """Covariance of level and rate after a time from a known state, for noise of strength 1, shape (2, 2)."""
        memory, kept = self.memory, math.exp(-seconds / self.memory)
        lost = -math.expm1(-seconds / self.memory)
        level = memory**2 * (seconds - 2.0 * memory * lost + 0.5 * memory * (1.0 - kept * kept))
        mixed = 0.5 * (memory * lost) ** 2
        return np.array([[max(level, 0.0), mixed], [mixed, 0.5 * memory * (1.0 - kept * kept)]])


@dataclass(frozen=True, eq=False)
class Filtered:
    """What readings up to a step tell about level, rate and coefficients.

    Parameters
    ----------
    strength : float
        Of the noise that drives the rate [SI unit of the channel squared per s^3].
    mean, covariance : float array, shapes (n,) and (n, n)
        At the last step.
    noise : float
        Variance of a reading.
    """

    strength: float
    mean: FloatArray
    covariance: FloatArray
    noise: float

    def predict(self, disturbance: Disturbance, ahead: FloatArray, regressors: FloatArray) -> tuple[FloatArray, ...]:
        """Mean and variance of readings ahead.

        Parameters
        ----------
        disturbance : Disturbance
        ahead : float array, shape (n_time,) [s]
        regressors : float array, shape (n_time, n_coefficients)
        """
        mean, variance = np.empty(len(ahead)), np.empty(len(ahead))
        weights = np.zeros(len(self.mean))
        for row, seconds in enumerate(ahead):
            weights[:2] = disturbance.transition(seconds)[0]
            weights[2:] = regressors[row]
            mean[row] = weights @ self.mean
            driven = self.strength * disturbance.drive(seconds)[0, 0]
            variance[row] = max(weights @ self.covariance @ weights, 0.0) + driven + self.noise
        return mean, variance


def filter_readings(
    disturbance: Disturbance,
    readings: FloatArray,
    regressors: FloatArray,
    coefficients: tuple[FloatArray, FloatArray],
    step: float,
    span: float,
    judged: npt.NDArray[np.bool_],
) -> Filtered:
    """Filter readings, with the strength of the noise found from the readings themselves.

    The strength is that at which predictions made ``span`` ahead from earlier steps of this record miss by as much
    as they say they do. One step ahead would be the usual likelihood; it weighs the jitter of the rate, of which a
    forecast over many seconds knows nothing.

    Parameters
    ----------
    disturbance : Disturbance
    readings : float array, shape (n_steps,)
        At regular steps; NaN where there is none.
    regressors : float array, shape (n_steps, n_coefficients)
    coefficients : tuple of float array, float array, shapes (n_coefficients,)
        Prior mean and standard deviation.
    step, span : float [s]
    judged : bool array, shape (n_steps,)
        Steps from which predictions are judged.

    Returns
    -------
    filtered : Filtered
    """
    count = max(1, round(span / step))
    transition, drive = disturbance.transition(step), disturbance.drive(step)
    onward = disturbance.transition(count * step)[0]
    driven = float(disturbance.drive(count * step)[0, 0])
    known = np.isfinite(readings)
    origins = np.flatnonzero(judged[:-count] & known[count:])
    weights = np.column_stack([np.tile(onward, (len(origins), 1)), regressors[origins + count]])
    reach = float(np.ptp(readings[known]))
    n = 2 + regressors.shape[1]
    means, covariances = np.empty((len(readings), n)), np.empty((len(readings), n, n))
    rounding = (_ROUNDING * max(reach, 1e-150)) ** 2
    smallest = rounding / (disturbance.memory**2 * span)
    strength = max(float(np.var(np.diff(readings[known]))) / step, smallest)
    for _ in range(_TURNS):
        noise = max(_NOISE * strength * drive[0, 0], rounding)
        mean = np.concatenate([[readings[known][0], 0.0], coefficients[0]])
        spread = [max(reach**2, rounding), 0.5 * strength * disturbance.memory, *coefficients[1] ** 2]
        _loop()(readings, regressors, transition, strength * drive, noise, mean, np.diag(spread), means, covariances)
        missed = readings[origins + count] - np.einsum("ij,ij->i", weights, means[origins])
        expected = np.einsum("ij,ijk,ik->i", weights, covariances[origins], weights) + strength * driven + noise
        factor = float(np.mean(missed**2 / expected)) if len(origins) else 1.0
        last = Filtered(strength, means[-1].copy(), covariances[-1].copy(), noise)
        if abs(factor - 1.0) < _SETTLED:
            break
        strength = max(strength * factor, smallest)
    return last


@cache
def _loop() -> Callable[..., Any]:
    from ipmclab.model.numerics.compiled import kernel

    return kernel(filtered)
