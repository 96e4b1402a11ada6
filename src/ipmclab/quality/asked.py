"""What a simulated run carries along: where its model was asked beyond what it holds for."""

from __future__ import annotations

from dataclasses import replace

from ipmclab.quality.record import Record
from ipmclab.run import Finding


def asked_beyond(record: Record) -> list[Finding]:
    """The findings in the metadata of a simulated run.

    Without their rows, which are those of the whole simulation. What left rows without a reading is left out: the
    record shows that itself.
    """
    if record.run.metadata.origin != "simulated":
        return []
    told = [finding for finding in record.run.metadata.findings if finding.effect == "none"]
    return [replace(finding, samples=()) for finding in told]
