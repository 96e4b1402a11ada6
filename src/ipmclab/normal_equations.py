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


def inverse(products: FloatArray) -> FloatArray:
    """The inverse of a symmetric matrix that says something of every direction, however little.

    No eigenvalue of that of columns of length 1 is taken to be below ``ROUNDING``.
    """
    found, _ = root_of_inverse(products)
    return np.asarray(found @ found.T)


def root_of_inverse(products: FloatArray) -> tuple[FloatArray, float]:
    """A matrix whose product with its transpose is that inverse, and the log determinant of what was inverted."""
    size = np.sqrt(np.maximum(products.diagonal(), 0.0))
    size[size == 0.0] = 1.0
    values, vectors = np.linalg.eigh(products / np.outer(size, size))
    values = np.maximum(values, ROUNDING)
    return vectors / np.sqrt(values) / size[:, None], float(np.sum(np.log(values)) + 2.0 * np.sum(np.log(size)))


def root(covariance: FloatArray) -> FloatArray:
    """A matrix whose product with its transpose is a covariance: what rounding takes below zero is zero.

    Examples
    --------
    >>> found = root(np.array([[4.0, 4.0], [4.0, 4.0]]))
    >>> (found @ found.T).round(12)
    array([[4., 4.],
           [4., 4.]])
    """
    sizes = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    some = np.where(sizes > 0.0, sizes, 1.0)
    values, vectors = np.linalg.eigh(covariance / some / some[:, None])
    return np.asarray(sizes[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


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
