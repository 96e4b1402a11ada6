"""The compiled loops over the blocks of a cascade: poles of one and two states, and the substitution."""

from __future__ import annotations

import cmath
import math

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
IndexArray = npt.NDArray[np.int64]

_EPS = 2.0**-52


@kernel
def of_small_blocks(
    matrix: FloatArray,
    ends: IndexArray,
    poles: ComplexArray,
    own: ComplexArray,
    left: ComplexArray,
    rounding: FloatArray,
) -> bool:
    """Poles, eigenvectors, their inverse and rounding of the blocks of one and of two states.

    Of two states the larger pole, and the product of both over it.

    Parameters
    ----------
    matrix : float array, shape (n, n)
    ends : int array, shape (n_blocks,)
        Where each block ends.
    poles, own, left, rounding : arrays, shapes (n,), (n, n), (n, n), (n,)
        Written where blocks are so small.

    Returns
    -------
    found : bool
        False where the poles of a block meet: there are too few eigenvectors.
    """
    begin = 0
    for end in ends:
        i, k = begin, begin + 1
        begin = end
        if end - i == 1:
            poles[i], own[i, i], left[i, i], rounding[i] = matrix[i, i], 1.0, 1.0, _EPS * abs(matrix[i, i])
        if end - i != 2:
            continue
        a, b, c, d = matrix[i, i], matrix[i, k], matrix[k, i], matrix[k, k]
        middle, product, half = 0.5 * (a + d), a * d - b * c, 0.5 * (a - d)
        apart = half**2 + b * c
        root = cmath.sqrt(apart + 0j)
        if root == 0.0:
            return False
        large = middle - root if middle < 0.0 else middle + root
        small = large.conjugate() if apart < 0.0 else product / large
        of_large = _EPS * (abs(large) + (half**2 + abs(b * c)) / abs(root))
        poles[i], poles[k], rounding[i], rounding[k] = large, small, of_large, of_large
        if apart >= 0.0:
            rounding[k] = (_EPS * (abs(a * d) + abs(b * c)) + abs(small) * of_large) / abs(large)
        for j in range(i, end):
            pole = poles[j]
            # Of the two ways to write it, the one that subtracts what lies farther apart.
            if abs(pole - a) >= abs(pole - d):
                one, other = b + 0j, pole - a
            else:
                one, other = pole - d, c + 0j
            length = math.hypot(abs(one), abs(other))
            own[i, j], own[k, j] = one / length, other / length
        volume = own[i, i] * own[k, k] - own[i, k] * own[k, i]
        left[i, i], left[k, k] = own[k, k] / volume, own[i, i] / volume
        left[i, k], left[k, i] = -own[i, k] / volume, -own[k, i] / volume
    return True


@kernel
def substitute(
    coupling: ComplexArray, ends: IndexArray, poles: ComplexArray, unit: ComplexArray, inverse: ComplexArray
) -> bool:
    """Eigenvectors, and their inverse, of a cascade whose blocks are diagonal.

    Parameters
    ----------
    coupling : complex array, shape (n, n)
        What the states of each block are driven by from those before it.
    ends : int array, shape (n_blocks,)
        Where each block ends.
    poles : complex array, shape (n,)
    unit, inverse : complex array, shape (n, n)
        Given as 1 on the diagonal and 0 elsewhere, and written.

    Returns
    -------
    found : bool
        False where poles meet that drive each other: there are too few eigenvectors.
    """
    begin = 0
    for end in ends:
        for i in range(begin, end):
            for j in range(begin):
                driven = 0j
                for k in range(j, begin):
                    driven += coupling[i, k] * unit[k, j]
                # What is not driven has its own eigenvectors, wherever its poles are: stages side by side may share
                # theirs.
                if driven == 0.0:
                    continue
                if poles[i] == poles[j]:
                    return False
                unit[i, j] = driven / (poles[j] - poles[i])
            for j in range(begin):
                total = 0j
                for k in range(j, begin):
                    total += unit[i, k] * inverse[k, j]
                inverse[i, j] = -total
        begin = end
    return True
