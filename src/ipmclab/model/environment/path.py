"""Path: how far parameters have moved along the water's course, and where they are renewed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.environment.moved import check_conducts, moved_values
from ipmclab.model.environment.transport import WaterCourse

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

RENEWED: Final = 1e-4
"""Part by which a parameter may move before all are renewed. Readings follow to half of it: 0.2 % would be visible."""

_LEAST: Final = 4
_FOR_ONE: Final = 6.0
_MOST: Final = 40
"""Points of a grid: at least, more for each factor of e by which a parameter moves, and at most."""

_FINE: Final = 2e-3
"""Part by which parameters may move between two points of a path: straight lines between them then hold."""


class Path(NamedTuple):
    """The way of the parameters along a record.

    Parameters
    ----------
    time : float array, shape (n,) [s]
    moved : float array, shape (n,)
        How far the parameter that moves most has come up to each time, as the sum of its parts.
    contents, temperatures : float arrays, shape (n,)
    """

    time: FloatArray
    moved: FloatArray
    contents: FloatArray
    temperatures: FloatArray

    @property
    def whole(self) -> float:
        """How far it comes in the end."""
        return float(self.moved[-1])

    def pieces(self, times: FloatArray) -> IndexArray:
        """Of each time the piece in which parameters stay."""
        return np.floor(np.interp(times, self.time, self.moved) / RENEWED).astype(np.int64)

    def grid(self, values: Mapping[str, float]) -> Grid:
        """States between which parameters of an actuator, and all that follows from them, are smooth."""
        low, high = float(np.min(self.contents)), float(np.max(self.contents))
        return Grid.over(
            values, math.log(low), math.log(high), float(np.min(self.temperatures)), float(np.max(self.temperatures))
        )


class Grid(NamedTuple):
    """Chebyshev's points in the logarithm of the water content and in the temperature [degC]."""

    contents: FloatArray
    temperatures: FloatArray

    @classmethod
    def over(cls, values: Mapping[str, float], low: float, high: float, cold: float, warm: float) -> Grid:
        """As many points as it takes for the parameters of an actuator between these ends."""
        contents, temperatures = np.exp([low, high]), np.array([cold, warm])
        wetter = max(float(steps(values, contents, np.full(2, one))[0]) for one in temperatures)
        warmer = max(float(steps(values, np.full(2, one), temperatures)[0]) for one in contents)
        return cls(chebyshev(low, high, wetter), chebyshev(cold, warm, warmer))

    @property
    def states(self) -> tuple[FloatArray, FloatArray]:
        """Water content and temperature of every point, the temperatures of one content side by side."""
        count = len(self.temperatures)
        return np.repeat(np.exp(self.contents), count), np.tile(self.temperatures, len(self.contents))

    def weights(self, contents: FloatArray, temperatures: FloatArray) -> FloatArray:
        """How much each point counts in each of some states, shape (n, n_points)."""
        wet, warm = _barycentric(self.contents, np.log(contents)), _barycentric(self.temperatures, temperatures)
        return (wet[:, :, None] * warm[:, None, :]).reshape(len(contents), -1)


class Panel(NamedTuple):
    """Some states between which all numbers of a strip are polynomials.

    Parameters
    ----------
    low, high : float
        Logarithms of the water content that it is for.
    contents, temperatures : float arrays
        Chebyshev's points in the logarithm of the water content and in the temperature [degC].
    by_content, by_temperature : float
        By which part of itself the parameter that moves most does at most, for a factor of e of the content and for
        1 K.
    """

    low: float
    high: float
    contents: FloatArray
    temperatures: FloatArray
    by_content: float
    by_temperature: float


def path_of(values: Mapping[str, float], water: WaterCourse, begin: float, end: float) -> Path:
    """The path of an actuator's parameters between two times [s].

    Raises
    ------
    InputError
        The membrane does not conduct somewhere.
    """
    time = np.unique(np.clip(np.concatenate([[begin], water.time, [end]]), begin, end))
    for _ in range(12):  # until a straight line between neighbours follows every parameter
        contents, temperatures = water.contents(time), water.temperatures(time)
        moved = steps(values, contents, temperatures)
        coarse = np.flatnonzero(moved > _FINE)
        if not len(coarse):
            break
        time = np.unique(np.concatenate([time, 0.5 * (time[coarse] + time[coarse + 1])]))
    check_conducts(values, water.state(float(time[np.argmin(contents)])))
    return Path(time, np.concatenate([[0.0], np.cumsum(moved)]), contents, temperatures)


def steps(values: Mapping[str, float], contents: FloatArray, temperatures: FloatArray) -> FloatArray:
    """By how much the parameter that moves most does from each state to the next."""
    there = moved_values(values, contents, temperatures)
    changing = [np.log(np.abs(value)) for name, value in there.items() if np.ndim(value) and values[name] != 0.0]
    if not changing:
        return np.zeros(len(contents) - 1)
    return np.asarray(np.max(np.abs(np.diff(np.array(changing), axis=1)), axis=0))


def chebyshev(low: float, high: float, moved: float) -> FloatArray:
    """As many of Chebyshev's points as it takes for a parameter that moves by so much; one where none moves."""
    if moved == 0.0 or high - low <= 1e-12 * max(abs(low), abs(high), 1.0):
        return np.array([0.5 * (low + high)])
    count = min(_LEAST + math.ceil(_FOR_ONE * moved), _MOST)
    return 0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.pi * np.arange(count) / (count - 1))


def _barycentric(nodes: FloatArray, x: FloatArray) -> FloatArray:
    """What each node counts at each x in the polynomial through all of them."""
    if len(nodes) == 1:
        return np.ones((len(x), 1))
    sign = np.where(np.arange(len(nodes)) % 2, -1.0, 1.0)
    sign[[0, -1]] *= 0.5
    away = x[:, None] - nodes
    on = away == 0.0
    weights = sign / np.where(on, 1.0, away)
    weights /= weights.sum(axis=1, keepdims=True)
    hit = on.any(axis=1)
    weights[hit] = on[hit]
    return np.asarray(weights)


def pieces_along(
    path: Path, water: WaterCourse, grid: Grid, middles: FloatArray
) -> tuple[IndexArray, IndexArray, FloatArray]:
    """The piece of each interval, the first interval of each piece, and the weights of the grid in each.

    Of a piece, the parameters are those in its middle.
    """
    number = path.pieces(middles)
    first = np.flatnonzero(np.diff(number, prepend=number[0] - 1))
    last = np.append(first[1:], len(middles)) - 1
    there = 0.5 * (middles[first] + middles[last])
    span = (path.contents.min(), path.contents.max()), (path.temperatures.min(), path.temperatures.max())
    weights = grid.weights(np.clip(water.contents(there), *span[0]), np.clip(water.temperatures(there), *span[1]))
    return np.repeat(np.arange(len(first)), last + 1 - first), first, weights
