"""Coupling: from the voltage behind the electrodes to what drives the beam."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Final

from ipmclab.model.blocks import Block, block
from ipmclab.model.parameters import Declaration, Values
from ipmclab.model.stages.kind import StageKind
from ipmclab.units import ANGULAR_RATE, COUPLING_GAIN, SQUARED_ANGULAR_RATE

GAIN: Final = "coupling.gain"
ZERO: Final = "coupling.zero"
STATIC: Final = {GAIN: 1.0, ZERO: 1.0, "coupling.p2": -1.0}
"""Powers of the parameters in d(0) = K_d Z_d/P_2d."""


@dataclass(frozen=True)
class Coupling:
    """d(s) = K_d (s + Z_d)/(s^2 + P_1d s + P_2d), poles real, equal or complex (Friend, eq. 4.12).

    The drives are d(s) V_appl [m]: (4.7) with (4.8), and (4.9), both start from that product,
    because the charge in the branches is V_appl times the same equivalent permittivity by which (4.7) divides.
    """

    displacement_fast: bool = False
    force_fast: bool = False
    """Whether a slow mode follows, which then drives the beam; this stage gives the fast part to it."""

    declarations: ClassVar[tuple[Declaration, ...]] = (
        Declaration("coupling.gain", COUPLING_GAIN, "K_d", 1e-15, 1.0, typical=1e-8),
        Declaration("coupling.zero", ANGULAR_RATE, "Z_d", 1e-6, 1e9, typical=100.0),
        Declaration("coupling.p1", ANGULAR_RATE, "P_1d", 1e-6, 1e9, typical=10.0),
        Declaration("coupling.p2", SQUARED_ANGULAR_RATE, "P_2d", 1e-12, 1e15, typical=30.0),
    )

    def block(self, values: Values) -> Block:
        """``node_voltage`` to ``displacement_drive`` and ``force_drive`` [m].

        The states are the node voltage filtered by P_2d/(s^2 + P_1d s + P_2d) [V] and its rate [V/s].
        """
        gain, p2 = values["coupling.gain"], values["coupling.p2"]
        drive = [gain * values["coupling.zero"] / p2, gain / p2]
        return block(
            states=["coupling.filtered_voltage", "coupling.filtered_voltage_rate"],
            inputs=["node_voltage"],
            outputs=[
                "fast_displacement_drive" if self.displacement_fast else "displacement_drive",
                "fast_force_drive" if self.force_fast else "force_drive",
            ],
            a=[[0.0, 1.0], [-p2, -values["coupling.p1"]]],
            b=[[0.0], [p2]],
            c=[drive, drive],
            d=[[0.0], [0.0]],
        )


KIND = StageKind("coupling", "coupling.", group="coupling", outputs=("displacement", "force"), several_minima=True)
