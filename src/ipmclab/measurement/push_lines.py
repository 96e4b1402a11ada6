"""Straight lines through a push: its ways in and out, the line through them, and where it leaves the flat part."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.confidence import wider_for_few

FloatArray = npt.NDArray[np.float64]
Ways = npt.NDArray[np.intp]

_TURN: Final = 0.1  # of the whole travel, by which a push has to go back to have turned
_CORNERS: Final = np.linspace(0.04, 0.8, 20)  # of the travel, at which contact is sought


def is_negative(x: FloatArray, f: FloatArray) -> bool:
    """Whether a push goes towards negative, so that contact is sought on the far side of its travel.

    Where the displacement is not counted from rest, such as the distance of a laser, its sign shows nothing.
    """
    from_rest = float(np.min(np.abs(x))) <= 0.5 * float(np.ptp(x))
    return -float(np.min(f)) > float(np.max(f)) and (not from_rest or -float(np.min(x)) > float(np.max(x)))


def ways_of(x: FloatArray) -> Ways:
    """The number of the way, in or out, that each reading belongs to: a new one begins where the push has turned."""
    back = _TURN * float(np.ptp(x))
    ways = np.zeros(len(x), dtype=np.intp)
    extreme, direction, number = 0, 0.0, 0
    for k in range(1, len(x)):
        if direction == 0.0:
            if abs(x[k] - x[extreme]) > back:
                direction, extreme = math.copysign(1.0, x[k] - x[extreme]), k
        elif (x[k] - x[extreme]) * direction > 0.0:
            extreme = k
        elif (x[extreme] - x[k]) * direction > back:
            number += 1
            ways[extreme + 1 :] = number
            direction, extreme = -direction, k
    return ways


def corner_of(x: FloatArray, f: FloatArray, ways: Ways) -> tuple[float, float]:
    """Where a line that is flat at first bends upwards [m], and the squares that it leaves; -inf for a straight one."""
    best, where = squares(x, f, ways), -math.inf
    # A record that rests for long has most of its readings at one place, a table has few over its travel.
    low, travel = float(np.min(x)), float(np.ptp(x))
    corners = np.sort(np.concatenate([np.quantile(x, np.linspace(0.05, 0.7, 27)), low + travel * _CORNERS]))
    for _ in range(2):
        sums = [squares(np.maximum(x, corner), f, ways) for corner in corners]
        place = int(np.argmin(sums))
        if sums[place] < best:
            best, where = sums[place], float(corners[place])
        corners = np.linspace(corners[max(place - 1, 0)], corners[min(place + 1, len(corners) - 1)], 9)
    return where, best


def columns_of(ways: Ways) -> FloatArray:
    """One intercept for each way."""
    return np.asarray((ways[:, None] == np.unique(ways)).astype(np.float64))


def squares(x: FloatArray, f: FloatArray, ways: Ways) -> float:
    columns = np.column_stack([x, columns_of(ways)])
    left = f - columns @ np.linalg.lstsq(columns, f, rcond=None)[0]
    return float(left @ left)


def line_of(x: FloatArray, f: FloatArray, ways: Ways) -> tuple[float, float, FloatArray]:
    """Slope, its standard error, and what is left."""
    columns = np.column_stack([x, columns_of(ways)])
    answer = np.linalg.lstsq(columns, f, rcond=None)[0]
    residual = f - columns @ answer
    free = max(len(x) - columns.shape[1], 1)
    inverse = np.linalg.pinv(columns.T @ columns)
    power = float(residual @ residual)
    follow = float(residual[1:] @ residual[:-1]) / power if power else 0.0
    follow = min(max(follow, 0.0), 0.95)
    # Correlated neighbours are worth fewer readings.
    independent = max(free * (1.0 - follow) / (1.0 + follow), 1.0)
    variance = power / free * (1.0 + follow) / (1.0 - follow)
    return float(answer[0]), wider_for_few(independent) * math.sqrt(variance * float(inverse[0, 0])), residual
