"""Relaxation: slow modes that oppose the coupling, so that a strip relaxes back under a constant voltage."""

from __future__ import annotations

from dataclasses import dataclass

from ipmclab.model.blocks import Block, block
from ipmclab.model.parameters import Declaration, Values
from ipmclab.units import NUMBER, TIME


@dataclass(frozen=True)
class Relaxation:
    """A drive d(s) V less d(0) times slow modes r_i/(1 + tau_i s) of the node voltage.

    With a single fast mode this is G (x1 - r x2): partial relaxation for r < 1, a zero at the origin for r = 1, and
    for r > 1 a zero in the right half plane where tau2 > r tau1.

    Parameters
    ----------
    drive : "displacement" or "force"
    modes : int
    """

    drive: str
    modes: int

    @property
    def declarations(self) -> tuple[Declaration, ...]:
        """The parameters of this stage."""
        return tuple(
            declaration
            for i in range(self.modes)
            for declaration in (
                Declaration(
                    f"relaxation.{self.drive}.{i}.ratio", NUMBER, f"r_{i + 1}", -1e3, 1e3, "linear", typical=0.5
                ),
                Declaration(
                    f"relaxation.{self.drive}.{i}.time_constant", TIME, f"τ_{i + 1}", 1e-3, 1e6, typical=10.0 * 10.0**i
                ),
            )
        )

    def block(self, values: Values) -> Block:
        """``fast_..._drive`` and ``node_voltage`` to ``..._drive``; its states are the lagged node voltages [V]."""
        level = values["coupling.gain"] * values["coupling.zero"] / values["coupling.p2"]
        indices = range(self.modes)
        rates = [1.0 / values[f"relaxation.{self.drive}.{i}.time_constant"] for i in indices]
        return block(
            states=[f"relaxation.{self.drive}.{i}.lagged_voltage" for i in indices],
            inputs=[f"fast_{self.drive}_drive", "node_voltage"],
            outputs=[f"{self.drive}_drive"],
            a=[[-rates[i] if i == j else 0.0 for j in indices] for i in indices],
            b=[[0.0, rates[i]] for i in indices],
            c=[[-level * values[f"relaxation.{self.drive}.{i}.ratio"] for i in indices]],
            d=[[1.0, 0.0]],
        )
