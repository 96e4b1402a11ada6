"""Coordinates in which a posterior is nearly round: straight ones, or ones that follow the floor of a bent valley.

Where the readings leave a combination of the parameters open, the posterior is a thin curved tube: current alone
allows every sheet resistance, if the first branch gives way. Walkers that step along straight lines hardly move in it.
So the floor of the valley is followed to where it rises or meets a bound, and the walkers move along it and across it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.problem.problem import Problem

FloatArray = npt.NDArray[np.float64]

WIDEST: Final = 2.0
"""Standard deviation that a direction is taken to have of which the readings say nothing."""

_OPEN: Final = 0.05  # standard deviation of a logarithm from which a valley may bend
_HIGH: Final = 30.0  # rise of minus twice the logarithm of the likelihood: nothing is there
_ENOUGH: Final = 20.0  # such a rise (a density of e^-10), beyond which a floor may be lost
_STEP: Final = 0.1  # standard deviations of a logarithm: the first step along a valley (convention)
_LONGEST: Final = 0.4  # the longest one (convention)
_SHORTEST: Final = 1e-3  # the shortest one: below it a valley has an end
_TURN: Final = 0.98  # cosine of the largest turn in a step
_MOST: Final = 600  # places of a valley, 240 standard deviations at most (a limit of memory)
_CORRECTIONS: Final = 8  # Newton steps back to the floor (a limit)
_SETTLED: Final = 1e-3  # standard deviations


@dataclass(frozen=True, eq=False)
class Straight:
    """The vector itself, scattered about a middle as the curvature says."""

    middle: FloatArray
    root: FloatArray

    def __call__(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The vectors as they are."""
        return points, np.zeros(len(points))


