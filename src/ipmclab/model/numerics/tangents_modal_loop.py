"""The compiled loop over what each pole answers to a voltage, and the slope of that by the pole."""

from __future__ import annotations

import cmath

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
IndexArray = npt.NDArray[np.int64]


_SERIES = 0.5
_TERMS = 16  # 0.5^16/16! is below 1e-18


@kernel
def series(x: complex, order: int) -> tuple[complex, complex]:
    """The sum of x^k/(k + order)!, and its derivative."""
    term = 1.0 + 0j
    for k in range(2, order + 1):
        term /= k
    total, slope = term, 0j
    for k in range(1, _TERMS + 1):
        slope += term * (k / (k + order))
        term *= x / (k + order)
        total += term
    return total, slope


@kernel
def pole_moves(poles: ComplexArray, durations: FloatArray, driven: float, moves: ComplexArray) -> None:
    """What an interval of each kind does to an answer: ``s+ = decay s + held u0 + ramped (u1 - u0)``.

    Parameters
    ----------
    poles : complex array, shape (n_poles,) [1/s]
    durations : float array, shape (n_kinds,) [s]
    driven : float
        1 with a voltage, 0 without one.
    moves : complex array, shape (6, n_kinds, n_poles)
        Written: decay, held and ramped, then the derivatives of the three by the pole.
    """
    for m in range(len(durations)):
        length = durations[m]
        square = driven * length * length
        for j in range(len(poles)):
            x = poles[j] * length
            decay = cmath.exp(x)
            if abs(x) < _SERIES:
                first, d_first = series(x, 1)
                second, d_second = series(x, 2)
            else:  # (e^x - 1)/x and (e^x - 1 - x)/x^2, and their derivatives
                first = (decay - 1.0) / x
                second = (first - 1.0) / x
                d_first = (decay - first) / x
                d_second = (d_first - second) / x
            moves[0, m, j], moves[1, m, j], moves[2, m, j] = decay, driven * length * first, driven * length * second
            moves[3, m, j], moves[4, m, j], moves[5, m, j] = length * decay, square * d_first, square * d_second


@kernel
def pole_courses(
    real: FloatArray,
    pairs: ComplexArray,
    places: tuple[IndexArray, IndexArray, IndexArray],
    interval: IndexArray,
    start: FloatArray,
    end: FloatArray,
    row: IndexArray,
    first: float,
    courses: FloatArray,
) -> None:
    """What each pole answers at each row, and its slope by the pole, as real courses: real poles and pairs apart.

    Parameters
    ----------
    real : float array, shape (6, n_kinds, n_real)
        As ``pole_moves`` writes them, of the real poles.
    pairs : complex array, shape (6, n_kinds, n_pairs)
        Of the others: of a pair the one above the real axis, as the other answers the conjugate.
    places : three int arrays, shapes (n_real,), (n_pairs,), (n_pairs,)
        Where the answers of each stand in the courses, and the imaginary parts of the pairs.
    interval, start, end, row : arrays
        As in ``timeline.Timeline``.
    first : float
        The answer before the first interval.
    courses : float array, shape (2 (n_real + n_pairs) + 2 n_pairs, n_time)
        Written: the real parts of the answers, of their slopes, then the imaginary ones.
    """
    of_real, of_pairs, imaginary = places
    n, m = len(of_real), len(of_pairs)
    s, slope = np.full(n, first), np.zeros(n)
    z, turn = np.full(m, first + 0j), np.zeros(m, np.complex128)
    for i in range(row.shape[0]):
        k = row[i]
        if k >= 0:
            for j in range(n):
                courses[of_real[j], k] = s[j]
                courses[n + m + of_real[j], k] = slope[j]
            for j in range(m):
                courses[of_pairs[j], k], courses[imaginary[j], k] = z[j].real, z[j].imag
                courses[n + m + of_pairs[j], k], courses[m + imaginary[j], k] = turn[j].real, turn[j].imag
        if i < interval.shape[0]:
            kind = interval[i]
            u, du = start[i], end[i] - start[i]
            for j in range(n):
                driven = real[4, kind, j] * u + real[5, kind, j] * du
                slope[j] = real[0, kind, j] * slope[j] + (real[3, kind, j] * s[j] + driven)
                s[j] = real[0, kind, j] * s[j] + (real[1, kind, j] * u + real[2, kind, j] * du)
            for j in range(m):
                pull = pairs[4, kind, j] * u + pairs[5, kind, j] * du
                turn[j] = pairs[0, kind, j] * turn[j] + (pairs[3, kind, j] * z[j] + pull)
                z[j] = pairs[0, kind, j] * z[j] + (pairs[1, kind, j] * u + pairs[2, kind, j] * du)
