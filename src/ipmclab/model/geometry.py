"""Geometry: the dimensions of the strip, shared by every stage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from ipmclab.errors import InputError
from ipmclab.model.parameters import Declaration, Values
from ipmclab.units import LENGTH

DECLARATIONS: Final = (
    Declaration("geometry.free_length", LENGTH, "L_f", 1e-4, 1.0),
    Declaration("geometry.clamped_length", LENGTH, "L_c", 0.0, 1.0, "linear"),
    Declaration("geometry.width", LENGTH, "w", 1e-5, 1.0),
    Declaration("geometry.thickness", LENGTH, "h", 1e-6, 0.01),
    Declaration("geometry.sensing_length", LENGTH, "L_s", 1e-4, 1.0),
)


def check(values: Mapping[str, float], *, where: str = "") -> None:
    """Refuse dimensions that cannot belong to one strip.

    Raises
    ------
    InputError
        When the sensing point lies beyond the free end.
    """
    free, sensing = values["geometry.free_length"], values["geometry.sensing_length"]
    if sensing > free:
        raise InputError(
            f"the sensing length {sensing:g} m is beyond the free length {free:g} m",
            code="out-of-range",
            where=f"{where}geometry.sensing_length",
            repair="measure it from the clamp to where the laser or the load cell meets the strip",
        )


def area_per_thickness(values: Values) -> complex:
    """(L_f + L_c) w / h [m], which scales every element of the circuit (Friend, eqs 4.2 to 4.6)."""
    length = values["geometry.free_length"] + values["geometry.clamped_length"]
    return length * values["geometry.width"] / values["geometry.thickness"]


def area(values: Values) -> complex:
    """(L_f + L_c) w [m^2]: what is plated on each face."""
    return (values["geometry.free_length"] + values["geometry.clamped_length"]) * values["geometry.width"]


def squares(values: Values) -> complex:
    """(L_f + L_c) / w: the number of squares of one electrode (Friend, eq. 4.1)."""
    return (values["geometry.free_length"] + values["geometry.clamped_length"]) / values["geometry.width"]
