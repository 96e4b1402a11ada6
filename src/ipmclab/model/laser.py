"""Laser: what a laser at a fixed place reads of a strip that bends far."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ipmclab.model.parameters import Declaration
from ipmclab.units import LENGTH


@dataclass(frozen=True)
class Laser:
    """A laser fixed at L_s from the clamp, which reads the height of a strip of uniform curvature there."""

    declarations: ClassVar[tuple[Declaration, ...]] = (
        Declaration("laser.range", LENGTH, "δ_max", 1e-6, 1.0, typical=12e-3),
    )
