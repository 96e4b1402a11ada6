"""Normal equations that may be singular, solved with the rank that rounding leaves: no finite ones fail.

Columns are compared at length 1. A direction whose eigenvalue is below ``ROUNDING`` times the largest is one of which
the equations say nothing: the answer does not move along it.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

ROUNDING: Final = 1e-14
"""Of the eigenvalues of products of columns of length 1: below it they are rounding, whatever the columns are."""

_LEAST: Final = 1e-30  # of the largest diagonal element: a column as small as that is one of zeros
_TINY: Final = 1e-200


def pseudo_inverse(matrix: FloatArray) -> FloatArray:
    """The pseudo-inverse of a symmetric matrix without negative eigenvalues.

    Parameters
    ----------
    matrix : float array, shape (n, n)
        Finite.

    Examples
    --------
    >>> pseudo_inverse(np.array([[4.0, 4.0], [4.0, 4.0]]))
    array([[0.0625, 0.0625],
           [0.0625, 0.0625]])
    """
    scale = lengths(matrix.diagonal())
    values, vectors = np.linalg.eigh(matrix / (scale[:, None] * scale))
    kept = values > ROUNDING * values.max(initial=0.0)
    turned = vectors[:, kept] / scale[:, None]
    return np.asarray((turned / values[kept]) @ turned.T)


def damped_step(matrix: FloatArray, right: FloatArray, damping: float, sizes: FloatArray) -> FloatArray:
    """A step of Levenberg and Marquardt: the answer of ``(matrix + damping * diag(sizes)) @ step = right``.

    Rounding may have made eigenvalues of the matrix negative: they count as zero.

    Parameters
    ----------
    damping : float
        Above zero.
    sizes : float array, shape (n,)
        Squared lengths of the columns.
    """
    scale = lengths(sizes)
    values, vectors = np.linalg.eigh(matrix / (scale[:, None] * scale))
    return np.asarray(vectors @ ((vectors.T @ (right / scale)) / (np.maximum(values, 0.0) + damping)) / scale)


def lengths(squares: FloatArray) -> FloatArray:
    """Lengths of columns, none of them zero."""
    return np.asarray(np.sqrt(np.maximum(squares, _LEAST * float(squares.max(initial=0.0)) + _TINY)))
