"""Poles and eigenvectors of a cascade, stage by stage.

What follows in a cascade drives nothing before it, so that its matrix is block lower triangular and its poles are those
of the blocks. Found in the whole matrix, a pole is as sure as rounding of its largest entry leaves it: beside a beam
that swings, nothing is left of a charge that leaks away over hours. Found in its block, it is as sure as that allows;
of two states, as most stages have, by the quadratic equation, to the digits of their product. With the blocks' own
eigenvectors as coordinates the matrix is diagonal but for what couples the blocks, and its eigenvectors follow by
substitution (Golub and Van Loan, Matrix Computations, 2013, section 7.6.3).
"""

from __future__ import annotations

import itertools
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
IndexArray = npt.NDArray[np.int64]

_EPS: Final = float(np.finfo(np.float64).eps)
_SMALL: Final = 2  # states of a block whose poles need no search


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
    from ipmclab.model.numerics.eigenvectors_loop import of_small_blocks, substitute

    n = len(matrix)
    poles, rounding = np.empty(n, dtype=np.complex128), np.empty(n)
    own, own_left, unit, inverse = np.zeros((4, n, n), dtype=np.complex128)
    ends = _ends(matrix)
    if not of_small_blocks(matrix, ends, poles, own, own_left, rounding):
        return None
    try:
        for begin, end in itertools.pairwise([0, *ends.tolist()]):
            if end - begin > _SMALL:
                block = slice(begin, end)
                poles[block], own[block, block] = np.linalg.eig(matrix[block, block])
                own_left[block, block] = np.linalg.inv(own[block, block])
                rounding[block] = _EPS * np.linalg.norm(matrix[block, block])
    except np.linalg.LinAlgError:
        return None
    np.fill_diagonal(unit, 1.0)
    np.fill_diagonal(inverse, 1.0)
    if not substitute(own_left @ matrix @ own, ends, poles, unit, inverse) or not np.all(np.isfinite(unit)):
        return None
    return Eigenvectors(poles, own @ unit, inverse @ own_left, rounding)


def _ends(matrix: FloatArray) -> IndexArray:
    """Where the smallest diagonal blocks end that have only zeros to their right."""
    n = len(matrix)
    # How far to the right the rows up to each have an entry.
    reach = np.maximum.accumulate(np.where(matrix != 0.0, np.arange(n), 0).max(axis=1, initial=0))
    return np.flatnonzero(reach <= np.arange(n)) + 1
