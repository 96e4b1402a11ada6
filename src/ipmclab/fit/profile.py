"""How the likelihood falls on both sides of a fitted value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ipmclab.tabled import Tabled


@dataclass(frozen=True)
class Profile(Tabled):
    """How much worse the readings are explained as one parameter is held and all others are fitted again.

    Parameters
    ----------
    values : tuple of float [SI]
        Of the parameter, ascending.
    excess : tuple of float
        Of chi-square over its minimum, in units of the noise that was found, at each value.
    threshold : float
        The excess at which the 95 % interval ends.
    interval : pair of float [SI]
        0 or infinite where no value is bad enough.
    is_open : pair of bool
        Whether that is so towards smaller and towards larger values.
    parabola : float [SI]
        Standard error that the curvature at the minimum promises; infinite where there is none.
    """

    values: tuple[float, ...]
    excess: tuple[float, ...]
    threshold: float
    interval: tuple[float, float]
    is_open: tuple[bool, bool]
    parabola: float

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Profile:
        """As ``to_table`` wrote it."""
        low, high = map(float, table["interval"])
        below, above = map(bool, table["is_open"])
        return cls(
            values=tuple(map(float, table["values"])),
            excess=tuple(map(float, table["excess"])),
            threshold=float(table["threshold"]),
            interval=(low, high),
            is_open=(below, above),
            parabola=float(table["parabola"]),
        )
