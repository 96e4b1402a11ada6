"""Minimise a weighted least-squares problem inside its bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from ipmclab.identification.problem.evaluation import Evaluation, Searched, Solvable
from ipmclab.identification.search.projected import Projected
from ipmclab.identification.search.tangent import UNFELT, gauss_newton, with_others
from ipmclab.run import FloatArray

NEGLIGIBLE: Final = 1e-6  # of a cost: a decrease that moves no parameter by a thousandth of its standard error
MOST_STEPS: Final = 12  # Gauss-Newton steps in a row (a limit)
FARTHEST_STEP: Final = 3.0  # of a logarithm, a factor of 20: derivatives lead no farther (convention)
NOTHING: Final = 1e-12  # of the cost: a decrease that is rounding
HARDLY: Final = 1e-9  # of the cost: where it does not fall, a decrease that need not have come
_MOST_FOLLOWED: Final = 6  # steps of the others after an entry that moved, after which the search takes over
PATIENCE: Final = 30
"""Evaluations in which the cost of a fit has to fall by ``HARDLY_FALLS``: along a valley there is no last step."""

HARDLY_FALLS: Final = 0.1  # of chi-square: less than readings tell
_LATELY: Final = 15  # evaluations that tell how fast a cost falls (convention)
AT_BOUND: Final = 1e-3
"""Of a logarithm or a scale: an entry that near to its bound says no more than that it is there."""

THERE: Final = "the parameters stopped moving"
LIMIT: Final = "the limit of evaluations was reached before the cost stopped falling"
_TOO_SLOW: Final = "another search was lower, and this one fell too slowly to come down to it"

# By the status of SciPy's ``least_squares``.
_REASONS: Final = {
    0: LIMIT,
    1: "the gradient vanished",
    2: "the cost stopped falling",
    3: THERE,
    4: "the cost and the parameters stopped moving",
}


class Pinned:
    """A problem with one entry held."""

    def __init__(self, problem: Solvable, place: int, entry: float) -> None:
        self._problem, self._place, self._entry = problem, place, entry
        self._others = np.delete(np.arange(len(problem.lower)), place)
        self._rows = np.append(self._others, len(problem.lower))
        self.lower, self.upper = problem.lower[self._others], problem.upper[self._others]
        self.linear, self.added = problem.linear[self._others], problem.added[self._others]
        self._latest: tuple[bytes, Evaluation] | None = None

    def evaluate(self, theta: FloatArray) -> Evaluation:
        """Residuals and Jacobian of the others."""
        full = self._whole(self._with_held(theta))
        return Evaluation(full.rows[self._rows], full.beforehand)

    def follow(self, theta: FloatArray, here: Evaluation, settled: float) -> tuple[Solution, float]:
        """The others from a point with another entry, by Gauss-Newton steps as far as these lead.

        Parameters
        ----------
        theta : float array, shape (n_unknown,)
            All entries of a point.
        here : Evaluation
            Of the problem there.
        settled : float
            The steps end where a further one would lower the cost by less.

        Returns
        -------
        found : Solution
            Of the others, converged where the steps have ended so.
        promised : float
            By how much a further step would lower the cost.
        """
        lower, upper = self._problem.lower, self._problem.upper
        reach = farthest(self._problem)
        best = theta.copy()
        best[self._place] = self._entry
        lowest, left, spent = np.inf, np.inf, 0
        while spent < _MOST_FOLLOWED:
            step, _ = with_others(here, [self._place], [self._entry - float(theta[self._place])])
            theta = theta + step
            theta[self._place] = self._entry
            inside = (lower < theta) & (theta < upper)
            inside[self._place] = True
            if not inside.all() or (np.abs(step) > reach).any():
                break
            here = self._whole(theta)
            spent += 1
            if not here.cost < lowest:
                break
            best, lowest, left = theta, here.cost, with_others(here, [self._place], [0.0])[1]
            if left <= settled:
                break
        others = best[self._others]
        return Solution(others, self.evaluate(others), left <= settled, _REASONS[2], spent), left

    def in_full(self, solution: Solution) -> Solution:
        """A solution as a point of the problem, with the entry that was held."""
        theta = self._with_held(solution.theta)
        return replace(solution, theta=theta, evaluation=self._whole(theta))

    def _with_held(self, theta: FloatArray) -> FloatArray:
        """All entries."""
        found = np.full(len(theta) + 1, self._entry)
        found[self._others] = theta
        return found

    def _whole(self, theta: FloatArray) -> Evaluation:
        """The problem there; a search mostly ends where it was last."""
        if self._latest is None or self._latest[0] != theta.tobytes():
            self._latest = theta.tobytes(), self._problem.evaluate(theta)
        return self._latest[1]


class Shifted:
    """A problem as it is for other readings of the same rows.

    Parameters
    ----------
    problem : Solvable
    shift : float array, shape (n_rows,)
        What its residuals have beside those of the problem.
    """

    def __init__(self, problem: Solvable, shift: FloatArray) -> None:
        self._problem, self._shift = problem, shift
        self.lower, self.upper = problem.lower, problem.upper
        self.linear, self.added = problem.linear, problem.added

    def evaluate(self, theta: FloatArray) -> Evaluation:
        """Residuals and Jacobian."""
        return self.shifted(self._problem.evaluate(theta))

    def shifted(self, there: Evaluation) -> Evaluation:
        """An evaluation of the problem itself, as one of this."""
        rows = there.rows.copy()
        rows[-1] += self._shift
        return Evaluation(rows, there.beforehand)


@dataclass(frozen=True, eq=False)
class Solution:
    """A minimum, or the best point where the search ended.

    ``evaluations`` counts how often the model was run on all records.
    """

    theta: FloatArray
    evaluation: Evaluation
    converged: bool
    message: str
    evaluations: int


def polish(problem: Solvable, theta: FloatArray, here: Evaluation | None = None) -> Solution | None:
    """Gauss-Newton steps from a point near the minimum; None where they leave the bounds or do not lower the cost.

    Along directions of which the readings say nothing the step is zero.

    Parameters
    ----------
    problem : Solvable
    theta : float array, shape (n_unknown,)
    here : Evaluation, optional
        At ``theta``, where it is known already.
    """
    if not _is_inside(problem, theta):
        return None
    spent = 0
    if here is None:
        here, spent = problem.evaluate(theta), 1
    reach = farthest(problem)
    for _ in range(MOST_STEPS):
        step, expected = gauss_newton(here)
        if expected <= max(NEGLIGIBLE, NOTHING * here.cost):
            return Solution(theta, here, True, _REASONS[1], spent)
        trial = theta + step
        if not _is_inside(problem, trial) or (np.abs(step) > reach).any():
            return None
        there = problem.evaluate(trial)
        spent += 1
        if not there.cost < here.cost:
            stopped = expected <= HARDLY * here.cost
            return Solution(theta, here, True, _REASONS[2], spent) if stopped else None
        theta, here = trial, there
    return None


def farthest(problem: Solvable) -> FloatArray:
    """How far derivatives lead: anywhere for what has no bounds, for which the answer is linear, or nearly so."""
    return np.where(np.isfinite(problem.upper - problem.lower), FARTHEST_STEP, np.inf)


def _is_inside(problem: Solvable, theta: FloatArray) -> bool:
    return bool(((problem.lower < theta) & (theta < problem.upper)).all())


def descend(
    problem: Solvable,
    theta: FloatArray,
    here: Evaluation | None = None,
    *,
    evaluations: int = 300,
    tolerance: float = 1e-10,
) -> Solution:
    """The minimum by Gauss-Newton steps where these get there, else by ``minimise``, from a point that may be known."""
    return near_or(partial(minimise, problem, evaluations=evaluations, tolerance=tolerance), problem, theta, here)


def near_or(
    search: Callable[[FloatArray, Evaluation | None], Solution],
    problem: Solvable,
    theta: FloatArray,
    here: Evaluation | None,
) -> Solution:
    """The same, else by any search: what the steps have asked of the point it need not ask again."""
    spent = 0
    if here is None and _is_inside(problem, theta):
        here, spent = problem.evaluate(theta), 1
    near = polish(problem, theta, here)
    return search(theta, here) if near is None else replace(near, evaluations=near.evaluations + spent)


def minimise(
    problem: Solvable,
    theta: FloatArray,
    here: Evaluation | None = None,
    *,
    evaluations: int = 300,
    tolerance: float = 1e-10,
    patience: int | None = None,
    fall: float | None = None,
) -> Solution:
    """Trust-region reflective least squares with the exact Jacobian (SciPy's TRF).

    Parameters
    ----------
    problem : Solvable
    theta : float array, shape (n_unknown,)
        Where the search starts; it is moved inside the bounds. An unknown that no reading feels there stays.
    here : Evaluation, optional
        At ``theta``, where it is known already.
    evaluations : int
        Limit of points. Where some entries are linear a point may take two evaluations of the model.
    tolerance : float
        The search ends when a step lowers the cost by less than this part of it, or moves the entries by less than
        this part of their length. At a minimum with large residuals steps shrink only by a constant factor, and the
        entries then have about half as many digits as the tolerance.
    patience : int, optional
        The search also ends where so many evaluations lower the cost by less than 0.1 of chi-square.
    fall : float, optional
        By how much the cost has to fall for the search to be worth its time. It is left where the cost falls so slowly
        that it would not have fallen as far at the limit of evaluations.
    """
    finite = np.isfinite(problem.upper - problem.lower)
    # A wide range is no reason to start far from its end.
    margin = np.minimum(np.where(finite, 1e-6 * np.where(finite, problem.upper - problem.lower, 0.0), 0.0), 1e-4)
    inside = np.clip(theta, problem.lower + margin, problem.upper - margin)
    fallen = _Fallen(evaluations, patience, fall)
    if not problem.linear.any():
        return _trust_region(problem, inside, here if np.array_equal(inside, theta) else None, tolerance, fallen)
    others = Projected(problem, inside)
    found = _trust_region(others, inside[~problem.linear], None, tolerance, fallen)
    point, last = others.in_full(found.theta)
    return replace(found, theta=point, evaluation=last, evaluations=others.evaluations)


def _trust_region(
    problem: Searched, inside: FloatArray, here: Evaluation | None, tolerance: float, fallen: _Fallen
) -> Solution:
    """SciPy's TRF from a point inside the bounds."""
    from scipy.optimize import least_squares

    kept: dict[bytes, Evaluation] = {} if here is None else {inside.tobytes(): here}

    def at(point: FloatArray) -> Evaluation:
        key = point.tobytes()
        if key not in kept:
            kept.clear()
            kept[key] = problem.evaluate(point)
            fallen.to(point, kept[key])
        return kept[key]

    # A search that steps in units of an unknown that changes no digit of the cost would leave all numbers.
    sizes = np.abs(at(inside).jacobian).max(axis=0, initial=0.0)
    sensitive = sizes > UNFELT * sizes.max(initial=0.0)

    def whole(part: FloatArray) -> FloatArray:
        point = inside.copy()
        point[sensitive] = part
        return point

    if not sensitive.any():
        return Solution(inside, at(inside), True, _REASONS[1], 1)
    # Turned by the Q of its own point, residual and Jacobian are a few rows with the same cost and the same steps.
    try:
        found = least_squares(
            lambda part: at(whole(part)).triangle[:, -1],
            inside[sensitive],
            jac=lambda part: at(whole(part)).triangle[:, :-1][:, sensitive],
            bounds=(problem.lower[sensitive], problem.upper[sensitive]),
            x_scale="jac",
            ftol=tolerance,
            xtol=tolerance,
            gtol=tolerance,
            max_nfev=fallen.evaluations,
        )
    except _Left as left:
        return Solution(*fallen.lowest, left.converged, left.message, len(fallen.costs))
    point = whole(found.x)
    last = kept.get(point.tobytes()) or problem.evaluate(point)
    return Solution(point, last, found.status > 0, _REASONS[found.status], int(found.nfev))


@dataclass(eq=False)
class _Left(Exception):
    """A search that is left: at a minimum, for a valley whose floor hardly falls has no last step, or far from one."""

    converged: bool
    message: str


class _Fallen:
    """How far the cost has fallen in a search, evaluation by evaluation, and where it was lowest."""

    def __init__(self, evaluations: int, patience: int | None, fall: float | None) -> None:
        self.evaluations, self._patience, self._fall = evaluations, patience, fall
        self.costs: list[float] = []
        self.lowest: tuple[FloatArray, Evaluation]

    def to(self, point: FloatArray, here: Evaluation) -> None:
        """One evaluation more; an exception where the last ones tell that further ones lead nowhere."""
        if not self.costs or here.cost < self.costs[-1]:
            self.lowest = point.copy(), here
        cost = self.lowest[1].cost
        self.costs.append(cost)
        if self._fall is not None and len(self.costs) > _LATELY:
            rate = (self.costs[-1 - _LATELY] - cost) / _LATELY
            if cost - rate * (self.evaluations - len(self.costs)) > self.costs[0] - self._fall:
                raise _Left(False, _TOO_SLOW)
        if self._patience is None or len(self.costs) <= self._patience:
            return
        if self.costs[-1 - self._patience] - cost < HARDLY_FALLS * self.lowest[1].per_residual:
            raise _Left(True, _REASONS[2])
