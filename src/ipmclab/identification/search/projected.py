"""Variable projection in a search: what enters linearly is at its best for all else (Golub and Pereyra, 1973)."""

from __future__ import annotations

from typing import Final

import numpy as np

from ipmclab.identification.problem.evaluation import Evaluation, Solvable
from ipmclab.identification.search.tangent import STRUCTURAL, UNFELT
from ipmclab.run import FloatArray

_PARALLEL: Final = 1e-11
"""Of the largest singular value of columns of equal size: below it a direction of linear entries is rounding."""

_AT_BEST: Final = 1e-3
"""Of chi-square: linear entries that could lower the cost by no more are at their best for what the others do."""

_NEARLY: Final = 0.03
"""Of a linear entry: the derivatives that grow with it are within as much of those at its best, which serves a step.
Where none grow with it, as with what a sensor adds, it may be anywhere."""


class Projected:
    """A problem without the entries that enter linearly.

    The residual is exact wherever these stand, for what they can follow is taken out of it. The derivatives of the
    others hang on where they stand: Kaufman's part of the exact ones, with the linear entries followed from the last
    point and, where that leaves them away from their best by more than a step notices, the model asked once more.

    Parameters
    ----------
    problem : Solvable
    theta : float array, shape (n_unknown,)
        A point of it, from whose linear entries the search starts.
    """

    def __init__(self, problem: Solvable, theta: FloatArray) -> None:
        self._problem, self._linear = problem, problem.linear
        self.lower, self.upper = problem.lower[~self._linear], problem.upper[~self._linear]
        self._last = theta.copy()
        self._follow: FloatArray = np.zeros((int(self._linear.sum()), len(self.lower)))
        self._left: FloatArray = np.zeros(len(self._follow))
        self._changes = ~problem.added[self._linear]
        self.evaluations = 0

    def evaluate(self, theta: FloatArray) -> Evaluation:
        """Residuals and Jacobian of the others, what the linear entries can follow taken out."""
        linear = self._linear
        point = self._last.copy()
        point[linear] += self._follow @ (theta - point[~linear])
        point[~linear] = theta
        for attempt in (True, False):
            here = self._problem.evaluate(point)
            self.evaluations += 1
            rows, others = here.rows[:-1][linear], here.rows[np.append(~linear, True)]
            if not np.isfinite(rows).all() or not np.isfinite(here.cost):
                return Evaluation(others, here.beforehand)  # from what is not finite a search steps back
            size = np.abs(rows).max(axis=1)
            unfelt = size <= UNFELT * np.abs(here.rows[:-1]).max()
            size[unfelt] = np.inf
            turn, singular, basis = _decomposed(rows / size[:, None])
            kept = singular > _PARALLEL * singular.max(initial=0.0)
            along = others @ basis[kept].T
            back = turn[:, kept] / singular[kept] / size[:, None]
            self._left = -back @ along[-1]
            if not attempt or along[-1] @ along[-1] <= _AT_BEST * here.cost / len(here.residual):
                break
            near = _NEARLY * np.abs(point[linear][self._changes])
            if np.all(np.abs(self._left[self._changes]) <= near):
                break
            point[linear] += self._left
        self._last, self._follow = point, -back @ along[:-1].T
        left = others - along @ basis[kept]
        # What the linear entries imitate altogether is not felt: the rounding of its column would be.
        imitated = np.vecdot(left[:-1], left[:-1]) <= STRUCTURAL**2 * np.vecdot(others[:-1], others[:-1])
        left[:-1][imitated] = 0.0
        return Evaluation(left, here.beforehand)

    def in_full(self, theta: FloatArray) -> tuple[FloatArray, Evaluation]:
        """The point of the whole problem, the linear entries at their best, and its evaluation."""
        if not np.array_equal(self._last[~self._linear], theta):
            self.evaluate(theta)
        point = self._last.copy()
        point[self._linear] += self._left
        self.evaluations += 1
        return point, self._problem.evaluate(point)


def _decomposed(rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The singular value decomposition of a few long rows, in a fifth of the time: that of their triangle, turned."""
    from scipy.linalg.lapack import dgeqrf, dorgqr

    count = min(rows.shape)
    triangle, scales, *_ = dgeqrf(rows.T)
    turn, singular, basis = np.linalg.svd(np.triu(triangle[:count]).T, full_matrices=False)
    return turn, singular, basis @ dorgqr(triangle[:, :count], scales)[0].T
