"""What least squares would say under noise that nobody describes: sums of autocovariances, and a contradiction."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identify.noise.pieces import directions_of
from ipmclab.identify.problem import Evaluation, Problem

FloatArray = npt.NDArray[np.float64]

_REJECT: Final = 1e-3


def contradicts(problem: Problem, here: Evaluation, step: FloatArray) -> bool:
    """Whether parameters under a noise lie where those of least squares cannot have come from (Hausman 1978).

    Under noise without drift both estimate the same, if the model is right. If they lie apart by more than the robust
    error of least squares, what was taken for noise is what the model lacks.

    Parameters
    ----------
    problem : Problem
        Not whitened.
    here : Evaluation
        Of it, at its own minimum.
    step : float array, shape (n_unknown,)
        From there to the solution under the noise.
    """
    from scipy.special import chdtrc

    directions = directions_of(here)
    turned = here.jacobian @ directions
    begin = max((piece.stop for piece in problem.pieces.values()), default=0)
    middle = turned[begin:].T @ turned[begin:]
    for piece in problem.pieces.values():
        middle += long_run(turned[piece], here.residual[piece])
    # The directions have length 1 over their standard error under white noise, squared below.
    moved = directions.T @ step / np.sum(directions * directions, axis=0)
    distance = float(moved @ np.linalg.lstsq(middle, moved, rcond=1e-12)[0])
    return bool(chdtrc(len(moved), distance) < _REJECT)


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
