"""Step 1: the sheet resistance by four probes (Friend, section 3.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ipmclab.identify.procedure.amounts import Uncertain, derived, exact, mean_of
from ipmclab.identify.procedure.hand import taken
from ipmclab.model.four_probe import Contacts, sheet_factor
from ipmclab.rig.channels import FourProbe

OFFSET = "offset of the meter"
_RECTANGLE = 3.0**-0.5
"""Standard deviation of what may lie anywhere within a limit, as a part of the limit."""


@dataclass(frozen=True)
class FourProbes:
    """Four contacts and what the meter read between the inner two.

    Parameters
    ----------
    contacts : "line" or "points"
    resistance : Uncertain [ohm]
        With the scatter of the readings, without the meter's offset.
    spacing : Uncertain [m]
        Between the inner contacts; of points, between neighbours.
    offset : float [ohm]
        By how much the meter may read wrong everywhere; counted as anywhere within.
    zero : Uncertain [ohm], optional
        What it read with the contacts shorted; then there is no other offset.
    """

    contacts: Contacts
    resistance: Uncertain
    spacing: Uncertain
    offset: float = 0.05
    zero: Uncertain | None = None

    @classmethod
    def of_rig(cls, probe: FourProbe, readings: list[float], zero: float | None = None) -> FourProbes:
        """What a rig's own meter read; its spacing is known as well as contacts are placed by hand."""
        spread = taken("spacing", probe.spacing)
        return cls(
            probe.contacts,
            mean_of(readings, "scatter of the readings of the meter"),
            Uncertain(probe.spacing, {"spacing": spread}, frozenset({"spacing"})),
            probe.offset,
            None if zero is None else exact(zero),
        )


def sheet_resistance(probes: FourProbes, width: Uncertain, length: Uncertain) -> Uncertain:
    """The resistance of a square [ohm/sq]: R_s = R w/d for lines across the strip, ``point_factor`` for points.

    Parameters
    ----------
    probes : FourProbes
    width, length : Uncertain [m]
        Of the whole strip; the length matters for points only.

    Examples
    --------
    >>> probes = FourProbes("line", exact(2.667), exact(10e-3))
    >>> found = sheet_resistance(probes, exact(5e-3), exact(30e-3))
    >>> round(found.value, 3), round(found.uncertainty / found.value, 4), list(found.shares)
    (1.333, 0.0108, ['offset of the meter'])
    """
    zero = Uncertain(0.0, {OFFSET: _RECTANGLE * probes.offset}) if probes.zero is None else probes.zero

    def square(read: float, off: float, spacing: float, across: float, along: float) -> float:
        return (read - off) * sheet_factor(probes.contacts, spacing, across, along)

    if probes.contacts == "line":
        length = exact(math.inf)  # it does not matter, and neither does how well it is known
    return derived(square, probes.resistance, zero, probes.spacing, width, length)
