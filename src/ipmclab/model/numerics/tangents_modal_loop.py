"""The compiled loop over what each pole answers to a voltage, and the slope of that by the pole."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
IndexArray = npt.NDArray[np.int64]


@kernel
def pole_answers(
    decay: ComplexArray,
    held: ComplexArray,
    ramped: ComplexArray,
    d_decay: ComplexArray,
    d_held: ComplexArray,
    d_ramped: ComplexArray,
    interval: IndexArray,
    start: FloatArray,
    end: FloatArray,
    row: IndexArray,
    first: float,
    answers: ComplexArray,
) -> None:
    """What each pole answers at each row, and its slope by the pole.

    Parameters
    ----------
    decay, held, ramped, d_decay, d_held, d_ramped : complex arrays, shape (n_kinds, n_poles)
        ``s+ = decay s + held u0 + ramped (u1 - u0)``, and the derivatives of the three by the pole.
    interval, start, end, row : arrays
        As in ``kernels.dense_tangents``.
    first : float
        The answer before the first interval.
    answers : complex array, shape (n_time, 2 n_poles)
        Written: the answers, then their slopes.
    """
    n = decay.shape[1]
    s, slope = np.full(n, first + 0j), np.zeros(n, np.complex128)
    for i in range(row.shape[0]):
        k = row[i]
        if k >= 0:
            for j in range(n):
                answers[k, j] = s[j]
                answers[k, n + j] = slope[j]
        if i < interval.shape[0]:
            m = interval[i]
            u, du = start[i], end[i] - start[i]
            for j in range(n):
                slope[j] = decay[m, j] * slope[j] + (d_decay[m, j] * s[j] + (d_held[m, j] * u + d_ramped[m, j] * du))
                s[j] = decay[m, j] * s[j] + (held[m, j] * u + ramped[m, j] * du)
