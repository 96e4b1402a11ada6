"""The profile of the likelihood: how much worse the readings are explained as one entry is held elsewhere."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.search.solve import AT_BOUND, THERE, Pinned, Solution, descend
from ipmclab.identification.search.tangent import with_others
from ipmclab.run import FloatArray

_FARTHEST: Final = 7.0  # a factor of a thousand: beyond it an interval is called open
_LONGEST_STEP: Final = 1.0  # of an entry
_NEAR: Final = 1e-7  # of the cost: beside a threshold of 3.84 nothing
_LINEAR: Final = 0.05  # part of a height up to which a line continues a point
_JOINED: Final = 0.4  # part of a height over which a cubic joins two points
_POINTS: Final = 40  # at most, on one side
_FLAT: Final = 0.3  # part of a height below which a point lies in a plain
_WALL: Final = 3.0  # times a height, beyond which a point lies behind a wall
_DIFFERENCE: Final = 1e-5  # of an entry, between which a derivative is taken
_SETTLED: Final = 5e-3  # of the threshold: what a further step of the others would still lower the cost by
_HARDLY: Final = 0.1  # of an excess: less moves its root by a twentieth
_LOST: Final = 3  # points of one side at which the others found no minimum, from which on nobody follows it


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
    is_found : bool
        Whether the others have found their minimum, as they may not where poles meet: else the profile is no higher
        than ``height``, and no interval ends on its word.
    """

    entry: float
    height: float
    theta: FloatArray
    evaluation: Evaluation
    is_found: bool = True


class Walk:
    """One side of a profile, walked as far as it is asked for.

    At the best of all others the derivative of the cost by the entry that is held needs no further fit, so that two or
    three points tell where the profile crosses a height.

    Parameters
    ----------
    problem : Problem
    solution : Solution
        Its minimum.
    place : int
        The entry.
    error : float
        Its standard error, where the first step leads; negative to walk downwards.
    farthest : float
        Of an entry, up to where it is walked.
    """

    def __init__(
        self, problem: Problem, solution: Solution, place: int, error: float, farthest: float = _FARTHEST
    ) -> None:
        self._problem, self._solution, self._place, self._farthest = problem, solution, place, farthest
        self._side, self._error = math.copysign(1.0, error), min(abs(error), _FARTHEST)
        self._middle = float(solution.theta[place])
        self._slopes = {self._middle: 1.0 / self._error}
        self._ends_at, self._lost = math.inf, 0
        self._tried: dict[float, Point | None] = {}
        self.points = [Point(self._middle, 0.0, solution.theta, solution.evaluation)]

    def distance(self, height: float) -> float:
        """How far the entry moves until the root of the excess is ``height``; infinite where it never is."""
        for _ in range(_POINTS):
            near, far = self._around(height)
            if far is None and near.height >= self._ends_at:
                return math.inf
            found = self._crossing(near, far, height)
            if found is not None:
                return found
            trial = self._next(near, far, height)
            point = None if trial is None else self._point(trial, near, height)
            if point is None or self._lost > _LOST or (point.height < height and not point.is_found):
                self._ends_at = near.height  # nothing is known beyond: open above what was reached
                return math.inf
            self.points.append(point)
            self.points.sort(key=self._away)
        return math.inf

    def _point(self, trial: float, near: Point, height: float) -> Point | None:
        """The point at a distance, from one near it; it is searched once, from where it was wanted first."""
        if trial not in self._tried:
            entry = self._middle + self._side * trial
            point = held_at(self._problem, self._solution, self._place, entry, near, height * height)
            self._tried[trial] = point
            self._lost += point is not None and not point.is_found
        return self._tried[trial]

    def crossed(self, height: float) -> float:
        """The same from what was walked already, to a few hundredths; infinite where that ended below."""
        near, far = self._around(height)
        return math.inf if far is None else self._cubic(near, far, height)

    def end(self, distance: float) -> FloatArray:
        """All entries where one has moved so far; as far as was walked, where that is infinite."""
        last = self.points[-1]
        if math.isinf(distance):
            return last.theta
        entry = self._middle + self._side * distance
        near = min(self.points, key=lambda point: abs(point.entry - entry))
        found = held_at(self._problem, self._solution, self._place, entry, near, max(near.height**2, _NEAR))
        return near.theta if found is None else found.theta

    def _away(self, point: Point) -> float:
        return self._side * (point.entry - self._middle)

    def _slope(self, point: Point) -> float:
        """Of the height, by the distance."""
        if point.entry not in self._slopes:
            pull = _pull(self._problem, point, self._place) * self._side
            self._slopes[point.entry] = 0.5 * pull / point.height if point.height > 0.0 else 0.0
        return self._slopes[point.entry]

    def _around(self, height: float) -> tuple[Point, Point | None]:
        """The last point below a height, and the first above it."""
        for before, after in itertools.pairwise(self.points):
            if after.height >= height:
                return before, after
        return self.points[-1], None

    def _crossing(self, near: Point, far: Point | None, height: float) -> float | None:
        """The distance of a height beside points that are close enough to tell it."""
        if far is None:
            missing, away, slope = height - near.height, self._away(near), self._slope(near)
            on = missing <= _LINEAR * min(height, slope * away)
            return away + missing / slope if away > 0.0 and on else None
        if not far.is_found:
            return None
        beyond, away, slope = far.height - height, self._away(far), self._slope(far)
        if beyond <= _LINEAR * min(height, slope * away):
            return max(away - beyond / slope, self._away(near)) if slope > 0.0 else away
        between = away - self._away(near)
        if (far.height - near.height < _JOINED * height and near.height > 0.0) or between < 1e-3 * away:
            return self._cubic(near, far, height)
        return None

    def _next(self, near: Point, far: Point | None, height: float) -> float | None:
        """How far to look next; None where everything allowed has been looked at."""
        away, slope = self._away(near), self._slope(near)
        if far is not None:
            room = self._away(far) - away
            onward = away + (height - near.height) / max(slope, 1e-300)
            if not far.is_found or (near.height < _FLAT * height and far.height > _WALL * height):
                guess = away + 0.5 * room
            elif self._slope(far) > 0.0 or onward > away + room:
                guess = self._cubic(near, far, height)
            else:
                guess = onward  # a line through both points would creep
            return float(np.clip(guess, away + 0.1 * room, away + 0.9 * room))
        bound = (self._problem.upper if self._side > 0 else self._problem.lower)[self._place]
        last = min(self._side * (float(bound) - self._middle) * (1.0 - 1e-3), self._farthest)
        onward = (height - near.height) / max(slope, 0.2 * height / max(away, self._error))
        # A plateau that goes on beyond a factor of a thousand is crossed in steps that double.
        longest = max(_LONGEST_STEP, away - _FARTHEST)
        trial = away + min(max(onward, 0.1 * away), longest)
        if trial < last:
            return trial
        return last if away < 0.99 * last else None

    def _cubic(self, near: Point, far: Point, height: float) -> float:
        """The distance at a height between two, by the cubic through both; a straight line where that turns."""
        begin, run, room = self._away(near), self._away(far) - self._away(near), far.height - near.height
        part = (height - near.height) / max(room, 1e-300)
        slopes = np.array([self._slope(near), self._slope(far)]) * run / max(room, 1e-300)
        if not (slopes > 1.0 / 3.0).all():
            return begin + run * part
        first, last = 1.0 / slopes
        bent = (1.0 - part) ** 2 * part * first + part**2 * (3.0 - 2.0 * part) - part**2 * (1.0 - part) * last
        return begin + run * float(np.clip(bent, 0.0, 1.0))


