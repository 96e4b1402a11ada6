"""Step 4: the density from mass and volume (Friend, section 4.5)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from ipmclab.measurement.uncertain import Uncertain, derived
from ipmclab.procedure.step import Result, Step, advice_for, assumed_finding
from ipmclab.units import DENSITY

NAME: Final = "beam.density"

LEAST: Final = 500.0
MOST: Final = 21_450.0
"""What the density of an IPMC can be [kg/m^3]: no ionomer that holds water is half as light as water, and one of
nothing but platinum, the densest of its metals, has 21 450 (CRC Handbook)."""


def density(mass: Uncertain, known: Mapping[str, Uncertain]) -> Step:
    """rho_m = m/((L_f + L_c) w h): of the wet strip, as it works.

    Parameters
    ----------
    mass : Uncertain [kg]
    known : mapping of dotted name to Uncertain
        The dimensions.
    """
    found = derived(
        lambda m, free, clamped, w, h: m / ((free + clamped) * w * h),
        mass,
        *(known[f"geometry.{name}"] for name in ("free_length", "clamped_length", "width", "thickness")),
    )
    return Step(
        "density",
        "density from mass and volume",
        "ρ_m = m/((L_f + L_c) w h)",
        {NAME: Result(found, DENSITY, "ρ_m")},
        findings=assumed_finding([found]),
        advice=advice_for(found),
    )
