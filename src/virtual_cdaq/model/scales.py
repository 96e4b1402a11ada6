"""Custom scales: what a program counts in, made of what a module measures or gives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from virtual_cdaq.model.converters import Floats
from virtual_cdaq.model.errors import ChassisError

FEWEST_ENTRIES = 2  # of a table


@dataclass
class Scale:
    """A custom scale.

    Parameters
    ----------
    name : str
    kind : {"linear", "map", "polynomial", "table"}
    before, after : tuple of float
        Of a map: the smallest and the largest value before and after scaling. Of a table: its two columns. Of a
        polynomial: the coefficients that lead from the values before to those after, and back; of a straight line
        ``before`` are intercept and slope. Coefficients begin with the constant one.
    units_before : int
        DAQmx number.
    units_after : str
        Anything.
    description : str

    Examples
    --------
    >>> force = Scale("force", "linear", (-1.0, 2.0), (), 10348, "mN")
    >>> force.forward(np.array([0.0, 3.0])).tolist(), force.reverse(np.array([5.0])).tolist()
    ([-1.0, 5.0], [3.0])
    """

    name: str
    kind: Literal["linear", "map", "polynomial", "table"]
    before: tuple[float, ...]
    after: tuple[float, ...]
    units_before: int
    units_after: str = ""
    description: str = ""

    def __post_init__(self) -> None:
        self.check()

    def check(self) -> None:
        """Refuse a scale that cannot lead back.

        Raises
        ------
        ChassisError
            With the code of NI-DAQmx for what is wrong.
        """
        code = _CHECKS[self.kind](self.before, self.after)
        if code:
            raise ChassisError(code, f"Custom scale: {self.name}")

    def forward(self, values: Floats) -> Floats:
        """From what is measured to what the program reads."""
        return self._mapped(values, self.before, self.after)

    def reverse(self, values: Floats) -> Floats:
        """From what the program writes to what is given."""
        if self.kind == "linear":
            return np.asarray((values - self.before[0]) / self.before[1])
        if self.kind == "polynomial":
            return np.asarray(np.polynomial.polynomial.polyval(values, np.array(self.after)))
        return self._mapped(values, self.after, self.before)

    def _mapped(self, values: Floats, before: tuple[float, ...], after: tuple[float, ...]) -> Floats:
        if self.kind in ("linear", "polynomial"):
            return np.asarray(np.polynomial.polynomial.polyval(values, np.array(before)))
        if self.kind == "map":
            slope = (after[1] - after[0]) / (before[1] - before[0])
            return np.asarray(after[0] + slope * (values - before[0]))
        order = np.argsort(before)
        return np.asarray(np.interp(values, np.array(before)[order], np.array(after)[order]))


def _check_line(before: tuple[float, ...], after: tuple[float, ...]) -> int:  # noqa: ARG001 - a line has one side
    return -200409 if before[1] == 0.0 else 0


def _check_map(before: tuple[float, ...], after: tuple[float, ...]) -> int:
    if before[0] == before[1]:
        return -200602
    return -200603 if after[0] == after[1] else 0


def _check_polynomial(forward: tuple[float, ...], reverse: tuple[float, ...]) -> int:
    if not forward or not reverse:
        return -200404 if not forward and not reverse else -200405 if not forward else -200406
    if not any(forward):
        return -200407
    return -200408 if not any(reverse) else 0


def _check_table(before: tuple[float, ...], after: tuple[float, ...]) -> int:
    if len(before) < FEWEST_ENTRIES or len(after) < FEWEST_ENTRIES:
        return -200434 if len(before) < FEWEST_ENTRIES else -200433
    if len(before) != len(after):
        return -200350
    if len(set(before)) < len(before):
        return -200598
    return -200599 if len(set(after)) < len(after) else 0


_CHECKS = {"linear": _check_line, "map": _check_map, "polynomial": _check_polynomial, "table": _check_table}


def find_scale(scales: Mapping[str, Scale], name: str) -> Scale:
    """The scale of a name.

    Raises
    ------
    ChassisError
        -200378, there is none.
    """
    if name not in scales:
        raise ChassisError(-200378, f"Custom scale: {name}")
    return scales[name]


def reverse_coefficients(forward: tuple[float, ...], low: float, high: float, points: int, order: int) -> list[float]:
    """The polynomial that leads back from ``forward`` between two values, as well as one of its order does.

    Parameters
    ----------
    forward : tuple of float
        Coefficients, the constant one first.
    low, high : float
        Between which values before scaling.
    points : int
        How many of them are tried.
    order : int
        Of the polynomial that leads back; -1 for that of ``forward``.

    Examples
    --------
    >>> [round(each, 9) for each in reverse_coefficients((1.0, 2.0), -10.0, 10.0, 1000, 1)]
    [-0.5, 0.5]
    """
    order = len(forward) - 1 if order < 0 else order
    if not forward or points <= order or not math.isfinite(low) or not low < high:
        raise ChassisError(
            -200077, f"Points: {points}\nAllowed: more than the order, {order}, from {low:g} to {high:g}"
        )
    before = np.linspace(low, high, points)
    after = np.polynomial.polynomial.polyval(before, np.array(forward))
    found: list[float] = np.polynomial.polynomial.polyfit(after, before, order).tolist()
    return found
