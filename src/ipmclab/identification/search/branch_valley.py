"""The valley of a branch of which a record shows little: the best fits with its time constant held elsewhere.

A record that shows two branches of three says little of where the third one is: it may be slower than the record is
long, faster than its rows, or near another. At any one of these places the curvature shows the other branches as
known that are not. So the weakest branch's time constant is walked from the fastest to the slowest that could show, all
else is fitted again at each place, and what is known of a parameter reaches over all places that the readings allow
(the profile of the likelihood along that time constant).

Each place has several minima, as the other branches may lie on either side of the one that is held. Two starts are
followed: the fit at the neighbouring place, and the best circuit of time constants on a grid (``branch_times``). Where
the same valley was walked before, of a minimum near by, each place is begun where it was then.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ipmclab.identification.problem.evaluation import Evaluation, Solvable
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.search.branch_times import BranchTimes
from ipmclab.identification.search.solve import Pinned, Solution, descend, minimise
from ipmclab.identification.search.tangent import entry_errors, error_parts
from ipmclab.identification.search.valleys import EVALUATIONS, NEAR, SURELY_SOMEWHERE, WEAK, Place
from ipmclab.model.stages.circuit import Circuit, branch_names
from ipmclab.run import FloatArray

_FASTEST: Final = 0.3  # rows: the shortest time constant that is tried (convention)
_SLOWEST: Final = 30.0  # records: the longest (convention)
_STEP: Final = 0.8  # between the logarithms of neighbouring time constants
_ROUGHLY: Final = 1e-2  # of the cost, to which a search goes first
_FAR: Final = 0.5
"""Of the least cost: above it by more, which a few rough steps of a hundredth would not take away, search ends."""

_INSIDE: Final = 1e-6  # so far from their bounds searches begin


class Tied(Pinned):
    """A problem in which the sum of two entries is held: of logarithms, the product of two values."""

    def __init__(self, problem: Solvable, free: int, tied: int, total: float) -> None:
        super().__init__(problem, tied, total)
        self._free, self._own = free, free - (free > tied)
        self.lower[self._own] = max(problem.lower[free], total - problem.upper[tied])
        self.upper[self._own] = min(problem.upper[free], total - problem.lower[tied])

    def evaluate(self, theta: FloatArray) -> Evaluation:
        """Residuals and Jacobian of the others: the entry that is tied moves against the free one."""
        found = super().evaluate(theta)
        found.rows[self._own] -= self._whole(self._with_held(theta)).rows[self._place]
        return found

    def fitted(self, theta: FloatArray, least: float) -> Solution:
        """The best fit from a vector of the whole problem; only roughly where the readings do not allow it."""
        inside = np.clip(theta[self._others], self.lower + _INSIDE, self.upper - _INSIDE)
        rough = minimise(self, inside, evaluations=EVALUATIONS, tolerance=_ROUGHLY)
        if rough.evaluation.cost > (1.0 + _FAR) * least:
            return rough
        return descend(self, rough.theta, rough.evaluation, evaluations=EVALUATIONS, tolerance=NEAR)

    def place(self, problem: Problem, best: Solution, branch: int) -> Place:
        """A minimum as a point of a problem of the same unknowns, where a branch is held."""
        theta = self._with_held(best.theta)
        errors = np.insert(error_parts(best.evaluation), self._place, 0.0, axis=1)
        errors[:, self._place] = errors[:, self._free]
        whole = replace(best, theta=theta, evaluation=problem.evaluate(theta))
        return Place(whole, errors, SURELY_SOMEWHERE, branch)

    def _with_held(self, theta: FloatArray) -> FloatArray:
        found = super()._with_held(theta)
        found[self._place] -= found[self._free]
        return found


def branch_valley(
    problem: Problem, solution: Solution, branches: int, before: Sequence[tuple[int, FloatArray]] = ()
) -> list[Place]:
    """The best fits with the weakest branch elsewhere.

    Empty where every branch is well known, or where its parameters are not all free and shared.

    Parameters
    ----------
    problem : Problem
    solution : Solution
    branches : int
    before : sequence of (int, float array of shape (n_unknown,))
        The branch that was held at each place of the same valley where it was walked before, and the vector there: the
        places are these again. Which branch it was does not matter, any of them may stand at a time constant.
    """
    weakest = _weakest(problem, solution, branches)
    if weakest is None:
        return []
    branch, resistivity, permittivity = weakest
    shorter = problem.on_means or problem
    here = shorter.evaluate(solution.theta)
    if before:
        return [_begun(problem, shorter, held, theta, here.cost) for held, theta in before]
    values = problem.values(solution.theta, problem.records[0].place)
    slower, faster = _places(problem, values, float(solution.theta[resistivity] + solution.theta[permittivity]))
    seconds = _seconds(values) * np.exp(np.concatenate([slower, faster]))
    table = BranchTimes.of(shorter, solution.theta, here, seconds, branches)
    found: list[Place] = []
    for totals in (slower, faster):
        # From where it is outwards, each place from the fit at the one before it.
        warm = solution.theta
        for total in totals:
            tied = Tied(shorter, resistivity, permittivity, float(total))
            starts = [warm, None if table is None else table.start(len(found), branch)]
            tried = [tied.fitted(start, here.cost) for start in starts if start is not None]
            best = min(tried, key=lambda one: one.evaluation.cost)
            found.append(tied.place(problem, best, branch))
            warm = found[-1].solution.theta
    return found


def _begun(problem: Problem, shorter: Problem, branch: int, theta: FloatArray, least: float) -> Place:
    """The place at the time constant that a branch has in a vector, from there."""
    names = [unknown.name for unknown in problem.unknowns]
    free, other = (names.index(name) for name in branch_names(branch))
    tied = Tied(shorter, free, other, float(theta[free] + theta[other]))
    return tied.place(problem, tied.fitted(theta, least), branch)


def _places(problem: Problem, values: Mapping[str, float], own: float) -> tuple[FloatArray, FloatArray]:
    """Where the time constant is held, as sums of the two entries: from its own on to slower ones, and to faster."""
    unit = _seconds(values)
    periods = [record.period for record in problem.records]
    spans = [float(record.run.time[-1] - record.run.time[0]) for record in problem.records]
    fastest, slowest = np.log(_FASTEST * min(periods) / unit), np.log(_SLOWEST * max(spans) / unit)
    middle = float(np.clip(own, fastest, slowest))
    return np.arange(middle, slowest + _STEP, _STEP), np.arange(middle - _STEP, fastest - _STEP, -_STEP)


def _seconds(values: Mapping[str, float]) -> float:
    """Seconds of a branch whose resistivity and permittivity are one."""
    parts = Circuit(1).elements({**values, **dict.fromkeys(branch_names(0), 1.0)})
    return float(np.real(parts.branch_resistances[0] * parts.branch_capacitances[0]))


def _weakest(problem: Problem, solution: Solution, branches: int) -> tuple[int, int, int] | None:
    """The branch of which least is known, where that is little, and its entries."""
    names = [unknown.name for unknown in problem.unknowns]
    errors = entry_errors(solution.evaluation)
    pairs = [(number, branch_names(number)) for number in range(branches if branches > 1 else 0)]
    shared = [
        (number, names.index(one), names.index(other)) for number, (one, other) in pairs if {one, other} <= {*names}
    ]

    def error(branch: tuple[int, int, int]) -> float:
        return float(max(errors[branch[1]], errors[branch[2]]))

    weakest = max(shared, key=error, default=None)
    return None if weakest is None or not error(weakest) > WEAK else weakest
