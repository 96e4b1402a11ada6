"""Which other minima the readings allow: those that are as good as the lowest, under the noise that was found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.search.descent import HOPE, SHORTLY, minimum_near
from ipmclab.identification.search.names_of_poles import with_slow_poles_slow
from ipmclab.identification.search.solve import Solution
from ipmclab.identification.search.valleys import AS_GOOD, SURE, Place, Rival
from ipmclab.run import FloatArray

_SAME: Final = 1e-3  # of an entry: a search that ends so near found the same point

Inflation = Callable[[FloatArray], float]
"""How many times more the cost along a difference of residuals varies than under white noise."""


def allowed_places(
    problem: Problem, solution: Solution, valley: Sequence[Place], inflation: Inflation = lambda _: 1.0
) -> tuple[Rival, ...]:
    """The places of a valley that the readings allow, under the noise that was found."""
    found = []
    for place in valley:
        there = place.solution.evaluation
        times = inflation(there.residual - solution.evaluation.residual)
        # What is open stays open, however well all readings are met.
        own = max(solution.evaluation.per_residual * times, 1e-300)
        left = place.allowed - max(there.cost - solution.evaluation.cost, 0.0) / own
        if not left < 0.0:
            # Within a place 95 % of its own, less towards the last. Lasting noise moves no knowledge from beforehand.
            errors = np.hypot(np.sqrt(own) * place.errors[0], place.errors[1])
            reach = errors * np.sqrt(min(left, SURE)) if left > 0.0 else None
            found.append(Rival.of(problem, place.solution.theta, reach))
    return tuple(found)


def still_rivals(
    problem: Problem,
    solution: Solution,
    rivals: Sequence[Rival],
    inflation: Inflation = lambda _: 1.0,
    *,
    is_searched: bool = False,
) -> tuple[Rival, ...]:
    """Those of other minima that are as good in another problem, where they lie then.

    Where they are ends of searches of this problem (``is_searched``), one that was left there is left here too.
    """
    found = []

    def is_as_good(other: Evaluation) -> bool:
        times = inflation(other.residual - solution.evaluation.residual)
        return other.cost <= solution.evaluation.cost + AS_GOOD * solution.evaluation.per_residual * times

    for rival in rivals:
        if any(rival.reach.values()):  # it need not be as good: the readings cannot tell it from the best
            found.append(rival)
            continue
        theta = rival.vector_of(problem.unknowns, solution.theta)
        here = problem.evaluate(theta)
        if is_searched and here.cost > HOPE * solution.evaluation.cost and not is_as_good(here):
            continue
        other = minimum_near(problem, theta, here, evaluations=SHORTLY)
        if not is_as_good(other.evaluation):
            continue
        other = with_slow_poles_slow(problem, other)
        if np.abs(other.theta - solution.theta).max(initial=0.0) >= _SAME:
            found.append(Rival.of(problem, other.theta))
    return tuple(found)
