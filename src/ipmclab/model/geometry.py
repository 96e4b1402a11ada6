"""Geometry: the dimensions of the strip, shared by every stage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from ipmclab.errors import InputError
from ipmclab.model.parameters import Declaration, Measurement, Values
from ipmclab.model.stages.kind import StageKind
from ipmclab.units import LENGTH, NUMBER

DECLARATIONS: Final = (
    Declaration(
        *("geometry.free_length", LENGTH, "L_f", 1e-4, 1.0),
        typical=25e-3,
        measured=Measurement("measure the free length", 2),
    ),
    Declaration(
        *("geometry.clamped_length", LENGTH, "L_c", 0.0, 1.0, "linear"),
        typical=5e-3,
        scale=1e-3,
        measured=Measurement("measure the clamped length", 3),
    ),
    Declaration(
        *("geometry.width", LENGTH, "w", 1e-5, 1.0),
        typical=5e-3,
        measured=Measurement("measure the width", 4),
    ),
    Declaration(
        *("geometry.thickness", LENGTH, "h", 1e-6, 0.01),
        typical=0.2e-3,
        measured=Measurement("measure the thickness", 5),
    ),
    Declaration(
        *("geometry.sensing_length", LENGTH, "L_s", 1e-4, 1.0),
        typical=20e-3,
        measured=Measurement("measure where the sensor is mounted", 6),
    ),
)

KIND: Final = StageKind("geometry", "geometry.", outputs=("current", "displacement", "force"), electrical=True)
"""No stage, but every stage has its dimensions."""

DIMENSIONS: Final = frozenset(declaration.name for declaration in DECLARATIONS)

DIRECT_SHARE: Final = Declaration("clamp.direct_share", NUMBER, "φ_c", 0.0, 1.0, "linear", typical=1.0)
"""How much of the clamped section the contacts feed at once: it charges without bending."""


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


def direct_length(values: Values) -> complex:
    """The part of the clamped section that is fed at once, without electrodes in between [m]; 0 without a clamp."""
    return values.get("clamp.direct_share", 0.0) * values["geometry.clamped_length"]


def line_length(values: Values) -> complex:
    """What the electrodes have to feed [m]: the free length and the rest of the clamped section."""
    return values["geometry.free_length"] + values["geometry.clamped_length"] - direct_length(values)


def electrodes(values: Values, length: complex) -> complex:
    """What both electrodes together have along a length of strip [ohm]."""
    return 2.0 * values["circuit.sheet_resistance"] * length / values["geometry.width"]


def squares(values: Values) -> complex:
    """(L_f + L_c) / w: the number of squares of one electrode (Friend, eq. 4.1).

    The thesis draws its L_t and gives no number. The ``Lt`` of its appendix A.1 is the free length alone, for which
    R_e = 8 ohm would mean 1.6 and not 1.33 ohm a square. Nothing but R_e enters a simulation.
    """
    return (values["geometry.free_length"] + values["geometry.clamped_length"]) / values["geometry.width"]
