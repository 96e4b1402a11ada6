"""What was recovered is not whole."""

from __future__ import annotations

from ipmclab.quality.record import Record
from ipmclab.run import Finding


def cut_off(record: Record) -> list[Finding]:
    """``cut-off``: the recording did not come to the end that it should have had, or its journal was damaged."""
    about = record.run.metadata
    if about.state != "recovered":
        return []
    return [
        Finding(
            "cut-off",
            "warning",
            f"the record is what was left of a recording: {about.state_reason or 'it was cut off'}",
            "the rows are as they were read; what should have come after the last one is not there",
        )
    ]
