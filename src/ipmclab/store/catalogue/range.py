"""What a query asks of a number or a time: from where to where."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime, time, timedelta
from typing import Final

from ipmclab.errors import InputError
from ipmclab.units import Quantity, parse_number, parse_quantity

_SLACK: Final = 1e-9
"""Relative to a bound: 1.1 V that was computed from other digits is still 1.1 V."""


@dataclass(frozen=True)
class Range:
    """Numbers from ``low`` to ``high`` [SI], both included; infinite where open."""

    low: float = -math.inf
    high: float = math.inf

    @property
    def bounds(self) -> tuple[float, float]:
        """The bounds with the slack that rounding needs."""
        return self.low - _SLACK * abs(self.low), self.high + _SLACK * abs(self.high)

    def __contains__(self, value: float) -> bool:
        low, high = self.bounds
        return low <= value <= high


def parse_range(text: str, quantity: Quantity, *, where: str, single: bool = False) -> Range:
    """Read a range such as ``"0.9 V..1.1 V"``.

    Parameters
    ----------
    text : str
        Two numbers with their unit and ``..`` between them; the first may leave its unit to the second,
        and one of them may be left out.
    quantity : Quantity
    where : str
        Where the text is, for the message.
    single : bool
        Whether one number alone may be given: a commanded value is exact, a measured one never is.

    Returns
    -------
    range : Range [SI unit of the quantity]

    Raises
    ------
    InputError
        No range, a number without its unit or with that of something else, a range from high to low.

    Examples
    --------
    >>> from ipmclab.units import RELATIVE_HUMIDITY, VOLTAGE
    >>> parse_range("0.9..1.1 V", VOLTAGE, where="--amplitude")
    Range(low=0.9, high=1.1)
    >>> parse_range("78 percent..", RELATIVE_HUMIDITY, where="--humidity")
    Range(low=78.0, high=inf)
    """
    example = f"'10 {quantity.display_unit}..20 {quantity.display_unit}'"
    first, dots, second = (part.strip() for part in text.partition(".."))
    if not dots:
        value = parse_quantity(text, quantity, where=where)
        if single:
            return Range(value, value)
        raise InputError(
            f"{text!r} is one value, and a measured {quantity.name} is never exactly that",
            code="no-range",
            where=where,
            repair=f"give a range, for example {example}",
        )
    if second.startswith(".") or ".." in second or not (first or second):
        raise InputError(
            f"{text!r} is not a range",
            code="bad-range",
            where=where,
            repair=f"write two numbers with two dots between them, for example {example}",
        )
    if first and second:
        _, unit = parse_number(first, where=where)
        if not unit:
            first = f"{first} {parse_number(second, where=where)[1]}"
    low = parse_quantity(first, quantity, where=where) if first else -math.inf
    high = parse_quantity(second, quantity, where=where) if second else math.inf
    if low > high:
        raise InputError(
            f"{text!r} goes from high to low", code="bad-range", where=where, repair=f"write '{second}..{first}'"
        )
    return Range(low, high)


def parse_moment(text: str, *, where: str, end: bool = False) -> float:
    """Read a date, with or without a time of day, as seconds since 1970.

    Parameters
    ----------
    text : str
        ISO 8601, for example ``2026-11-21`` or ``2026-11-21 14:30``; without an offset the time of this computer.
    where : str
        Where the text is, for the message.
    end : bool
        Whether a date without a time of day means its end.

    Raises
    ------
    InputError
        No such date.

    Examples
    --------
    >>> parse_moment("1970-01-02T00:00:00+00:00", where="--since")
    86400.0
    >>> parse_moment("2026-11-21", where="--until", end=True) - parse_moment("2026-11-21", where="--since") > 86399.0
    True
    """
    try:
        moment = datetime.fromisoformat(text.strip())
        if end and moment.timetz() == time() and ":" not in text and "T" not in text:
            moment += timedelta(days=1, microseconds=-1)
        return moment.timestamp()
    except (ValueError, OverflowError, OSError) as error:
        raise InputError(
            f"{text!r} is not a date: {error}",
            code="bad-date",
            where=where,
            repair="write for example 2026-11-21 or '2026-11-21 14:30'",
        ) from error


def seconds_of(recorded_at: str | None) -> float | None:
    """The time of a run [s since 1970]; None where it has none that can be read."""
    try:
        return datetime.fromisoformat(recorded_at or "").timestamp()
    except (ValueError, OverflowError, OSError):
        return None
