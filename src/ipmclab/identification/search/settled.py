"""The minimum itself, wherever near it a search has stopped."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from ipmclab.identification.problem.evaluation import Evaluation, Searched, Solvable
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.search.solve import AT_BOUND, HARDLY, MOST_STEPS, Pinned, Solution, farthest, polish
from ipmclab.identification.search.tangent import gauss_newton, null_directions, with_others
from ipmclab.run import FloatArray

SETTLED: Final = 1e-9
"""Of a standard error: a step shorter than that is none."""
_FAR: Final = 1.0  # standard errors: from farther away a search has not ended
_ASIDE: Final = 1e-6  # so far inside the bound it stays
_REMEMBERED: Final = 3  # steps, by which as many directions are corrected (convention)
_IN_VAIN: Final = 3  # steps in a row that come no nearer
_ALIKE: Final = 1e-8  # of the largest: steps that tell no more than those before


def settled(problem: Searched, solution: Solution) -> Solution:
    """The minimum itself, wherever near it a search has stopped.

    A search ends where nothing is left to gain. How near that is to the minimum hangs on its path, and that on the
    last bits of the processor's arithmetic. Gauss-Newton steps go on from there, each shorter than the one before,
    until a step is below ``SETTLED`` standard errors. What presses on its bound stays there; along directions of which
    the readings say nothing no step is made.
    """
    return settled_to(problem, solution, SETTLED)[0]


def settled_with_unfelt_held(problem: Solvable, solution: Solution) -> Solution:
    """The same where an entry is hardly felt; else the solution as it is.

    The step of such an entry leads out of its range, or farther than derivatives lead: it says nothing, and no step of
    all entries can be made. That entry stays where the search has left it, and the others settle beside it.
    """
    if not len(solution.theta):
        return solution
    step, _ = _step_within_bounds(problem, solution.theta, solution.evaluation)
    trial = solution.theta + step
    is_far = np.abs(step) > farthest(problem)
    is_far |= (trial < problem.lower) | (trial > problem.upper)
    if not is_far.any():
        return solution
    place = int(np.argmax(np.where(is_far, np.abs(step), -1.0)))
    pinned = Pinned(problem, place, float(solution.theta[place]))
    others = np.delete(solution.theta, place)
    start = replace(solution, theta=others, evaluation=pinned.evaluate(others), evaluations=solution.evaluations + 1)
    return pinned.in_full(settled(pinned, settled_with_unfelt_held(pinned, start)))


def settled_to(problem: Searched, solution: Solution, ending: float) -> tuple[Solution, float]:
    """The same until a step is below so many standard errors; and how long the next one would be.

    Where the model is curved against large residuals, Gauss-Newton steps go too far or stop short by the same part
    each time, and past twice the way they never end. What the steps before have missed says by which part
    (Anderson, J. ACM 12, 1965, 547).
    """
    theta, here, spent = solution.theta, solution.evaluation, solution.evaluations
    if not len(theta):
        return solution, 0.0
    step, length = _step_within_bounds(problem, theta, here)
    if not length < _FAR:
        return solution, length
    nearest, nearest_length, in_vain = solution, length, 0
    highest = here.cost * (1.0 + HARDLY)
    before: list[tuple[FloatArray, FloatArray]] = []
    for _ in range(MOST_STEPS):
        if length <= ending or in_vain == _IN_VAIN:
            break
        trial = theta + _with_missed(theta, step, here, before[-_REMEMBERED:])
        if ((trial < problem.lower) | (trial > problem.upper)).any():
            break
        before.append((theta, step))
        theta, here = trial, problem.evaluate(trial)
        spent += 1
        step, length = _step_within_bounds(problem, theta, here)
        if not length < _FAR:
            break
        in_vain += 1
        if length < nearest_length and here.cost <= highest:
            nearest, nearest_length, in_vain = replace(solution, theta=theta, evaluation=here), length, 0
    return replace(nearest, evaluations=spent), nearest_length


def _with_missed(
    theta: FloatArray, step: FloatArray, here: Evaluation, before: list[tuple[FloatArray, FloatArray]]
) -> FloatArray:
    """A step, less what it would miss of the way if it missed as those before, in standard errors."""
    if not before:
        return step
    ways = np.array([theta - other for other, _ in before])
    changes = np.array([step - other for _, other in before])
    errors = here.triangle[:, :-1]
    parts = np.linalg.lstsq(errors @ changes.T, errors @ step, rcond=_ALIKE)[0]
    return np.asarray(step - parts @ (ways + changes))


def _step_within_bounds(problem: Searched, theta: FloatArray, here: Evaluation) -> tuple[FloatArray, float]:
    """A Gauss-Newton step that leaves no bound, and its length in standard errors."""
    step, _ = gauss_newton(here)
    trial = theta + step
    low = (trial < problem.lower + _ASIDE) & (theta < problem.lower + AT_BOUND)
    high = (trial > problem.upper - _ASIDE) & (theta > problem.upper - AT_BOUND)
    held = low | high
    if held.any():
        aside = np.where(low, problem.lower + _ASIDE, np.where(high, problem.upper - _ASIDE, theta)) - theta
        step, _ = with_others(here, np.flatnonzero(held).tolist(), aside[held])
        trial = theta + step
    if ((trial < problem.lower) | (trial > problem.upper)).any():
        return step, np.inf  # a bound lies between: the search has said what there is to say
    scale = np.sqrt(max(here.cost / max(len(here.residual) - len(theta), 1), 1e-300))
    return step, float(np.linalg.norm(here.triangle[:, :-1] @ step)) / scale


def settle(problem: Problem, solution: Solution, reference: FloatArray) -> Solution:
    """Along directions of which the readings say nothing, move to the point nearest to a reference.

    Such directions bend: each short step along them is followed by steps back to the minimum.
    """
    reach = 0.5
    spent = solution.evaluations
    for _ in range(60):
        null = null_directions(solution.evaluation)
        move = null.T @ (null @ (reference - solution.theta))
        length = float(np.linalg.norm(move))
        if length < 1e-4 or reach < 1e-3:
            break
        trial = solution.theta + move * min(1.0, reach / length)
        inside = np.clip(trial, problem.lower + 1e-6, problem.upper - 1e-6)
        back, cost = polish(problem, inside), solution.evaluation.cost
        gained = back is not None and back.evaluation.cost <= cost + 1e-3 + 1e-9 * cost
        away = np.linalg.norm(solution.theta - reference)
        if back and gained and np.linalg.norm(back.theta - reference) < away:
            solution = back
            spent += back.evaluations
        else:
            reach *= 0.5
    return replace(solution, evaluations=spent)
