"""Parameters: how a stage declares them, and what an actuator gives out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from ipmclab.errors import InputError
from ipmclab.units import Quantity

Transform = Literal["log", "linear", "count"]
Values = Mapping[str, complex]
"""Parameters by dotted name, in SI units: floats, or complex where a derivative is taken."""


@dataclass(frozen=True)
class Measurement:
    """An experiment that gives a parameter without the model.

    Parameters
    ----------
    how : str
        As an instruction: ``"measure the width"``.
    place : int
        Among the measurements of a strip, the quickest first.
    """

    how: str
    place: int


@dataclass(frozen=True)
class Declaration:
    """What a stage says about one of its parameters.

    Parameters
    ----------
    name : str
        Dotted name, such as ``"coupling.gain"``.
    quantity : Quantity
        What it is; gives the SI unit.
    symbol : str
        The thesis's symbol.
    lower, upper : float [SI]
        The allowed range, ends included: far beyond what a strip can have, so that only
        a slip (a wrong unit, a lost exponent) falls outside.
    transform : "log", "linear" or "count"
        The scale on which a fit moves the parameter; a count is never moved.
    default : float [SI], optional
        The value where a file says nothing; None when it must be given.
    typical : float [SI], optional
        A usual size, with which a stage is added to an actuator; where it is left out, the default.
    likely : pair of float [SI], optional
        Where 19 of 20 strips lie, where the literature knows it: what is known of a strip before it is measured.
    scale : float [SI]
        What counts as a change of order one where it is moved on a linear scale: at zero its own size says nothing.
    least : float [SI], optional
        For a parameter that may be zero but is moved as a logarithm, because its size trades against an exponent: the
        smallest value that a fit tries. Whether it is zero is asked of the readings separately.
    in_group : bool
        Whether the group of its stage frees it; else only its name does.
    outputs : tuple of str
        Readings of which any shows it; where it is empty, those of its stage.
    measured : Measurement, optional
        How it is measured on its own.
    """

    name: str
    quantity: Quantity
    symbol: str
    lower: float
    upper: float
    transform: Transform = "log"
    default: float | None = None
    typical: float | None = None
    likely: tuple[float, float] | None = None
    scale: float = 1.0
    least: float | None = None
    in_group: bool = True
    outputs: tuple[str, ...] = ()
    measured: Measurement | None = None

    @property
    def usual(self) -> float | None:
        """A usual size [SI]: the typical one, else the default; None where neither is known."""
        return self.default if self.typical is None else self.typical

    def check(self, value: float, *, where: str) -> None:
        """Refuse a value outside the allowed range.

        Raises
        ------
        InputError
        """
        if math.isfinite(value) and self.lower <= value <= self.upper:
            if self.transform == "count" and value != round(value):
                raise InputError(
                    f"the value {value:.15g} is not a whole number",
                    code="out-of-range",
                    where=where,
                    repair=f"give a whole number from {self.lower:g} to {self.upper:g}",
                )
            return
        unit = f" {self.quantity.unit}" if self.quantity.unit else ""
        if not math.isfinite(value) and math.isinf(self.upper):
            raise InputError(
                f"the value {value:.15g}{unit} is no finite number",
                code="out-of-range",
                where=where,
                repair=f"give {self.symbol} a finite number",
            )
        raise InputError(
            f"the value {value:.15g}{unit} is outside the allowed {self.lower:g} to {self.upper:g}{unit}",
            code="out-of-range",
            where=where,
            repair=f"give {self.symbol} within that range",
        )


@dataclass(frozen=True)
class Parameter:
    """One parameter of an actuator, with its value.

    Parameters
    ----------
    name : str
        Dotted name, such as ``"circuit.branches.0.resistivity"``.
    value : float [SI]
    unit : str
        Its SI unit; empty when it has none.
    symbol : str
    quantity : Quantity
    lower, upper : float [SI]
    transform : "log", "linear" or "count"
    standard_uncertainty : float [SI]
        0 when none was stated: the value is then taken as exact.
    """

    name: str
    value: float
    unit: str
    symbol: str
    quantity: Quantity
    lower: float
    upper: float
    transform: Transform
    standard_uncertainty: float
