"""What least squares would say under noise that is not white: sums of autocovariances, and a contradiction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identify.noise.pieces import Piece, Shape, directions_of
from ipmclab.identify.noise.terms import autoregression
from ipmclab.identify.problem import Evaluation, Problem

FloatArray = npt.NDArray[np.float64]

_REJECT: Final = 1e-3
_ROOM: Final = 0.1  # of the variance under the noise: what a model that bends adds to a distance


def contradicts(
    problem: Problem,
    here: Evaluation,
    pieces: Sequence[tuple[Piece, Shape]],
    step: FloatArray,
    covariance: FloatArray,
) -> bool:
    """Whether parameters under a noise lie where those of least squares cannot have come from (Hausman 1978).

    Under stationary noise both estimate the same, if the model is right: the covariance of what lies between them is
    that of least squares less that under the noise. If they lie further apart, what was taken for noise is what the
    model lacks.

    Parameters
    ----------
    problem : Problem
        Not whitened.
    here : Evaluation
        Of it, at its own minimum.
    pieces : sequence of (Piece, Shape)
        Without offset, trend and walk. All other readings have white noise.
    step : float array, shape (n_unknown,)
        From there to the solution under the noise.
    covariance : float array, shape (n_unknown, n_unknown)
        Of the solution under the noise.
    """
    from scipy.special import chdtrc

    directions = directions_of(here)
    turned = here.jacobian @ directions
    middle = np.eye(turned.shape[1])
    for piece, shape in pieces:
        own = turned[problem.pieces[piece.key]][piece.inside]
        middle += spread_by(own, piece.steps, shape) - own.T @ own
    # The directions have length 1 over their standard error under white noise, squared below.
    back = directions / np.sum(directions * directions, axis=0)
    under = back.T @ covariance @ back
    moved = back.T @ step
    values, vectors = np.linalg.eigh(middle - under)
    between = (vectors * np.maximum(values, 0.0)) @ vectors.T + _ROOM * under
    distance = float(moved @ np.linalg.lstsq(between, moved, rcond=1e-12)[0])
    return bool(chdtrc(len(moved), distance) < _REJECT)


def spread_by(columns: FloatArray, steps: npt.NDArray[np.int64], shape: Shape) -> FloatArray:
    """``columns' V columns`` for stationary noise of covariance V, by convolution with its autocovariances.

    Parameters
    ----------
    columns : float array, shape (n_readings, n)
    steps : int array, shape (n_readings,)
        Steps of time since the reading before.
    shape : Shape
        An autoregression, perhaps with white noise beside it.

    Examples
    --------
    >>> from ipmclab.identify.noise.terms import Terms
    >>> noise = Shape(Terms(order=1), np.array([np.arctanh(0.5)]), 1.0)
    >>> spread_by(np.array([[1.0], [1.0]]), np.array([1, 2]), noise).round(6).tolist()
    [[3.333333]]
    """
    places = np.cumsum(steps) - steps[0]
    count = int(places[-1]) + 1
    size = 1 << (2 * count - 1).bit_length()
    found = np.zeros(count)
    order = shape.terms.order
    if order:
        coefficients, covariances = autoregression(np.tanh(shape.entries[:order]))
        found[: min(order, count)] = covariances[:count]
        for lag in range(order, count):
            found[lag] = coefficients @ found[lag - order : lag][::-1]
        found[0] += np.exp(2.0 * shape.entries[-1]) if shape.terms.white else 0.0
    else:
        found[0] = 1.0
    around = np.zeros(size)
    around[:count] = found
    around[size - count + 1 :] = found[:0:-1]
    spectrum = np.fft.rfft(around).real
    regular = np.zeros((count, columns.shape[1]))
    regular[places] = columns
    seen = np.fft.irfft(np.fft.rfft(regular, size, axis=0) * spectrum[:, None], size, axis=0)[:count]
    return np.asarray(shape.variance * (regular.T @ seen))


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
