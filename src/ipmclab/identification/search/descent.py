"""Down to the minimum: from a point, of several searches, and under the weights that the residuals ask for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.problem.problem import Evaluation, Problem
from ipmclab.identification.problem.response import CircuitResponder
from ipmclab.identification.search.solve import SETTLED, Solution, descend, minimise, settled
from ipmclab.identification.search.weights import found_noise

FloatArray = npt.NDArray[np.float64]

LONGEST: Final = 300  # evaluations of one search
SHORTLY: Final = 15  # of a search that is only to show whether it is worth more
_COSTLY: Final = 1e-8  # of the cost: for thousands of readings a ten-thousandth of chi-square
_CHEAP: Final = 1e-10
_HOPE: Final = 1.05  # times the best cost: a search above that is left
_AT_FLOOR: Final = 1.3  # times the noise between neighbours
_SAME_NOISE: Final = 0.002
_WEIGHED_AGAIN: Final = 6  # times, each of which leaves of a difference of the weights a part of unknowns by readings


def minimum(problem: Problem, theta: FloatArray, *, evaluations: int = LONGEST) -> Solution:
    """The minimum from a point, as near to it as readings can tell where each evaluation is costly."""
    return minimise(problem, theta, evaluations=evaluations, tolerance=_tolerance(problem))


def minimum_near(
    problem: Problem, theta: FloatArray, here: Evaluation | None = None, *, evaluations: int = LONGEST
) -> Solution:
    """The same from a point that is near it, by Gauss-Newton steps where these get there."""
    return descend(problem, theta, here, evaluations=evaluations, tolerance=_tolerance(problem))


def minimum_beside(problem: Problem, near: Solution) -> Solution:
    """The minimum beside a point, with what it took to come there."""
    found = minimum_near(problem, near.theta, near.evaluation)
    return replace(found, evaluations=found.evaluations + near.evaluations)


def _tolerance(problem: Problem) -> float:
    return _CHEAP if isinstance(problem.responder, CircuitResponder) else _COSTLY


def to_the_end(tried: Sequence[tuple[Problem, Solution]]) -> list[tuple[Problem, Solution]]:
    """The searches that were left early, those that may still win followed to their minimum; the best first."""
    best = np.inf
    found = []
    longest = LONGEST
    for problem, solution in sorted(tried, key=lambda pair: pair[1].evaluation.cost):
        if not solution.converged and solution.evaluation.cost < _HOPE * best:
            more = minimum(problem, solution.theta, evaluations=longest)
            solution = replace(more, evaluations=more.evaluations + solution.evaluations)
        best = min(best, solution.evaluation.cost)
        if solution.converged and at_floor(problem, solution):
            longest = SHORTLY
        found.append((problem, solution))
    return sorted(found, key=lambda pair: pair[1].evaluation.cost)


def at_floor(problem: Problem, solution: Solution) -> bool:
    """Whether what is left looks like the noise between neighbouring readings."""
    found = found_noise(problem, solution)
    return all(found[key] < _AT_FLOOR * problem.noise[key] for key in found)


def weigh(problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
    """Take the weights from the residuals until they no longer change; the minimum under them, to the last digits."""
    for _ in range(6):
        noise = found_noise(problem, solution)
        if max(abs(noise[key] / problem.noise[key] - 1.0) for key in noise) < _SAME_NOISE:
            break
        weighed = problem.with_noise(noise)
        here = problem.weighed(solution.theta, solution.evaluation, noise)
        again = minimum_near(weighed, solution.theta, here)
        spent = again.evaluations + solution.evaluations
        problem, solution = weighed, replace(again, converged=again.converged and solution.converged, evaluations=spent)
    for _ in range(_WEIGHED_AGAIN):
        solution = settled(problem, solution)
        noise = found_noise(problem, solution)
        if max(abs(noise[key] / problem.noise[key] - 1.0) for key in noise) < SETTLED:
            break
        weighed = problem.with_noise(noise)
        problem, solution = (
            weighed,
            replace(solution, evaluation=problem.weighed(solution.theta, solution.evaluation, noise)),
        )
    return problem, solution
