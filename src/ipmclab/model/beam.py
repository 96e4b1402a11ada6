"""Beam: the clamped strip that bends, or presses when it is blocked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from ipmclab.model.blocks import Block, block
from ipmclab.model.parameters import Declaration, Values
from ipmclab.units import ANGULAR_RATE, DENSITY, MODULUS, NUMBER

GAMMA: Final = 1.875
"""First solution of the clamped beam's characteristic equation, as rounded in Friend, section 4.2."""


def natural_frequency(values: Values) -> complex:
    """Undamped angular frequency of the first bending mode [rad/s] (Friend, eq. 4.7)."""
    stiffness = values["beam.modulus"] * values["geometry.thickness"] ** 2 / (12.0 * values["beam.density"])
    return GAMMA**2 * stiffness**0.5 / values["geometry.free_length"] ** 2


@dataclass(frozen=True)
class Beam:
    """Displacement and blocked force at L_s (Friend, eqs 4.7 to 4.11, constant Y).

    With eq. 4.8, eq. 4.7 collapses to 3 d L_s^2/h^2 V_appl times 1/(1 + 2 zeta s/w + s^2/w^2), for all s.
    The thesis gives no damping; 0.05 is ours. The blocked force has no beam factor (eq. 4.9).
    """

    viscoelastic: int = 0

    @property
    def declarations(self) -> tuple[Declaration, ...]:
        """The parameters of this stage."""
        modes = (
            declaration
            for i in range(self.viscoelastic)
            for declaration in (
                Declaration(f"viscoelastic.{i}.amplitude", NUMBER, f"α_{i + 1}", 0.0, 1e3, "linear", typical=0.3),
                Declaration(f"viscoelastic.{i}.damping_ratio", NUMBER, f"ζ_{i + 1}", 1e-3, 1e4, typical=2.0),
                Declaration(f"viscoelastic.{i}.frequency", ANGULAR_RATE, f"ω_{i + 1}", 1e-6, 1e9, typical=10.0),
            )
        )
        return (
            Declaration("beam.density", DENSITY, "ρ_m", 1.0, 1e5),
            Declaration("beam.modulus", MODULUS, "Y", 1e3, 1e13),
            Declaration("beam.damping_ratio", NUMBER, "ζ", 1e-6, 100.0, default=0.05),
            *modes,
        )

    def block(self, values: Values) -> Block:
        """Drives [m] to ``displacement`` [m] and ``force`` [N]; its states are displacement and velocity."""
        thickness, sensing = values["geometry.thickness"], values["geometry.sensing_length"]
        frequency = natural_frequency(values)
        displacement = 3.0 * sensing**2 / thickness**2
        force = 3.0 * thickness * values["geometry.width"] * values["beam.modulus"] / (4.0 * sensing)
        return block(
            states=["beam.displacement", "beam.velocity"],
            inputs=["displacement_drive", "force_drive"],
            outputs=["displacement", "force"],
            a=[[0.0, 1.0], [-(frequency**2), -2.0 * values["beam.damping_ratio"] * frequency]],
            b=[[0.0, 0.0], [frequency**2 * displacement, 0.0]],
            c=[[1.0, 0.0], [0.0, 0.0]],
            d=[[0.0, 0.0], [0.0, force]],
        )
