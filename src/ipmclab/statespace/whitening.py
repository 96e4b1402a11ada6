"""Rows of one output of one run, whitened by its noise: their squares are then minus twice the log likelihood."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ipmclab.run import FloatArray
from ipmclab.statespace.columns import held_constants, whitened
from ipmclab.statespace.terms import StateSpace, Terms, state_space


@dataclass(frozen=True, eq=False)
class Whitening:
    """What makes the rows of one output of one run independent, with variance 1.

    Parameters
    ----------
    terms : Terms
    space : StateSpace
    scale : float
        Of the noise, in units of the rows.
    steps : int array, shape (n_measured,)
        Steps of time between readings that are measured.
    inside : bool array, shape (n_rows,)
        Rows that are measured; the others are bounds, whose noise counts by itself.
    basis : float array, shape (n_measured, n_constants)
        Orthonormal: the whitened offset and trend.
    back : float array, shape (n_constants, n_constants)
        From the basis to offset and trend.
    """

    terms: Terms
    space: StateSpace
    scale: float
    steps: npt.NDArray[np.int64]
    inside: npt.NDArray[np.bool_]
    basis: FloatArray
    back: FloatArray

    @classmethod
    def of(
        cls,
        terms: Terms,
        entries: FloatArray,
        scale: float,
        time: FloatArray,
        steps: npt.NDArray[np.int64],
        inside: npt.NDArray[np.bool_],
    ) -> Whitening:
        """Made ready from a shape of the noise; ``time`` and ``steps`` of the measured readings."""
        space = state_space(terms, entries)
        basis, triangle = np.linalg.qr(whitened(space, held_constants(time, terms), steps)[0] / scale)
        return cls(terms, space, scale, steps, inside, basis, np.asarray(np.linalg.inv(triangle)))

    def apply(self, rows: FloatArray) -> FloatArray:
        """Rows of an evaluation whitened, offset and trend projected out; shape (n, n_rows) stays.

        With offset and trend projected out the squares of a residual are least for the best of both.
        """
        measured = self._white(rows)
        measured -= self.basis @ (self.basis.T @ measured)
        found = rows.copy()
        found[:, self.inside] = measured.T
        return found

    def constants(self, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Offset and trend of a residual and their covariance, in units of the rows; time about its ``origin``."""
        answer = self.back @ (self.basis.T @ self._white(residual[None])[:, 0])
        return answer, self.back @ self.back.T

    def _white(self, rows: FloatArray) -> FloatArray:
        return whitened(self.space, rows[:, self.inside].T, self.steps)[0] / self.scale
