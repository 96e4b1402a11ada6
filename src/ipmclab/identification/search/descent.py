"""Down to the minimum: from a point, of several searches, and under the weights that the residuals ask for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from ipmclab.identification.problem.evaluation import Evaluation, Solvable
from ipmclab.identification.problem.problem import Noise, Problem
from ipmclab.identification.search.leaps import led_on
from ipmclab.identification.search.settled import SETTLED, settle, settled, settled_to
from ipmclab.identification.search.solve import (
    HARDLY_FALLS,
    LIMIT,
    PATIENCE,
    THERE,
    Shifted,
    Solution,
    minimise,
    near_or,
)
from ipmclab.identification.search.tangent import STRUCTURAL, known_beforehand, with_others
from ipmclab.identification.search.valleys import AS_GOOD, NEAR
from ipmclab.run import FloatArray

LONGEST: Final = 300  # evaluations of one search
SHORTLY: Final = 15  # of a search that is only to show whether it is worth more
_COSTLY: Final = 1e-8  # of the cost: for thousands of readings a ten-thousandth of chi-square
_CHEAP: Final = 1e-10  # the same where an evaluation costs next to nothing
_THERE: Final = 1e-3  # of a standard error: a search that is so near its minimum has found it
HOPE: Final = 1.05  # times the best cost: a search above that is left
_CORRECTED: Final = 6  # times, each of which leaves of the way what means hide of their rows: a thousandth
_AT_FLOOR: Final = 1.3  # times the noise between neighbours
_SAME_NOISE: Final = 0.002  # relative: weights that are that near are the same (convention)
_WEIGHED_AGAIN: Final = 60  # times (a limit): of runs that disagree a fit that follows one more is led on by weights


def minimum(
    problem: Problem,
    theta: FloatArray,
    here: Evaluation | None = None,
    *,
    evaluations: int = LONGEST,
    fall: float | None = None,
) -> Solution:
    """The minimum from a point, as near to it as readings can tell where each evaluation is costly.

    Means of the rows lead near it where they are fewer. From there all rows tell what their squares fall by and those
    of the means do not; means of readings that were moved by as much have their minimum nearer to it, and so on until
    all rows have nothing to add (Nash, A multigrid approach to discretized optimization problems, 2000).

    A search that is to show by how much it falls is left where that would take too long (``solve.minimise``).
    """
    means = problem.on_means
    # A circuit alone affords to be searched to the last digit, along whatever valley.
    tolerance, patience = (_CHEAP, None) if problem.is_circuit else (_COSTLY, PATIENCE)
    search = partial(_searched, evaluations=evaluations, patience=patience)
    if means is None:
        return search(problem, theta, here, tolerance=tolerance, fall=fall)
    found = on_every_row(problem, search(means, theta, tolerance=NEAR, fall=fall))
    if not found.converged:
        return found
    for _ in range(_CORRECTED):
        found, left = settled_to(problem, found, _THERE)
        if left <= _THERE:
            return replace(found, converged=True, message=THERE)
        corrected = Shifted(means, correction(means.evaluate(found.theta), found.evaluation))
        near = minimise(corrected, found.theta, evaluations=evaluations, tolerance=NEAR, patience=patience)
        near = replace(on_every_row(problem, near), evaluations=found.evaluations + 1)
        fallen = found.evaluation.cost - near.evaluation.cost
        if abs(fallen) <= HARDLY_FALLS * found.evaluation.per_residual:
            # Along a valley in which the cost hardly falls there is no last step: it ends where the means have ended.
            return near if fallen > 0.0 else replace(found, evaluations=near.evaluations)
        if fallen < 0.0:
            break  # so far from a minimum means are no guide
        found = near
    last = search(problem, found.theta, found.evaluation, tolerance=NEAR)
    return replace(last, evaluations=last.evaluations + found.evaluations)


def _searched(
    problem: Solvable,
    theta: FloatArray,
    here: Evaluation | None = None,
    *,
    evaluations: int,
    tolerance: float,
    patience: int | None,
    fall: float | None = None,
) -> Solution:
    """A search; where a whole one came to its limit, another from where its valley leads."""
    search = partial(minimise, problem, evaluations=evaluations, tolerance=tolerance, patience=patience, fall=fall)
    found = search(theta, here)
    if found.message != LIMIT or evaluations < LONGEST:
        return found
    further = led_on(problem, theta, found)
    last = search(further.theta, further.evaluation)
    return replace(last, evaluations=last.evaluations + further.evaluations)


def minimum_near(
    problem: Problem,
    theta: FloatArray,
    here: Evaluation | None = None,
    *,
    evaluations: int = LONGEST,
    fall: float | None = None,
) -> Solution:
    """The same from a point that is near it, by Gauss-Newton steps where these get there."""
    search = partial(minimum, problem, evaluations=evaluations, fall=fall)
    if here is None and problem.on_means is not None:
        return search(theta)
    return near_or(search, problem, theta, here)


def settled_nearest(problem: Problem, solution: Solution, reference: FloatArray) -> Solution:
    """Along directions of which the readings say nothing, the point of the minimum nearest to a reference."""
    if problem.on_means is None:
        return settle(problem, solution, reference)
    found = settled(problem, on_every_row(problem, settle(*shorter(problem, solution), reference)))
    return replace(found, evaluations=found.evaluations + solution.evaluations)


def shorter(problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
    """The problem on means of its rows, and its minimum there; the same where these are not much fewer."""
    means = problem.on_means
    if means is None:
        return problem, solution
    return means, settled(means, replace(solution, evaluation=means.evaluate(solution.theta)))


def correction(means: Evaluation, rows: Evaluation) -> FloatArray:
    """What residuals of means lack for their squares to fall as those of all rows do, at one point.

    Of all such shifts the shortest: a sum of the derivatives.
    """
    singular, directions, _, size = means.scaled_spectrum
    kept = singular > STRUCTURAL * singular.max(initial=0.0)
    lacking = rows.rows[:-1] @ rows.residual - means.rows[:-1] @ means.residual
    across = directions[kept] / size
    return np.asarray((across.T @ ((across @ lacking) / singular[kept] ** 2)) @ means.rows[:-1])


def on_every_row(problem: Problem, found: Solution) -> Solution:
    """Where a search ended that looked at means of the rows, as all rows have it."""
    return replace(found, evaluation=problem.evaluate(found.theta), evaluations=1)


def minimum_from(problem: Problem, near: Solution) -> Solution:
    """The minimum beside a point, with what it took to come there."""
    found = minimum_near(problem, near.theta, near.evaluation)
    return replace(found, evaluations=found.evaluations + near.evaluations)


def start_with_fewer(problem: Problem, smaller: Problem, solution: Solution, gone: Sequence[int]) -> Solution:
    """Where to look for the minimum of a problem without some entries: the others follow those that are zero in it.

    No logarithm is ever zero, and what is nothing without its stage (a time constant) leads nowhere.
    """
    of = problem.unknowns
    zero = {place for place in gone if not of[place].log and not smaller.base.get(of[place].base)}
    moved = [-float(solution.theta[place]) if place in zero else 0.0 for place in gone]
    followed = solution.theta + with_others(solution.evaluation, gone, moved)[0]
    found = []
    for theta in (followed, solution.theta):
        kept = np.clip(np.delete(theta, gone), smaller.lower, smaller.upper)
        found.append(replace(solution, theta=kept, evaluation=smaller.evaluate(kept)))
    best = min(found, key=lambda one: one.evaluation.cost)
    return replace(best, evaluations=solution.evaluations + len(found))


def to_the_end(
    tried: Sequence[tuple[Problem, Solution]], neighbours: Noise | None = None
) -> list[tuple[Problem, Solution]]:
    """The searches that were left early, those that may still win followed to their minimum; the best first.

    Parameters
    ----------
    tried : sequence of (Problem, Solution)
    neighbours : mapping of (place, output) to float, optional [SI]
        The noise between neighbouring readings, where they are weighed by something else.
    """
    best = np.inf
    found = []
    longest = LONGEST
    for problem, solution in sorted(tried, key=_cost):
        if not solution.converged and solution.evaluation.cost < HOPE * best:
            solution = _further(problem, solution, longest, best)
        best = min(best, solution.evaluation.cost)
        if solution.converged and at_floor(problem, solution, neighbours or problem.noise):
            longest = SHORTLY
        found.append((problem, solution))
    (problem, solution), *others = sorted(found, key=_cost)
    if longest == SHORTLY and not solution.converged:  # of two at the floor one that was left early is the lower
        solution = _further(problem, solution, LONGEST, np.inf)
    return [(problem, solution), *others]


def _cost(pair: tuple[Problem, Solution]) -> float:
    return pair[1].evaluation.cost


def _further(problem: Problem, solution: Solution, evaluations: int, best: float) -> Solution:
    """A search that was left, from where it stands; where evaluations are costly, while it may yet be as good."""
    above = solution.evaluation.cost - best * (1.0 + AS_GOOD / len(solution.evaluation.residual))
    fall = max(above, 0.0) if not problem.is_circuit and math.isfinite(best) else None
    more = minimum(problem, solution.theta, evaluations=evaluations, fall=fall)
    return replace(more, evaluations=more.evaluations + solution.evaluations)


def at_floor(problem: Problem, solution: Solution, noise: Noise) -> bool:
    """Whether what is left looks like the noise between neighbouring readings."""
    found = found_noise(problem, solution.evaluation)
    return all(found[key] < _AT_FLOOR * noise[key] for key in found)


def weigh(problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
    """Take the weights from the residuals until they no longer change; the minimum under them, to the last digits."""
    left = LONGEST
    for _ in range(_WEIGHED_AGAIN):
        noise = found_noise(problem, solution.evaluation)
        if max(abs(noise[key] / problem.noise[key] - 1.0) for key in noise) < _SAME_NOISE:
            break
        weighed = problem.with_noise(noise)
        here = problem.weighed(solution.theta, solution.evaluation, noise)
        # Weights move the minimum by little: what one search does not reach, many in a row need not either.
        again = minimum_near(weighed, solution.theta, here, evaluations=max(left, SHORTLY))
        left -= again.evaluations
        again = replace(again, evaluations=again.evaluations + solution.evaluations)
        if solution.converged and not again.converged:  # a minimum is one under weights that hardly differ
            again = replace(again, converged=True, message=solution.message)
        problem, solution = weighed, again
    for _ in range(_WEIGHED_AGAIN):
        own = _OwnWeights(problem)
        solution = settled(own, replace(solution, evaluation=own.weighed(solution.theta, solution.evaluation)))
        here = own.unweighed(solution.theta)
        noise = found_noise(problem, here)
        solution = replace(solution, evaluation=problem.weighed(solution.theta, here, noise))
        problem = problem.with_noise(noise)
        found = found_noise(problem, solution.evaluation)
        if max(abs(found[key] / noise[key] - 1.0) for key in noise) < SETTLED:
            break  # a problem that projects rows leaves something else at the same point under other weights
    return problem, solution


class _OwnWeights:
    """A problem that takes its weights from the residuals wherever it is evaluated."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._latest: tuple[bytes, Evaluation] | None = None
        self.lower, self.upper = problem.lower, problem.upper

    def evaluate(self, theta: FloatArray) -> Evaluation:
        """Residuals and Jacobian under the weights of that point."""
        return self.weighed(theta, self.unweighed(theta))

    def unweighed(self, theta: FloatArray) -> Evaluation:
        """Those of the problem itself; steps mostly end where they were last."""
        if self._latest is None or self._latest[0] != theta.tobytes():
            self._latest = theta.tobytes(), self._problem.evaluate(theta)
        return self._latest[1]

    def weighed(self, theta: FloatArray, here: Evaluation) -> Evaluation:
        """An evaluation of the problem itself, as one of this."""
        return self._problem.weighed(theta, here, found_noise(self._problem, here))


def found_noise(problem: Problem, here: Evaluation) -> dict[tuple[int, str], float]:
    """Standard deviation of the residuals of each run and output, for the parameters that they had to feed."""
    pieces = problem.pieces
    total = sum(piece.stop - piece.start for piece in pieces.values())
    fed = len(problem.unknowns) - known_beforehand(here)
    freedom = max(total - fed, 1.0) / total
    noise = {}
    for key, piece in pieces.items():
        residual = here.residual[piece]
        active = max(int(np.count_nonzero(residual)), 1)  # a bound that holds says nothing about noise
        sigma = problem.noise[key] * math.sqrt(problem.squares(key, residual) / (active * freedom))
        noise[key] = max(sigma, problem.floors[key])
    return noise
