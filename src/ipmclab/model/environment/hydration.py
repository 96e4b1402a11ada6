"""Hydration: the parameters of the water in a membrane, and the state to which all laws refer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from ipmclab.model.environment.conditions import COLDEST, WARMEST, Environment, WaterState
from ipmclab.model.environment.sorption import COEFFICIENTS, ISOTHERMS, PREFIX, water_content
from ipmclab.model.parameters import Declaration, Measurement
from ipmclab.model.stages.kind import StageKind
from ipmclab.units import CONCENTRATION, DIFFUSIVITY, MASS_TRANSFER, NUMBER, TEMPERATURE, TIME

HYDRATION: Final = "hydration."
REFERENCE_CONTENT: Final = "hydration.reference_water_content"
REFERENCE_TEMPERATURE: Final = "hydration.reference_temperature"
PERCOLATION: Final = "hydration.percolation"
SITES: Final = "hydration.site_density"
LIQUID: Final = "hydration.liquid_water_content"
FILM: Final = "hydration.film"
ASYMMETRY: Final = "hydration.asymmetry"
SWELLING: Final = "hydration.linear_swelling"

_SORPTION: Final = tuple(
    Declaration(f"{PREFIX}{name}", NUMBER, f"s_{power}", -1e3, 1e3, "linear", default=value)
    for power, (name, value) in enumerate(ISOTHERMS["zawodzinski-H"].items())
)

DECLARATIONS: Final = (
    Declaration(
        *(REFERENCE_CONTENT, NUMBER, "λ_0", 0.1, 100.0),
        typical=7.219,  # of 80 %RH in Zawodzinski's isotherm
        measured=Measurement("weigh the strip in its state of reference, and dry", 9),
    ),
    Declaration(REFERENCE_TEMPERATURE, TEMPERATURE, "T_0", COLDEST, WARMEST, "linear", typical=20.0),
    # Springer's conductivity vanishes at 0.326/0.5139.
    Declaration(PERCOLATION, NUMBER, "λ_p", 0.0, 10.0, "linear", default=0.634),
    # A boiled membrane of the H+ form; less where it was dried hot.
    Declaration(LIQUID, NUMBER, "λ_w", 0.1, 200.0, default=22.0, likely=(14.0, 24.0)),
    # Density 1980 kg/m^3 over 1.1 kg for each mol of sulfonate (Springer, 1991).
    Declaration(SITES, CONCENTRATION, "C_s", 1.0, 1e5, default=1800.0),
    # Still air by the analogy of heat and mass, from 4 to 10 W/(m^2 K).
    Declaration(FILM, MASS_TRANSFER, "k_a", 1e-6, 10.0, default=5e-3, likely=(3e-3, 10e-3)),
    Declaration(ASYMMETRY, NUMBER, "α_s", 0.01, 1e3, default=1.0),
    Declaration("hydration.face_difference", NUMBER, "β_f", -1.0, 1.0, "linear", default=0.0),
    # Published values span four decades, by method.
    Declaration("hydration.diffusivity", DIFFUSIVITY, "D_w", 1e-16, 1.0, default=1e-10, likely=(1e-12, 5e-10)),
    # A strip of 0.25 mm between two films of 7 W/(m^2 K).
    Declaration("hydration.thermal_time", TIME, "τ_T", 0.0, 1e6, "linear", default=60.0, scale=60.0),
    Declaration("hydration.drag", NUMBER, "ξ", 0.0, 100.0, "linear", default=2.5),
    Declaration(SWELLING, NUMBER, "β_w", -1.0, 1.0, "linear", default=0.0, scale=0.01),
    *_SORPTION,
    Declaration(f"{PREFIX}scale", NUMBER, "s", 0.01, 100.0, default=1.0, likely=(0.8, 1.25)),
)

COATING: Final = (
    Declaration("hydration.coating.transfer", MASS_TRANSFER, "k_c", 1e-12, 10.0, typical=1e-5),
    Declaration("hydration.coating.bare_edge", NUMBER, "φ_e", 0.0, 10.0, "linear", default=0.0, scale=0.05),
)

STANDARD: Final[Mapping[str, float]] = {
    declaration.name: declaration.usual for declaration in DECLARATIONS if declaration.usual is not None
}
"""Nafion of the H+ form, with 80 %RH and 20 degC as its state of reference."""

KINDS: Final = (
    StageKind("hydration", "hydration.", outputs=("current", "displacement", "force"), electrical=True),
    StageKind("hydration.coating", "hydration.coating.", outputs=("current", "displacement", "force"), electrical=True),
)

assert tuple(one.name.removeprefix(PREFIX) for one in _SORPTION) == COEFFICIENTS


def reference(values: Mapping[str, float]) -> WaterState:
    """The state in which an actuator has the parameters that it states.

    Examples
    --------
    >>> reference(STANDARD)
    WaterState(water_content=7.219, temperature=20.0, relative_humidity=None, origin='assumed')
    """
    return WaterState(values[REFERENCE_CONTENT], values[REFERENCE_TEMPERATURE])


def equilibrium(values: Mapping[str, float], environment: Environment) -> WaterState:
    """The state of a membrane that has been in an environment for long.

    Examples
    --------
    >>> round(equilibrium(STANDARD, Environment(20.0, 50.0)).water_content, 6)
    3.4855
    """
    humidity = environment.relative_humidity
    content = values[LIQUID] if environment.in_water else float(water_content(values, humidity / 100.0))
    return WaterState(content, environment.temperature, humidity)
