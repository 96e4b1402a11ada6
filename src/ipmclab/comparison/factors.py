"""What runs are compared by: properties of the strip, of the signal, and of the air around."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from ipmclab.errors import unknown_name
from ipmclab.units import (
    AREAL_MASS,
    FREQUENCY,
    LENGTH,
    PRESSURE,
    RELATIVE_HUMIDITY,
    TEMPERATURE,
    VOLTAGE,
    Quantity,
    significant,
)


@dataclass(frozen=True)
class Factor:
    """One thing that runs may differ in.

    Parameters
    ----------
    name : str
        As it is asked for.
    label : str
        On figures.
    quantity : Quantity
    tolerance : float [SI, or of the logarithm]
        Two values no further from each other along the factor are the same level: of a regulated humidity, what it
        wanders.
    is_ratio : bool
        Whether equal ratios count as equal steps.
    """

    name: str
    label: str
    quantity: Quantity
    tolerance: float
    is_ratio: bool = False

    def coordinate(self, value: float) -> float:
        """Where a value is along the factor: the value, or its logarithm."""
        return math.log(value) if self.is_ratio else value

    def show(self, value: float) -> str:
        """A value with its unit, as people read it."""
        number = significant(self.quantity.to_display(value), 4)
        return f"{number} {self.quantity.display_unit}".strip()


FACTORS: Final = {
    factor.name: factor
    for factor in (
        Factor("thickness", "membrane thickness", LENGTH, 1e-6),
        Factor("loading", "platinum loading", AREAL_MASS, 1e-3),
        Factor("voltage", "voltage", VOLTAGE, 0.02),
        Factor("frequency", "frequency", FREQUENCY, 0.01, is_ratio=True),
        Factor("humidity", "relative humidity", RELATIVE_HUMIDITY, 3.0),
        Factor("temperature", "temperature", TEMPERATURE, 2.0),
        Factor("clamp_pressure", "clamp pressure", PRESSURE, 100.0),
    )
}


def chosen_factors(names: Sequence[str]) -> tuple[Factor, ...]:
    """The factors of these names, which may be joined by commas; all of them where none is given.

    Raises
    ------
    InputError
        An unknown name.

    Examples
    --------
    >>> [factor.label for factor in chosen_factors(["voltage,thickness"])]
    ['voltage', 'membrane thickness']
    """
    words = [word.strip() for name in names for word in name.split(",") if word.strip()]
    for word in words:
        if word not in FACTORS:
            raise unknown_name("factor", word, FACTORS, where="by")
    return tuple(FACTORS[word] for word in dict.fromkeys(words)) or tuple(FACTORS.values())


def levels_of(factor: Factor, values: Sequence[float]) -> list[float]:
    """The level of each value: the mean of those that lie within the tolerance of their neighbours.

    Examples
    --------
    >>> levels_of(FACTORS["humidity"], [79.0, 60.5, 81.0, 59.5])
    [80.0, 60.0, 80.0, 60.0]
    >>> levels_of(FACTORS["frequency"], [0.1, 1.0, 0.1]), len({*levels_of(FACTORS["frequency"], [0.1, 0.100005])})
    ([0.1, 1.0, 0.1], 1)
    """
    order = sorted(range(len(values)), key=lambda place: values[place])
    found = [0.0] * len(values)
    group: list[int] = []
    for place in order:
        if group and factor.coordinate(values[place]) - factor.coordinate(values[group[-1]]) > factor.tolerance:
            _settle(found, group, values)
            group = []
        group.append(place)
    if group:
        _settle(found, group, values)
    return found


def _settle(found: list[float], group: list[int], values: Sequence[float]) -> None:
    own = [values[place] for place in group]
    level = own[0] if len(set(own)) == 1 else sum(own) / len(own)
    for place in group:
        found[place] = level