def held_at(
    problem: Problem, solution: Solution, place: int, entry: float, warm: Point, threshold: float
) -> Point | None:
    """The best fit with one entry held, from another point of the profile.

    The others first move as the derivatives at the other point say, which is mostly all that they need; else a search
    goes on from where these have led. That may end before the cost has stopped falling.
    """
    settled = _SETTLED * threshold
    pinned = Pinned(problem, place, entry)
    is_found = True
    # An edge that crosses a row makes a kink, beyond which the others may do better. A circuit alone affords to look.
    is_kinked = any(unknown.base == "observation.delay" for unknown in problem.unknowns)
    if is_kinked and problem.is_circuit:
        found, promised = descend(pinned, np.delete(warm.theta, place), evaluations=60, tolerance=_NEAR), 0.0
    else:
        found, promised = pinned.follow(warm.theta, warm.evaluation, settled)
        if promised > settled:
            found, promised = descend(pinned, found.theta, found.evaluation, evaluations=60, tolerance=_NEAR), 0.0
            is_found = found.converged and found.message != THERE
    whole = pinned.in_full(found)
    theta, here, cost = whole.theta, whole.evaluation, whole.evaluation.cost - promised
    spared = problem.spared(theta) - problem.spared(solution.theta)
    excess = cost - spared - solution.evaluation.cost
    if not is_found:
        # How a search ends hangs on its last digits: where a further step beside the bounds promises next to nothing,
        # it has come as far as it had to.
        bounds = np.flatnonzero(np.minimum(theta - problem.lower, problem.upper - theta) < AT_BOUND)
        held = sorted({place, *bounds.tolist()})
        is_found = with_others(here, held, [0.0] * len(held))[1] <= _HARDLY * excess
    return Point(entry, float(np.sqrt(max(excess, 0.0))), theta, here, is_found) if np.isfinite(excess) else None


def _pull(problem: Problem, point: Point, place: int) -> float:
    """Derivative of the excess cost by one entry, all others following it at their best."""
    triangle, right = point.evaluation.triangle[:, :-1], point.evaluation.triangle[:, -1]
    step, _ = with_others(point.evaluation, [place], [0.0])
    along = with_others(point.evaluation, [place], [1.0])[0] - step
    ahead, behind = (problem.spared(point.theta + side * _DIFFERENCE * along) for side in (1.0, -1.0))
    return 2.0 * float(triangle[:, place] @ (right + triangle @ step)) - (ahead - behind) / (2.0 * _DIFFERENCE)
