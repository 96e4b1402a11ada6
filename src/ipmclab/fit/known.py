"""A quantity that the readings determine, whatever they leave open of the parameters behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ipmclab.model.quantities import derived
from ipmclab.tabled import Tabled
from ipmclab.units import Quantity


@dataclass(frozen=True)
class Known(Tabled):
    """A quantity that follows from all parameters of a fit together.

    Parameters
    ----------
    name : str
        As ``model.quantities`` declares it; with the place of its run where each run has its own.
    value : float [SI]
    interval : pair of float [SI]
        95 %.
    leans : tuple of str
        Fixed parameters taken as exact of which 1 % moves it farther than its interval reaches, the hardest first.
    """

    name: str
    value: float
    interval: tuple[float, float]
    leans: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """What it is called in tables."""
        base, bracket, place = self.name.partition("[")
        return f"{derived(base).words}{bracket}{place}"

    @property
    def quantity(self) -> Quantity:
        """What it is a number of."""
        return derived(self.name.partition("[")[0]).quantity

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Known:
        """From what ``to_table`` gave.

        Raises
        ------
        ValueError
            No such quantity, or an interval that does not hold the value.
        """
        low, high = map(float, table["interval"])
        found = cls(str(table["name"]), float(table["value"]), (low, high), tuple(map(str, table.get("leans", ()))))
        try:
            derived(found.name.partition("[")[0])
        except KeyError:
            raise ValueError(f"no quantity is called {found.name!r}") from None
        if not low <= found.value <= high:
            raise ValueError(f"the interval of {found.name} does not hold its value")
        return found
