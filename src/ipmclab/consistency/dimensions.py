"""The dimensions of the strip against those that strips have: a unit that was written wrongly shows in them first."""

from __future__ import annotations

from typing import Final

from ipmclab.measurement.amount import shown
from ipmclab.model import Actuator
from ipmclab.run import Finding
from ipmclab.units import LENGTH

CODE: Final = "thickness-unusual"

USUAL: Final = (20e-6, 1e-3)
"""Thickness [m]: from the thinnest membranes (25 um) to several pressed on each other; Nafion is sold up to 0.25 mm
(convention)."""
_ROUNDED: Final = 1e-3  # relative: a value that is printed as the end of the range is in it (convention)


def thickness_unusual(actuator: Actuator) -> list[Finding]:
    """``thickness-unusual``: thinner or thicker than strips of Nafion are."""
    thickness, (low, high) = actuator["geometry.thickness"], USUAL
    if low * (1.0 - _ROUNDED) <= thickness <= high * (1.0 + _ROUNDED):
        return []
    has, least, most = (f"{shown(LENGTH.to_display(one))} {LENGTH.display_unit}" for one in (thickness, low, high))
    return [
        Finding(
            CODE,
            "warning",
            f"the thickness of the model is {has}; strips of Nafion have {least} to {most}",
            "look at the unit of the thickness in the actuator file (0.5 mm, and not 0.5 cm); resistivities and "
            "permittivities go with it, the stiffness with its cube",
            values={"thickness": thickness, "lowest": low, "highest": high},
        )
    ]