class Valley:
    """Length along the floor of a valley, and standard deviations across it; what comes after them stays as it is.

    Parameters
    ----------
    lengths : float array, shape (n_node,)
        Along the floor, 0 at the fit.
    floor : float array, shape (n_node, n)
    across : float array, shape (n_node, n, n - 1)
        One standard deviation in each direction across.
    rest : float array, shape (n_rest,)
        Middle of the further entries.
    width : float
        With which these are first drawn.
    """

    def __init__(
        self, lengths: FloatArray, floor: FloatArray, across: FloatArray, rest: FloatArray, width: float
    ) -> None:
        from scipy.interpolate import CubicSpline

        count = floor.shape[1]
        self._shape = count, count - 1
        self._ends = float(lengths[0]), float(lengths[-1])
        both = np.concatenate([floor, across.reshape(len(lengths), -1)], axis=1)
        self._path = CubicSpline(lengths, both)
        self._slope = self._path.derivative()
        at_fit = np.column_stack([self._slope(0.0)[:count], self._path(0.0)[count:].reshape(self._shape)])
        self._sign = float(np.linalg.slogdet(at_fit)[0])
        self.middle = np.concatenate([[0.0], np.zeros(count - 1), rest])
        quarter = min(self._ends[1] - self._ends[0], 2.0 * WIDEST) / 4.0
        self.root = np.diag([quarter, *np.ones(count - 1), *np.full(len(rest), width)])

    def __call__(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The vectors, and the logarithm of the determinant of their derivatives; shapes (n, n_entry) and (n,)."""
        count = self._shape[0]
        vectors, logarithms = points.copy(), np.full(len(points), -np.inf)
        inside = np.flatnonzero((self._ends[0] < points[:, 0]) & (points[:, 0] < self._ends[1]))
        lengths, away = points[inside, 0], points[inside, 1:count, None]
        here, slope = (of(lengths)[..., None] for of in (self._path, self._slope))
        across, turning = (of[:, count:].reshape(-1, *self._shape) for of in (here, slope))
        along = slope[:, :count] + turning @ away
        signs, sizes = np.linalg.slogdet(np.concatenate([along, across], axis=2))
        vectors[inside, :count] = (here[:, :count] + across @ away)[..., 0]
        # Where neighbouring cross sections meet, the valley is wider than its bend.
        logarithms[inside] = np.where(signs == self._sign, sizes, -np.inf)
        return vectors, logarithms


Coordinates = Straight | Valley


def coordinates(problem: Problem, theta: FloatArray, straight: Straight, *, width: float) -> Coordinates:
    """Those of the valley where the weakest direction is wide and its floor can be followed; else straight ones.

    Parameters
    ----------
    problem : Problem
        Whitened.
    theta : float array, shape (n,)
        The fit.
    straight : Straight
    width : float
        Of further entries.
    """
    singular, _, _ = _directions(problem, theta)
    if len(theta) < 2 or singular[-1] * _OPEN > 1.0:
        return straight
    lowest = problem.evaluate(theta).cost
    ahead, behind = (_follow(problem, theta, lowest, side) for side in (1.0, -1.0))
    if ahead is None or behind is None or len(ahead) + len(behind) < 3:
        return straight
    floor = np.array([*behind[::-1], theta, *ahead])
    lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(floor, axis=0), axis=1)))
    across = _cross_sections(problem, floor)
    return Valley(lengths - lengths[len(behind)], floor, across, straight.middle[len(theta) :], width)


def _directions(problem: Problem, theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Singular values, directions, and R of the Jacobian and residual."""
    triangle = problem.evaluate(theta).triangle
    count = len(theta)
    _, singular, directions = np.linalg.svd(triangle[:count, :count])
    return singular, directions, triangle


def _follow(problem: Problem, theta: FloatArray, lowest: float, side: float) -> list[FloatArray] | None:
    """The floor from a fit to where it has risen, or to a bound; None where it is lost.

    It goes where the readings say the least. Where that is suddenly another direction it goes on as it came.
    """
    found = _followed(problem, theta, lowest, side, as_it_came=False)
    return _followed(problem, theta, lowest, side, as_it_came=True) if found is None else found


def _followed(
    problem: Problem, theta: FloatArray, lowest: float, side: float, *, as_it_came: bool
) -> list[FloatArray] | None:
    _, directions, _ = _directions(problem, theta)
    tangent = side * directions[-1]
    found: list[FloatArray] = []
    step, rise = _STEP, 0.0
    while len(found) < _MOST:
        room = _room(problem, theta, tangent)
        if room < _SHORTEST:
            return found
        length = min(step, 0.9 * room)
        there = _down(problem, theta + length * tangent, tangent)
        if there is not None:
            _, directions, triangle = _directions(problem, there)
            turned: FloatArray = directions[-1] * np.sign(directions[-1] @ tangent)
            if as_it_came and turned @ tangent <= _TURN:
                turned = np.asarray((there - theta) / np.linalg.norm(there - theta))
            if turned @ tangent > _TURN:
                theta, tangent = there, turned
                found.append(theta)
                step = min(1.3 * step, _LONGEST)
                rise = float(triangle[:, -1] @ triangle[:, -1]) - lowest
                if rise > _HIGH:
                    return found
                continue
        step = 0.5 * length
        if step < _SHORTEST:
            return found if room < 10.0 * _SHORTEST or rise > _ENOUGH else None
    return None


def _room(problem: Problem, theta: FloatArray, tangent: FloatArray) -> float:
    """How far a line goes inside the bounds."""
    limit = np.where(tangent > 0, problem.upper, problem.lower)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(tangent == 0.0, np.inf, (limit - theta) / tangent)
    return float(reach.min())


def _down(problem: Problem, theta: FloatArray, tangent: FloatArray) -> FloatArray | None:
    """To the floor of the valley, square to its direction."""
    across = _complement(tangent)
    for _ in range(_CORRECTIONS):
        if not ((problem.lower < theta) & (theta < problem.upper)).all():
            return None
        triangle = problem.evaluate(theta).triangle
        if not np.isfinite(triangle).all():
            return None
        step, *_ = np.linalg.lstsq(triangle[:, :-1] @ across, -triangle[:, -1], rcond=1e-12)
        theta = theta + across @ step
        if float(np.linalg.norm(triangle[:, :-1] @ across @ step)) < _SETTLED:
            return theta
    return None


def _complement(tangent: FloatArray) -> FloatArray:
    """Unit vectors square to another, shape (n, n - 1)."""
    return np.asarray(np.linalg.svd(tangent[None])[2][1:].T)


def _cross_sections(problem: Problem, floor: FloatArray) -> FloatArray:
    """One standard deviation in each direction across the floor at each node, turning as little as possible."""
    found = []
    basis: FloatArray | None = None
    tangents = np.gradient(floor, axis=0)
    for node, along in zip(floor, tangents, strict=True):
        along = along / np.linalg.norm(along)
        if basis is None:
            basis = _complement(along)
        left = basis - np.outer(along, along @ basis)
        basis, turn = np.linalg.qr(left)
        basis = basis * np.sign(turn.diagonal())
        triangle = problem.evaluate(node).triangle[:, :-1]
        count = basis.shape[1]
        corner = np.asarray(np.linalg.qr(np.vstack([triangle @ basis, np.eye(count) / WIDEST]), mode="r"))
        corner = corner * np.sign(corner.diagonal())[:, None]
        found.append(basis @ np.linalg.inv(corner))
    return np.array(found)
