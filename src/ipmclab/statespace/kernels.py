"""Compiled loops: the Kalman filter that whitens columns by a noise, and what a likelihood needs of them."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel
from ipmclab.normal_equations import ROUNDING

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

_STEADY = 1e-14  # of a gain: as far as rounding lets it settle (derived)

_SETTLED = 1e-10  # of a variance: what is searched over it is then smooth far below what the readings show

_ROUNDING = ROUNDING  # of a column's square: less than that is not left of it after other columns


@kernel
def continued(coefficients: FloatArray, before: FloatArray, driven: FloatArray) -> FloatArray:
    """An autoregression that is driven, after some values of it, the latest first."""
    order = len(coefficients)
    found = np.empty(order + len(driven))
    for k in range(order):
        found[k] = before[order - 1 - k]
    for k in range(len(driven)):
        value = driven[k]
        for j in range(order):
            value += coefficients[j] * found[order + k - 1 - j]
        found[order + k] = value
    return found[order:]


@kernel
def whiten(
    columns: FloatArray,
    steps: IndexArray,
    kinds: IndexArray,
    transitions: FloatArray,
    drives: FloatArray,
    seen: FloatArray,
    reading: float,
    start: FloatArray,
    variances: FloatArray,
) -> float:
    """Turn correlated rows into independent ones of variance 1: a Kalman filter, with one gain for all columns.

    The noise is ``seen' x`` plus white noise of variance ``reading``, with x stepping by a transition and driven by
    noise; time may continue by steps of several kinds. What the filter does not foresee of a column, over its standard
    deviation, is the column multiplied by the inverse of the Cholesky factor of the noise's covariance.

    Parameters
    ----------
    columns : float array, shape (n_readings, n_columns)
        Overwritten.
    steps : int array, shape (n_readings,)
        How many steps of time each reading comes after the one before it: more than 1 where readings are missing.
    kinds : int array, shape (n_readings,)
        Of which kind these steps are.
    transitions, drives : float array, shape (n_kinds, n, n)
        Of one step of each kind; a drive is the covariance of the noise that drives x meanwhile.
    seen : float array, shape (n,)
    reading : float
    start : float array, shape (n, n)
        Covariance of x at the first reading.
    variances : float array, shape (n_readings,)
        Where that of each reading, given those before it, is written.

    Returns
    -------
    log_determinant : float
        Of the noise's covariance.
    """
    count, width = columns.shape
    n = len(seen)
    spread = start.copy()
    before = np.empty((n, n))
    moved = np.empty((n, n))
    along, gain = np.zeros(n), np.zeros(n)
    state, onward = np.zeros((n, width)), np.zeros((n, width))
    foreseen = np.empty(width)
    variance, scale, logarithm, total = 1.0, 1.0, 0.0, 0.0
    if count == 0:
        return total
    steady, kind = False, kinds[0]
    transition, drive = transitions[kind], drives[kind]
    for t in range(count):
        ahead = steps[t] if t > 0 else 0
        if kinds[t] != kind:
            kind, steady = kinds[t], False
            transition, drive = transitions[kind], drives[kind]
        if not (steady and ahead == 1):
            for i in range(n):
                for j in range(n):
                    before[i, j] = spread[i, j]
            for _ in range(ahead):
                for i in range(n):
                    for j in range(n):
                        moved[i, j] = 0.0
                    for k in range(n):
                        if transition[i, k] != 0.0:
                            for j in range(n):
                                moved[i, j] += transition[i, k] * spread[k, j]
                for i in range(n):
                    for j in range(i + 1):
                        value = drive[i, j]
                        for k in range(n):
                            value += moved[i, k] * transition[j, k]
                        spread[i, j] = value
                        spread[j, i] = value
            variance = reading
            for i in range(n):
                along[i] = 0.0
                for j in range(n):
                    along[i] += spread[i, j] * seen[j]
                variance += seen[i] * along[i]
            for i in range(n):
                gain[i] = along[i] / variance
            largest, change = 0.0, 0.0
            for i in range(n):
                for j in range(i + 1):
                    value = spread[i, j] - along[i] * gain[j]
                    spread[i, j] = value
                    spread[j, i] = value
                    change = max(change, abs(value - before[i, j]))
                    largest = max(largest, abs(value))
            steady = ahead == 1 and change <= _STEADY * (largest + variance)
            scale, logarithm = 1.0 / math.sqrt(variance), math.log(variance)
        total += logarithm
        variances[t] = variance
        if n == 1 and ahead == 1:  # most rows of most noises: as below, in fewer steps
            for c in range(width):
                moved_on = transition[0, 0] * state[0, c]
                missed = columns[t, c] - seen[0] * moved_on
                state[0, c] = moved_on + gain[0] * missed
                columns[t, c] = missed * scale
            continue
        for _ in range(ahead):
            for i in range(n):
                for c in range(width):
                    onward[i, c] = 0.0
                for k in range(n):
                    weight = transition[i, k]
                    if weight != 0.0:
                        for c in range(width):
                            onward[i, c] += weight * state[k, c]
            for i in range(n):
                for c in range(width):
                    state[i, c] = onward[i, c]
        for c in range(width):
            foreseen[c] = columns[t, c]
        for i in range(n):
            if seen[i] != 0.0:
                for c in range(width):
                    foreseen[c] -= seen[i] * state[i, c]
        for i in range(n):
            for c in range(width):
                state[i, c] += gain[i] * foreseen[c]
        for c in range(width):
            columns[t, c] = foreseen[c] * scale
    return total


@kernel
def eliminate(products: FloatArray, held: int) -> float:
    """Project the first ``held`` columns out of the products of all, in place.

    Gaussian elimination without pivots, of a symmetric matrix; the last column, the residual's, may come next. What
    is left of a column is never less than ``_ROUNDING`` of its square.

    Returns
    -------
    log_determinant : float
        Of the products of the held columns.
    """
    n, total = len(products), 0.0
    least = np.empty(n)
    for k in range(n):
        least[k] = _ROUNDING * products[k, k]
    for k in range(held):
        pivot = products[k, k]
        if pivot == 0.0:
            continue  # a column of zeros
        total += math.log(pivot)
        for i in range(k + 1, n):
            factor = products[i, k] / pivot
            for j in range(k + 1, n):
                products[i, j] -= factor * products[k, j]
            products[i, i] = max(products[i, i], least[i])
    return total


@kernel
def restricted(
    levels: FloatArray, own: FloatArray, others: FloatArray, freedom: float, variance: float
) -> tuple[float, float, float]:
    """The scale of the noise of some readings, given what all others know of the same directions.

    Both are given in directions that others know to a standard error of 1 each, square to each other for both.

    Parameters
    ----------
    levels : float array, shape (n,)
        What these readings know of each direction, in units of the scale sought: squares of whitened columns.
    own, others : float array, shape (n + 1,)
        Products of the directions and the residual, and last the square of the residual: of these readings, in units of
        the scale sought, and of all others.
    freedom : float
        Number of these readings, less the constants of their own.
    variance : float
        Where the search starts.

    Returns
    -------
    variance : float
        That at which the readings miss by as much as they may, given what the fit takes of their freedom: the
        stationary point of the restricted likelihood.
    misfit : float
        Weighted squares that are left.
    log_determinant : float
        Of the normal equations, in these directions.
    """
    n = len(levels)
    misfit, logarithm = 0.0, 0.0
    for turn in range(40):
        misfit, logarithm = others[n] + own[n] / variance, 0.0
        missed, taken = own[n], 0.0
        for i in range(n):
            total = 1.0 + levels[i] / variance
            right = others[i] + own[i] / variance
            answer = right / total
            logarithm += math.log(total)
            misfit -= right * answer
            missed += answer * (answer * levels[i] - 2.0 * own[i])
            taken += levels[i] / total
        found = max(missed / max(freedom - taken / variance, 1.0), 1e-12)
        if abs(found - variance) < _SETTLED * found or turn == 39:
            break
        variance = found
    return variance, misfit, logarithm
