"""Covariance of sums of autocorrelated rows, from the rows themselves."""

from __future__ import annotations

import numpy as np

from ipmclab.run import FloatArray


def long_run(jacobian: FloatArray, residual: FloatArray) -> FloatArray:
    """Newey and West's sum of score covariances, with Andrews' bandwidth for an AR(1).

    Parameters
    ----------
    jacobian : float array, shape (n_readings, n)
    residual : float array, shape (n_readings,)
    """
    score = jacobian * residual[:, None]
    power = float(residual @ residual)
    neighbour = float(residual[1:] @ residual[:-1]) / power if power else 0.0
    neighbour = min(max(neighbour, -0.97), 0.97)
    alpha = 4.0 * neighbour**2 / (1.0 - neighbour**2) ** 2
    lags = min(len(residual) // 3, int(1.1447 * (alpha * len(residual)) ** (1.0 / 3.0)) + 1)
    total = score.T @ score
    for lag in range(1, lags + 1):
        weight = 1.0 - lag / (lags + 1.0)
        part = score[lag:].T @ score[:-lag]
        total = total + weight * (part + part.T)
    return np.asarray(total)
