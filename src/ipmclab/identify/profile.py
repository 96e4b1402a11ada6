"""The profile of the likelihood: how much worse the readings are explained as one entry is held elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identify.problem import Evaluation, Problem
from ipmclab.identify.solve import STRUCTURAL, Pinned, Solution, minimise

FloatArray = npt.NDArray[np.float64]

_FARTHEST: Final = 7.0  # a factor of a thousand: beyond it an interval is called open
_LONGEST_STEP: Final = 1.0
_NEAR: Final = 1e-7  # of the cost: beside a threshold of 3.84 nothing
_CLOSE: Final = 0.02  # of the threshold's root
_SETTLED: Final = 2e-3  # of the threshold: what a further step of the others would still lower the cost by
_TURNS: Final = 6
_FARTHEST_STEP: Final = 3.0


@dataclass(frozen=True, eq=False)
class Point:
    """The best fit with one entry held.

    Parameters
    ----------
    entry : float
        Of the parameter that is held.
    height : float
        Root of the excess cost.
    theta : float array, shape (n_unknown,)
        All entries.
    evaluation : Evaluation
    """

    entry: float
    height: float
    theta: FloatArray
    evaluation: Evaluation


@dataclass(frozen=True, eq=False)
class Side:
    """One side of a profile: where it crosses the threshold (infinite where it does not), and the points on the way."""

    crossing: float
    points: tuple[Point, ...]


def profile_interval(
    problem: Problem, solution: Solution, place: int, error: float, threshold: float
) -> tuple[float, float]:
    """Entries at which the best cost with one entry held exceeds the minimum by a threshold.

    Parameters
    ----------
    problem : Problem
    solution : Solution
    place : int
        The entry.
    error : float
        Its standard error: the first step.
    threshold : float
        For 95 %, 3.84 times the ratio of the true to the plain variance.

    Returns
    -------
    lower, upper : float
        Infinite where the cost stays below the threshold within a factor of a thousand or up to a bound.
    """
    return (
        one_side(problem, solution, place, -error, threshold).crossing,
        one_side(problem, solution, place, error, threshold).crossing,
    )


def one_side(problem: Problem, solution: Solution, place: int, error: float, threshold: float) -> Side:
    """Walk from the minimum to where the profile crosses the threshold; a negative error walks downwards."""
    side = float(np.sign(error))
    middle, goal = float(solution.theta[place]), float(np.sqrt(threshold))
    bound = float((problem.upper if side > 0 else problem.lower)[place])
    near = first = Point(middle, 0.0, solution.theta, solution.evaluation)
    points: list[Point] = []

    def at(away: float, warm: Point) -> Point | None:
        found = held_at(problem, solution, place, middle + side * away, warm, threshold)
        if found is not None:
            points.append(found)
        return found

    # The first point is where a parabola would cross.
    away = min(goal * abs(error), _LONGEST_STEP)
    while True:
        if away > _FARTHEST or side * (bound - middle) <= away:
            return Side(side * np.inf, tuple(points))
        found = at(away, near)
        if found is None or len(points) > 40:
            return Side(side * np.inf, tuple(points))
        if found.height >= goal:
            break
        near = found
        step = away * (goal / max(near.height, 0.2 * goal)) * 1.1 - away
        away += min(max(step, 0.1 * away), _LONGEST_STEP)
    far, far_height, near_away = away, found.height, abs(near.entry - first.entry)
    same = 0  # how often the same end has moved: positive the near one, negative the far one
    for _ in range(16):
        if far_height - near.height < _CLOSE * goal or abs(far - near_away) < 1e-3 * far:
            break
        part = min(max((goal - near.height) / (far_height - near.height), 0.1), 0.9)
        # A straight line creeps towards a wall: then the middle is better.
        trial = near_away + (far - near_away) * (part if abs(same) < 2 else 0.5)
        found = at(trial, near)
        if found is None:
            far, far_height, same = trial, 10.0 * goal, min(same, 0) - 1
            continue
        if abs(found.height - goal) < 0.2 * _CLOSE * goal:
            return Side(middle + side * trial, tuple(points))
        if found.height < goal:
            near, near_away, same = found, trial, max(same, 0) + 1
        else:
            far, far_height, same = trial, found.height, min(same, 0) - 1
    part = (goal - near.height) / max(far_height - near.height, 1e-12)
    return Side(middle + side * (near_away + (far - near_away) * min(max(part, 0.0), 1.0)), tuple(points))


def held_at(
    problem: Problem, solution: Solution, place: int, entry: float, warm: Point, threshold: float
) -> Point | None:
    """The best fit with one entry held, from another point of the profile.

    The others first move as the derivatives at the other point say, which is mostly all that they need.
    """
    theta, cost, here = _followed(problem, place, entry, warm, _SETTLED * threshold)
    if here is None:
        pinned = Pinned(problem, place, entry)
        found = minimise(pinned, np.delete(warm.theta, place), evaluations=60, tolerance=_NEAR)
        theta = np.insert(found.theta, place, entry)
        here, cost = problem.evaluate(theta), found.evaluation.cost
    spared = problem.spared(theta) - problem.spared(solution.theta)
    excess = cost - spared - solution.evaluation.cost
    return Point(entry, float(np.sqrt(max(excess, 0.0))), theta, here) if np.isfinite(excess) else None


def _followed(
    problem: Problem, place: int, entry: float, warm: Point, settled: float
) -> tuple[FloatArray, float, Evaluation | None]:
    """The others by Gauss-Newton steps, and the least cost that the last of them promises; None where they fail."""
    theta, here = warm.theta, warm.evaluation
    before = np.inf
    for _ in range(_TURNS):
        step, _ = _others(here, place, entry - float(theta[place]))
        theta = theta + step
        theta[place] = entry
        inside = (problem.lower < theta) & (theta < problem.upper)
        inside[place] = True
        if not inside.all() or np.abs(step).max(initial=0.0) > _FARTHEST_STEP:
            break
        here = problem.evaluate(theta)
        if not here.cost < before:
            break
        _, promised = _others(here, place, 0.0)
        if promised <= settled:
            return theta, here.cost - promised, here
        before = here.cost
    return warm.theta, np.inf, None


def _others(here: Evaluation, place: int, moved: float) -> tuple[FloatArray, float]:
    """The step of all entries as one moves by so much, and by how much the others then lower the cost."""
    triangle, right = here.triangle[:, :-1], here.triangle[:, -1]
    count = triangle.shape[1]
    kept = np.arange(count) != place
    columns = triangle[:, kept]
    size = np.sqrt((columns * columns).sum(axis=0))
    size[size == 0.0] = 1.0
    left, singular, directions = np.linalg.svd(columns / size, full_matrices=False)
    seen = singular > STRUCTURAL * singular.max(initial=0.0)
    turned = left.T[seen] @ (right + moved * triangle[:, place])
    step = np.full(count, moved)
    step[kept] = -(directions[seen].T @ (turned / singular[seen])) / size
    return step, float(turned @ turned)
