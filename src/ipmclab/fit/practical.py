"""How well readings separate parameters: the combinations that they know best and worst, and sets nearly one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ipmclab.tabled import Tabled


@dataclass(frozen=True)
class Combination:
    """Parameters that move together.

    Parameters
    ----------
    coefficients : mapping of name to float
        Relative change of each along it (unit length).
    error : float
        Standard error along it, as a logarithm; infinite where the readings say nothing.
    """

    coefficients: Mapping[str, float]
    error: float


@dataclass(frozen=True)
class CollinearSet:
    """Nearly collinear parameters, and the index of them."""

    names: tuple[str, ...]
    index: float


@dataclass(frozen=True)
class Practical(Tabled):
    """How well readings separate the free parameters.

    Parameters
    ----------
    combinations : tuple of Combination
        Eigenvectors of the information, the best known first.
    collinearity : mapping of name to float
        How many times larger the error of each parameter is than it were if all others were known; 1 where it is
        uncorrelated, infinite where the readings say nothing of it.
    sets : tuple of CollinearSet
        Of each size from 2 on, the set with the largest index.
    """

    combinations: tuple[Combination, ...]
    collinearity: Mapping[str, float]
    sets: tuple[CollinearSet, ...]

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Practical:
        """As ``to_table`` wrote it."""
        return cls(
            tuple(
                Combination({name: float(part) for name, part in c["coefficients"].items()}, float(c["error"]))
                for c in table["combinations"]
            ),
            {name: float(index) for name, index in table["collinearity"].items()},
            tuple(CollinearSet(tuple(one["names"]), float(one["index"])) for one in table["sets"]),
        )
