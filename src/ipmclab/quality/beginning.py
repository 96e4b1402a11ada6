"""A record that was begun, or cut, when the voltage was already on."""

from __future__ import annotations

from typing import Final

from ipmclab.quality.record import Record
from ipmclab.run import Finding

REPAIR: Final = "keep some rows from before the voltage is switched on when cutting or starting a record"


def begins_under_voltage(record: Record) -> list[Finding]:
    """``begins-under-voltage``: the voltage is on from row 0 and stays, and nothing shows when it was switched on.

    What a strip does under a constant voltage depends on how long it has been on.
    """
    if not record.shows_no_edge:
        return []
    voltage = float(record.run.voltage[0])
    return [
        Finding(
            code="begins-under-voltage",
            severity="warning",
            message=(
                f"the record begins under voltage ({voltage:.4g} V at row 0) and has no edge: the state at its start "
                "is not known"
            ),
            repair=f"{REPAIR}; a model starts from rest, and its scales are not judged here",
            values={"voltage": voltage},
        )
    ]
