"""Poles and eigenvectors of a cascade, stage by stage.

What follows in a cascade drives nothing before it, so that its matrix is block lower triangular and its poles are those
of the blocks. Found in the whole matrix, a pole is as sure as rounding of its largest entry leaves it: beside a beam
that swings, nothing is left of a charge that leaks away over hours. Found in its block, it is as sure as that allows;
of two states, as most stages have, by the quadratic equation, to the digits of their product. With the blocks' own
eigenvectors as coordinates the matrix is diagonal but for what couples the blocks, and its eigenvectors follow by
substitution (Golub and Van Loan, Matrix Computations, 2013, section 7.6.3).
"""

from __future__ import annotations

import cmath
import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

_EPS: Final = float(np.finfo(np.float64).eps)


class Eigenvectors(NamedTuple):
    """``matrix = right diag(poles) left``, with ``left right = 1``.

    Parameters
    ----------
    poles : complex array, shape (n,)
    right : complex array, shape (n, n)
        Each a column.
    left : complex array, shape (n, n)
        Each a row.
    rounding : float array, shape (n,)
        What rounding of its block may move each pole by.
    """

    poles: ComplexArray
    right: ComplexArray
    left: ComplexArray
    rounding: FloatArray


def eigenvectors(matrix: FloatArray) -> Eigenvectors | None:
    """The poles of a matrix and its eigenvectors; None where they cannot be found.

    Parameters
    ----------
    matrix : float array, shape (n, n)
        Finite.

    Examples
    --------
    >>> found = eigenvectors(np.array([[-1e-9, 0.0], [1.0, -1e9]]))
    >>> found.poles.real.tolist()
    [-1e-09, -1000000000.0]
    >>> bool(abs((found.right * found.poles) @ found.left - [[-1e-9, 0.0], [1.0, -1e9]]).max() < 1e-15)
    True
    """
    n = len(matrix)
    poles = np.empty(n, dtype=np.complex128)
    own, own_left = np.zeros((2, n, n), dtype=np.complex128)
    rounding = np.empty(n)
    blocks = _blocks(matrix)
    try:
        for block in blocks:
            part = matrix[block, block]
            if len(part) == 2:
                poles[block], own[block, block], rounding[block] = _of_two(part)
            else:
                poles[block], own[block, block] = np.linalg.eig(part)
                rounding[block] = _EPS * np.linalg.norm(part)
            own_left[block, block] = np.linalg.inv(own[block, block])
    except np.linalg.LinAlgError:
        return None
    if len(blocks) == 1:
        return Eigenvectors(poles, own, own_left, rounding)
    coupling = own_left @ matrix @ own
    unit, inverse = np.eye(n, dtype=np.complex128), np.eye(n, dtype=np.complex128)
    with np.errstate(divide="ignore", invalid="ignore"):
        for block in blocks[1:]:
            before = slice(0, block.start)
            driven = coupling[block, before] @ unit[before, before]
            # What is not driven has its own eigenvectors, wherever its poles are: stages side by side may share theirs.
            unit[block, before] = np.where(driven == 0.0, 0.0, driven / (poles[before] - poles[block, None]))
            inverse[block, before] = -unit[block, before] @ inverse[before, before]
    if not np.all(np.isfinite(unit)):
        return None  # of poles that meet there are too few eigenvectors
    return Eigenvectors(poles, own @ unit, inverse @ own_left, rounding)


def _of_two(block: FloatArray) -> tuple[list[complex], list[list[complex]], list[float]]:
    """Poles, eigenvectors and rounding of two states: the larger pole, and the product of both over it."""
    (a, b), (c, d) = block.tolist()
    middle, product = 0.5 * (a + d), a * d - b * c
    apart = (0.5 * (a - d)) ** 2 + b * c
    root = cmath.sqrt(apart)
    if root == 0.0:
        raise np.linalg.LinAlgError("poles that meet have too few eigenvectors")
    large = middle - root if middle < 0.0 else middle + root
    small = large.conjugate() if apart < 0.0 else product / large
    of_large = _EPS * (abs(large) + ((0.5 * (a - d)) ** 2 + abs(b * c)) / abs(root))
    of_small = of_large if apart < 0.0 else (_EPS * (abs(a * d) + abs(b * c)) + abs(small) * of_large) / abs(large)
    vectors = []
    for pole in (large, small):
        # Of the two ways to write it, the one that subtracts what lies farther apart.
        one, other = (b, pole - a) if abs(pole - a) >= abs(pole - d) else (pole - d, c)
        length = math.hypot(abs(one), abs(other))
        vectors.append((one / length, other / length))
    return [large, small], [list(row) for row in zip(*vectors, strict=True)], [of_large, of_small]


def _blocks(matrix: FloatArray) -> list[slice]:
    """The smallest blocks along the diagonal above which there is nothing."""
    n = len(matrix)
    # How far to the right the rows up to each have an entry.
    reach = np.maximum.accumulate(np.where(matrix != 0.0, np.arange(n), 0).max(axis=1, initial=0))
    ends = np.flatnonzero(reach <= np.arange(n)) + 1
    return [slice(int(start), int(end)) for start, end in zip(np.append(0, ends[:-1]), ends, strict=True)]
