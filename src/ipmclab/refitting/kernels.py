"""Compiled loop of many fits side by side: the products of which their Gauss-Newton steps are made."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel
from ipmclab.model.numerics.poles_loop import ramp_weights

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

ROWS_AT_ONCE = 256
"""Rows whose responses are made before their products: 12 kB of a circuit with two branches, in the first cache."""

_BESIDE = 8  # sums of each product, so that a compiler takes as many rows at once


@kernel
def pole_products(
    durations: FloatArray,
    kind: IndexArray,
    start: FloatArray,
    end: FloatArray,
    present: FloatArray,
    poles: FloatArray,
    direct: FloatArray,
    residues: FloatArray,
    weight: float,
    readings: FloatArray,
    chosen: IndexArray,
    products: FloatArray,
) -> None:
    """Products, over the rows of one run, of all that enters a step of Gauss and Newton, for many fits.

    That is: the input, the responses of ``pole_response``, their derivatives times the residues, and the residual of
    the current, which alone is weighted.

    Parameters
    ----------
    durations, kind, start, end : as in ``pole_response``
    present : float array, shape (n_row,)
        The input as read at each row; rows and steps are as many, the last row has none.
    poles, residues : float array, shape (n_fit, n_pole) [1/s, S/s]
    direct : float array, shape (n_fit,) [S]
    weight : float [1/A]
    readings : float array, shape (n_any, n_row)
        Weighted.
    chosen : int array, shape (n_fit,)
        Which of them each fit has.
    products : float array, shape (n_fit, 2 + 2 n_pole, 2 + 2 n_pole)
        Written.
    """
    count, rows = poles.shape[1], len(present)
    size = 2 + 2 * count
    beside = np.empty((size, ROWS_AT_ONCE))
    sums = np.empty((size, size, _BESIDE))
    weights = np.empty((len(durations), count, 6))
    state, slope = np.empty(count), np.empty(count)
    for fit in range(len(poles)):
        for m in range(len(durations)):
            for j in range(count):
                decay, first, second, first_slope, second_slope = ramp_weights(durations[m], poles[fit, j])
                weights[m, j, 0], weights[m, j, 1], weights[m, j, 2] = decay, first, second
                weights[m, j, 3], weights[m, j, 4], weights[m, j, 5] = durations[m] * decay, first_slope, second_slope
        read = readings[chosen[fit]]
        state[:] = 0.0
        slope[:] = 0.0
        sums[:] = 0.0
        for begin in range(0, rows, ROWS_AT_ONCE):
            here = min(ROWS_AT_ONCE, rows - begin)
            for k in range(here):
                beside[0, k] = present[begin + k]
                beside[size - 1, k] = direct[fit] * present[begin + k]
            for j in range(count):
                x, dx, residue = state[j], slope[j], residues[fit, j]
                for k in range(here):
                    beside[1 + j, k] = x
                    beside[1 + count + j, k] = residue * dx
                    if begin + k < rows - 1:
                        m, u, v = kind[begin + k], start[begin + k], end[begin + k]
                        dx = weights[m, j, 0] * dx + (
                            weights[m, j, 3] * x + (weights[m, j, 4] * u + weights[m, j, 5] * v)
                        )
                        x = weights[m, j, 0] * x + (weights[m, j, 1] * u + weights[m, j, 2] * v)
                state[j], slope[j] = x, dx
                for k in range(here):
                    beside[size - 1, k] += residue * beside[1 + j, k]
            for k in range(here):
                beside[size - 1, k] = beside[size - 1, k] * weight - read[begin + k]
            whole = -(-here // _BESIDE) * _BESIDE
            beside[:, here:whole] = 0.0
            for one in range(size):
                for other in range(one + 1):
                    for k in range(0, whole, _BESIDE):
                        for i in range(_BESIDE):
                            sums[one, other, i] += beside[one, k + i] * beside[other, k + i]
        for one in range(size):
            for other in range(one + 1):
                total = 0.0
                for i in range(_BESIDE):
                    total += sums[one, other, i]
                products[fit, one, other] = total
                products[fit, other, one] = total
