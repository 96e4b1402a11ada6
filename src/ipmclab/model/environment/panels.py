"""Panels: numbers of a strip at a few states of its water, between which those of all others lie on polynomials.

A run that leaks dries itself, nobody knows beforehand how far: panels are made as the water comes to them. They lie at
the same places whatever came before, so that the same run gives the same digits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from ipmclab.model.environment.conditions import WaterState
from ipmclab.model.environment.hydration import PERCOLATION
from ipmclab.model.environment.laws import conducts_above
from ipmclab.model.environment.moved import check_conducts, moved_values
from ipmclab.model.environment.path import Grid, Panel, steps

FloatArray = npt.NDArray[np.float64]

_Made = TypeVar("_Made")

_WIDTH: Final = 0.25
"""Of a panel, in the logarithm of the water content."""

_LOOKS: Final = 33
"""States of a panel that are asked how fast parameters move."""


class Panels(Generic[_Made]):
    """The panels of one actuator for one kind of numbers.

    Parameters
    ----------
    values : mapping of dotted name to float [SI]
        Of the actuator, in its state of reference.
    cold, warm : float [degC]
        Between which its temperature stays.
    make : function of a sequence of mappings of dotted name to float
        Makes the numbers of a strip of its parameters at all states of a panel.
    """

    def __init__(
        self,
        values: Mapping[str, float],
        cold: float,
        warm: float,
        make: Callable[[Sequence[Mapping[str, float]]], _Made],
    ) -> None:
        self._values, self._between, self._make = values, (cold, warm), make
        self._conducts_above = values[PERCOLATION] if conducts_above(values) else None
        self._made: dict[tuple[float, float], tuple[Panel, _Made]] = {}

    def at(self, wanted: float) -> tuple[Panel, _Made]:
        """The panel of a water content, whose logarithm is given, and what was made of it.

        Raises
        ------
        InputError
            A water content at which the membrane does not conduct.
        """
        place = math.floor(wanted / _WIDTH)
        low, high = place * _WIDTH, (place + 1) * _WIDTH
        least = self._conducts_above
        if least is not None:
            content = math.exp(wanted)
            check_conducts(self._values, WaterState(content, self._between[0]))
            if math.exp(low) < 0.5 * (content + least):  # ever narrower towards the content that does not conduct
                low = math.log(0.5 * (content + least))
        if (low, high) not in self._made:
            panel, grid = self._panel(low, high)
            self._made[low, high] = panel, self._make(values_at(self._values, grid))
        return self._made[low, high]

    def _panel(self, low: float, high: float) -> tuple[Panel, Grid]:
        cold, warm = self._between
        grid = Grid.over(self._values, low, high, cold, warm)
        contents, temperatures = np.linspace(low, high, _LOOKS), np.linspace(cold, warm, _LOOKS)
        by_content = max(
            float(np.max(steps(self._values, np.exp(contents), np.full(_LOOKS, one)))) for one in grid.temperatures
        )
        by_temperature = max(
            float(np.max(steps(self._values, np.full(_LOOKS, math.exp(one)), temperatures))) for one in grid.contents
        )
        found = Panel(
            *(low, high, grid.contents, grid.temperatures, by_content / (contents[1] - contents[0])),
            by_temperature / (temperatures[1] - temperatures[0]) if warm > cold else 0.0,
        )
        return found, grid


def values_at(values: Mapping[str, float], grid: Grid) -> list[dict[str, float]]:
    """The parameters at the points of a grid, all worked out at once."""
    contents, temperatures = grid.states
    moved = moved_values(values, contents, temperatures)
    every = {name: np.broadcast_to(np.asarray(value, dtype=np.float64), len(contents)) for name, value in moved.items()}
    return [{name: float(value[k]) for name, value in every.items()} for k in range(len(contents))]
