"""What a chamber writes as text, read strictly: half a number is none."""

from __future__ import annotations

import re
from typing import Final

_NUMBER: Final = re.compile(r"[+-]?\d{1,6}(\.\d{1,6})?([eE][+-]?\d{1,2})?")

TEMPERATURES: Final = (-100.0, 200.0)
"""What a chamber for people's rooms may report of its air [degC]: anything else is no temperature."""

HUMIDITIES: Final = (0.0, 110.0)
"""Likewise [percent]; a wet bulb without water may report somewhat more than 100."""

SAME_TEMPERATURE: Final = 1.0
SAME_HUMIDITY: Final = 5.0
"""Two readings one after the other differ by less [K, percent]."""


def number(text: str) -> float:
    """A number as an instrument writes it.

    Raises
    ------
    ValueError
        Anything else, such as ``nan`` or an empty text.

    Examples
    --------
    >>> number(" 23.0 "), number("-40")
    (23.0, -40.0)
    """
    text = text.strip()
    if _NUMBER.fullmatch(text) is None:
        raise ValueError(f"{text!r} is no number")
    return float(text)


def temperature(text: str) -> float:
    """A temperature [degC] that some air could have. Raises ValueError."""
    return _within(number(text), TEMPERATURES)


def humidity(text: str) -> float:
    """A relative humidity [percent] that some sensor could read. Raises ValueError."""
    return _within(number(text), HUMIDITIES)


def _within(value: float, ends: tuple[float, float]) -> float:
    if not ends[0] <= value <= ends[1]:
        raise ValueError(f"{value:g} is outside {ends[0]:g} to {ends[1]:g}")
    return value
