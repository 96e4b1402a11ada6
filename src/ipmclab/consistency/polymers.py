"""What the data sheets say of membranes."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

PLATINUM: Final = 21450.0
"""Density of dense platinum [kg/m^3] (physical constant)."""

WATER: Final = 0.018015
"""Molar mass of water [kg/mol] (physical constant)."""


@dataclass(frozen=True)
class Membrane:
    """A membrane as it is sold, at 23 degC and 50 % relative humidity.

    Parameters
    ----------
    name : str
    thickness : float [m]
    basis_weight : float [kg/m^2]
    thickening : float
        Largest part by which it thickens in water.
    least_uptake, largest_uptake : float
        Mass of water over mass of polymer after a day in water.
    """

    name: str
    thickness: float
    basis_weight: float
    thickening: float
    least_uptake: float
    largest_uptake: float


EQUIVALENT_WEIGHT: Final = 1.100
"""Polymer [kg] that holds one mole of acid groups: N115, N117, N1110 (data sheet)."""

_LEAST: Final = 12.0 * WATER / EQUIVALENT_WEIGHT
"""12 molecules of water for each acid group: a membrane that was dried hot and then lay in water at 25 degC
(convention)."""


def _nafion(name: str, micrometres: float, grams: float) -> Membrane:
    # Data sheet of DuPont's N-115, N-117, N-1110: thickness, basis weight; 14 % thicker and 38 % water after 100 degC.
    return Membrane(name, micrometres * 1e-6, grams * 1e-3, 0.14, _LEAST, 0.38)


MEMBRANES: Final = {
    "115": _nafion("N115", 127.0, 250.0),
    "117": _nafion("N117", 183.0, 360.0),
    "1110": _nafion("N1110", 254.0, 500.0),
}
"""By the number in the name (data sheet)."""


def membrane_of(text: str | None) -> Membrane | None:
    """The membrane that a sample names; None for one that is not in the table.

    Examples
    --------
    >>> membrane_of("Nafion N-1110").name, membrane_of("Aquivion E98")
    ('N1110', None)
    """
    if text is None:
        return None
    found = re.search(r"\bn(?:afion)?[\s_-]*n?[\s_-]*(\d{3,4})\b", text.lower())
    return MEMBRANES.get(found.group(1)) if found else None
