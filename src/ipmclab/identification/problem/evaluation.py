"""Weighted residuals and their derivatives at one point, what linear algebra makes of them, and what can give them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from ipmclab.run import FloatArray

Mask = npt.NDArray[np.bool_]

INDEPENDENT: Final = 1e-3  # part of a scaled column that the ones before it do not imitate
_MULTIPLIED: Final = 1_000_000  # multiplications, up to which OpenBLAS takes matrices as they lie


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Weighted residuals (model minus reading, over noise) and their derivatives at one vector.

    Parameters
    ----------
    rows : float array, shape (n_unknown + 1, n_residual)
        The derivative with respect to each unknown, and last the residual.
    beforehand : int
        How many of the residuals, the last ones, are of what was known beforehand.
    """

    rows: FloatArray
    beforehand: int = 0

    @property
    def residual(self) -> FloatArray:
        """Weighted residuals, shape (n_residual,)."""
        return np.asarray(self.rows[-1])

    @property
    def of_readings(self) -> FloatArray:
        """Those of them that are no knowledge from beforehand, shape (n_residual - beforehand,)."""
        return self.residual[: len(self.residual) - self.beforehand]

    @property
    def jacobian(self) -> FloatArray:
        """Their derivatives, shape (n_residual, n_unknown)."""
        return self.rows[:-1].T

    @cached_property
    def cost(self) -> float:
        """Weighted sum of squares."""
        with np.errstate(over="ignore"):
            return float(self.residual @ self.residual)

    @property
    def per_residual(self) -> float:
        """The same of each of them, on average."""
        return self.cost / max(len(self.residual), 1)

    @cached_property
    def triangle(self) -> FloatArray:
        """R of the QR decomposition of the Jacobian with the residual as its last column.

        It holds all that a step, a rank or a covariance needs. Where the columns are well apart the Cholesky
        factor of their products is the same in a tenth of the time. It is square however few the residuals are:
        a row that they do not fill is zero.
        """
        products = np.empty((len(self.rows), len(self.rows)))
        # A search may try values at which squares overflow: then there is no factor.
        with np.errstate(over="ignore", invalid="ignore"):
            products[:-1] = sum(self.rows[:-1, some] @ self.rows[:, some].T for some in self._stretches)
            products[-1, :-1] = products[:-1, -1]
            products[-1, -1] = self.cost
            size = np.sqrt(np.maximum(products.diagonal(), 1e-300))
            try:
                factor = np.linalg.cholesky(products / (size[:, None] * size))
            except np.linalg.LinAlgError:
                factor = np.zeros_like(products)
        if factor.diagonal().min() > INDEPENDENT:
            return np.asarray(factor.T * size)
        from scipy.linalg.lapack import dgeqrf

        # The rows lie as LAPACK wants them: NumPy's function would turn them twice, in four times the time.
        found = np.triu(dgeqrf(self.rows.T)[0][: len(self.rows)])
        products[: len(found)], products[len(found) :] = found, 0.0
        return products

    @property
    def _stretches(self) -> list[slice]:
        """The residuals, so many together that OpenBLAS multiplies them in place: more take it twice the time each."""
        total, some = self.rows.shape[1], max(_MULTIPLIED // len(self.rows) ** 2, 1)
        return [slice(begin, begin + some) for begin in range(0, max(total, 1), some)]

    @cached_property
    def spectrum(self) -> tuple[FloatArray, FloatArray]:
        """Singular values of the Jacobian, largest first, and the directions that they belong to, one a row."""
        columns = len(self.rows) - 1
        _, singular, directions = np.linalg.svd(self.triangle[:columns, :columns])
        return singular, directions

    @cached_property
    def scaled_spectrum(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """The same with columns of length 1; then the residual, turned as they are, and the lengths of the columns."""
        columns = len(self.rows) - 1
        triangle, right = self.triangle[:columns, :columns], self.triangle[:columns, columns]
        size = np.sqrt((triangle * triangle).sum(axis=0))
        size[size == 0] = 1.0
        left, singular, directions = np.linalg.svd(triangle / size)
        return singular, directions, left.T @ right, size


class Searched(Protocol):
    """What can be searched: weighted residuals inside bounds."""

    lower: FloatArray
    upper: FloatArray

    def evaluate(self, theta: FloatArray) -> Evaluation:
        """Residuals and Jacobian."""


class Solvable(Searched, Protocol):
    """What can be minimised: the same, and which entries are linear whatever the others are; these have no bounds."""

    @property
    def linear(self) -> Mask:
        """Of each entry."""

    @property
    def added(self) -> Mask:
        """Which of the linear ones add the same wherever all others are: they are in no derivative but their own."""
