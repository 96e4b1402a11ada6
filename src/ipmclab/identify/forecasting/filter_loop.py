"""The Kalman filter of a response with a disturbance, as plain Python; ``disturbance`` compiles it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def filtered(
    readings: FloatArray,
    regressors: FloatArray,
    transition: FloatArray,
    drive: FloatArray,
    noise: float,
    mean: FloatArray,
    covariance: FloatArray,
    means: FloatArray,
    covariances: FloatArray,
) -> None:
    """Filter readings at regular steps; NaN is a step without one.

    The state is a level, its rate, and coefficients that stay. Level and rate move by ``transition`` and are driven by
    noise of covariance ``drive``; a reading is the level plus the coefficients times their regressors, plus noise.

    Parameters
    ----------
    readings : float array, shape (n_steps,)
    regressors : float array, shape (n_steps, n_coefficients)
    transition, drive : float array, shape (2, 2)
    noise : float
        Variance of a reading.
    mean, covariance : float array, shapes (n,) and (n, n), n = 2 + n_coefficients
        Of the state at the first step, before its reading. Overwritten.
    means, covariances : float array, shapes (n_steps, n) and (n_steps, n, n)
        Filled: the state after each reading.
    """
    n = len(mean)
    along = np.empty(n)
    for step in range(len(readings)):
        if step:
            level = transition[0, 0] * mean[0] + transition[0, 1] * mean[1]
            mean[1] = transition[1, 0] * mean[0] + transition[1, 1] * mean[1]
            mean[0] = level
            for j in range(n):
                first, second = covariance[0, j], covariance[1, j]
                covariance[0, j] = transition[0, 0] * first + transition[0, 1] * second
                covariance[1, j] = transition[1, 0] * first + transition[1, 1] * second
            for i in range(n):
                first, second = covariance[i, 0], covariance[i, 1]
                covariance[i, 0] = transition[0, 0] * first + transition[0, 1] * second
                covariance[i, 1] = transition[1, 0] * first + transition[1, 1] * second
            for i in range(2):
                for j in range(2):
                    covariance[i, j] += drive[i, j]
        if not np.isnan(readings[step]):
            expected = mean[0]
            for j in range(2, n):
                expected += regressors[step, j - 2] * mean[j]
            variance = noise
            for i in range(n):
                total = covariance[i, 0]
                for j in range(2, n):
                    total += covariance[i, j] * regressors[step, j - 2]
                along[i] = total
            variance += along[0]
            for j in range(2, n):
                variance += regressors[step, j - 2] * along[j]
            surprise = (readings[step] - expected) / variance
            for i in range(n):
                mean[i] += along[i] * surprise
                for j in range(i + 1):
                    covariance[i, j] -= along[i] * along[j] / variance
                    covariance[j, i] = covariance[i, j]
        for i in range(n):
            means[step, i] = mean[i]
            for j in range(n):
                covariances[step, i, j] = covariance[i, j]
