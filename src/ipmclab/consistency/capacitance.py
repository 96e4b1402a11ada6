"""Capacitance per area against what strips have."""

from __future__ import annotations

from ipmclab.consistency.known import KnownStrip, Values
from ipmclab.measurement.amount import SURE, Amount, beyond, conflict, how_sure
from ipmclab.run import Finding

CODE = "capacitance-out-of-range"

LITERATURE = (10.0, 1000.0)
"""Capacitance per area of one face [F/m^2]: smooth metal at the lower end, deep dendrites at the upper.

The open records of four strips lie at 120 to 180.
 (convention from published strips, checked against the open records)."""


def capacitance_out_of_range(known: KnownStrip) -> list[Finding]:
    """``capacitance-out-of-range``: the branches together hold more or less charge than such electrodes do."""
    names = [name for name in known.values if name.startswith("circuit.branches.") and name.endswith(".permittivity")]

    def per_area(values: Values) -> float:
        return sum(values[name] for name in names) / values["geometry.thickness"]

    of = (*names, "geometry.thickness")
    found = Amount(per_area(known.values), known.standard_uncertainty(per_area, of), "F/m^2")
    low, high = (Amount(end, 0.0, "F/m^2") for end in LITERATURE)
    sigmas = beyond(found, low, high)
    if sigmas <= SURE:
        return []
    return [
        conflict(
            CODE,
            f"the branches together hold {found}; known strips have {low.number} to {high.number} (open "
            f"records of four strips 120 to 180 F/m^2): {how_sure(sigmas)}" + known.taken(of),
            "record the current of a 0.1 V step for a minute and integrate it: at 0.1 V there is no leak that could "
            "pass for charge",
            found=found,
            expected=high if found.value > high.value else low,
            sigmas=sigmas,
        )
    ]
