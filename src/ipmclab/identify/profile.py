"""Intervals from the profile of the likelihood, where a parabola does not describe it."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identify.problem import Problem
from ipmclab.identify.solve import Pinned, Solution, minimise, polish

FloatArray = npt.NDArray[np.float64]

_FARTHEST: Final = 7.0  # a factor of a thousand: beyond it an interval is called open
_LONGEST_STEP: Final = 1.0
_NEAR: Final = 1e-7  # of the cost: beside a threshold of 3.84 nothing
_CLOSE: Final = 0.02  # of the threshold's root


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
        _cross(problem, solution, place, -error, threshold),
        _cross(problem, solution, place, error, threshold),
    )


def _cross(problem: Problem, solution: Solution, place: int, error: float, threshold: float) -> float:
    side = float(np.sign(error))
    middle, goal = float(solution.theta[place]), float(np.sqrt(threshold))
    bound = float((problem.upper if side > 0 else problem.lower)[place])
    others = np.delete(solution.theta, place)
    near, near_height, near_others = 0.0, 0.0, others
    # The first point is where a parabola would cross.
    far = min(goal * abs(error), _LONGEST_STEP)
    for _ in range(40):
        entry = middle + side * far
        if far > _FARTHEST or side * (bound - entry) <= 0:
            return side * np.inf
        found = _height(problem, solution, place, entry, near_others)
        if found is None:
            return side * np.inf
        height, found_others = found
        if height >= goal:
            break
        near, near_height, near_others = far, height, found_others
        slope_step = far * (goal / max(height, 0.2 * goal)) * 1.1 - far
        far += min(max(slope_step, 0.1 * far), _LONGEST_STEP)
    else:
        return side * np.inf
    far_height = height
    same = 0  # how often the same end has moved: positive the near one, negative the far one
    for _ in range(16):
        if far_height - near_height < _CLOSE * goal or abs(far - near) < 1e-3 * far:
            break
        part = min(max((goal - near_height) / (far_height - near_height), 0.1), 0.9)
        # A straight line creeps towards a wall: then the middle is better.
        trial = near + (far - near) * (part if abs(same) < 2 else 0.5)
        found = _height(problem, solution, place, middle + side * trial, near_others)
        if found is None:
            far, far_height, same = trial, 10.0 * goal, min(same, 0) - 1
            continue
        height, found_others = found
        if abs(height - goal) < 0.2 * _CLOSE * goal:
            return middle + side * trial
        if height < goal:
            near, near_height, near_others, same = trial, height, found_others, max(same, 0) + 1
        else:
            far, far_height, same = trial, height, min(same, 0) - 1
    part = (goal - near_height) / max(far_height - near_height, 1e-12)
    return middle + side * (near + (far - near) * min(max(part, 0.0), 1.0))


def _height(
    problem: Problem, solution: Solution, place: int, entry: float, others: FloatArray
) -> tuple[float, FloatArray] | None:
    """Root of the excess cost with one entry held, and the others there."""
    pinned = Pinned(problem, place, entry)
    found = polish(pinned, others) or minimise(pinned, others, evaluations=60, tolerance=_NEAR)
    there = problem.spared(np.insert(found.theta, place, entry))
    excess = found.evaluation.cost - there - (solution.evaluation.cost - problem.spared(solution.theta))
    return (float(np.sqrt(max(excess, 0.0))), found.theta) if np.isfinite(excess) else None
