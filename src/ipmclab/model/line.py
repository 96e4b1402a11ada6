"""Line: electrodes whose resistance is spread along the strip."""

from __future__ import annotations

from dataclasses import dataclass

from ipmclab.model.blocks import Block
from ipmclab.model.parameters import Declaration, Values
from ipmclab.units import NUMBER


@dataclass(frozen=True)
class Line:
    """The electrode as an RC line.

    Parameters
    ----------
    branches : int
    kind : "modes" or "segments"
    leak : bool
    clamp : bool
    """

    branches: int
    kind: str
    leak: bool = False
    clamp: bool = False

    @property
    def declarations(self) -> tuple[Declaration, ...]:
        """The parameters of this stage."""
        from ipmclab.model.circuit import Circuit

        circuit = Circuit(self.branches, leak=self.leak, clamp=self.clamp).declarations
        typical, most = (12.0, 200.0) if self.kind == "modes" else (10.0, 200.0)
        count = Declaration(f"line.{self.kind}", NUMBER, "N", 1.0, most, "count", default=typical, typical=typical)
        return (*circuit, count)

    def law_ports(self, values: Values) -> tuple[tuple[str, str, complex], ...]:
        """Where it leaks."""
        raise NotImplementedError

    def block(self, values: Values) -> Block:
        """``voltage`` to ``current`` and ``node_voltage``."""
        raise NotImplementedError
