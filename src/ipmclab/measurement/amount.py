"""A number with its standard uncertainty, and how far two of them are apart."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from ipmclab.run import Finding
from ipmclab.units import Quantity, significant

SURE: Final = 3.0
"""From so many combined standard uncertainties two numbers contradict each other (0.3 % by chance)."""


@dataclass(frozen=True)
class Amount:
    """A number that somebody measured, stated or computed.

    Parameters
    ----------
    value : float [SI]
    uncertainty : float [SI]
        One standard uncertainty; infinite where nothing is known.
    unit : str
        The unit of ``str``.
    factor : float
        Of that unit to the SI unit.
    """

    value: float
    uncertainty: float
    unit: str
    factor: float = 1.0

    @classmethod
    def of(cls, value: float, uncertainty: float, quantity: Quantity) -> Amount:
        """An amount that is shown in the display unit of a quantity."""
        return cls(value, uncertainty, quantity.display_unit, quantity.units[quantity.display_unit])

    @property
    def number(self) -> str:
        """The number in its unit, without its uncertainty."""
        return f"{shown(self.value / self.factor)} {self.unit}".rstrip()

    def __str__(self) -> str:
        """The number and its standard uncertainty: ``"0.245 ± 0.005 mm"``."""
        if not 0.0 < self.uncertainty < math.inf:
            return self.number
        return f"{shown(self.value / self.factor)} ± {shown(self.uncertainty / self.factor, 2)} {self.unit}".rstrip()

    def times(self, factor: float, unit: str) -> Amount:
        """This amount times an exact number, in another unit."""
        return Amount(self.value * factor, self.uncertainty * factor, unit)


def shown(value: float, digits: int = 3) -> str:
    """A number with so many digits, without a power of ten where it has few places.

    Examples
    --------
    >>> shown(2453.2), shown(0.19), shown(0.000012)
    ('2450', '0.19', '1.2e-05')
    """
    return significant(value, digits)


def sigmas_between(one: Amount, other: Amount) -> float:
    """Difference of two amounts in combined standard uncertainties; 0 where nothing is known of one of them.

    Examples
    --------
    >>> round(sigmas_between(Amount(1.0, 0.3, "V"), Amount(3.0, 0.4, "V")), 3)
    4.0
    """
    difference, scale = abs(one.value - other.value), math.hypot(one.uncertainty, other.uncertainty)
    if scale == 0.0:
        return math.inf if difference > 1e-9 * max(abs(one.value), abs(other.value)) else 0.0
    return difference / scale


def beyond(one: Amount, low: Amount, high: Amount) -> float:
    """How far an amount lies outside a range, in combined standard uncertainties; 0 inside it."""
    if one.value < low.value:
        return sigmas_between(one, low)
    return sigmas_between(one, high) if one.value > high.value else 0.0


def how_sure(sigmas: float) -> str:
    """The distance in words.

    Examples
    --------
    >>> how_sure(5.23)
    'they differ by 5.2 combined standard uncertainties'
    """
    return (
        "no uncertainty is stated and they differ"
        if math.isinf(sigmas)
        else f"they differ by {shown(sigmas, 2)} combined standard uncertainties"
    )


def conflict(
    code: str,
    message: str,
    experiment: str,
    *,
    found: Amount,
    expected: Amount,
    sigmas: float,
    channel: str | None = None,
    more: Mapping[str, float | int | str | None] | None = None,
) -> Finding:
    """The finding that two numbers do not belong to one strip.

    Parameters
    ----------
    code : str
    message : str
        What was compared, with both values.
    experiment : str
        The cheapest one that would decide.
    found, expected : Amount
    sigmas : float
        How far they are apart, in combined standard uncertainties.
    channel : str, optional
    more : mapping, optional
        Further numbers for ``values``, in SI units.
    """
    return Finding(
        code=code,
        severity="warning",
        message=message,
        repair=f"cheapest experiment that decides: {experiment}",
        channel=channel,
        values={
            "found": found.value,
            "found_uncertainty": found.uncertainty,
            "expected": expected.value,
            "expected_uncertainty": expected.uncertainty,
            "sigmas": sigmas,
            **(more or {}),
        },
    )
