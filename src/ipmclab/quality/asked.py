"""What a run carries along: where the model of a simulated one was asked too much, and what was done to a record."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from ipmclab.quality.record import Record
from ipmclab.run import Finding

DONE: Final = ("smoothed",)
"""Codes of findings that say what was done to a record."""


def asked_beyond(record: Record) -> list[Finding]:
    """The findings in the metadata of a simulated run, and of any run what was done to it.

    Without their rows, which are those of the whole simulation. What left rows without a reading is left out: the
    record shows that itself.
    """
    about = record.run.metadata
    own = [one for one in about.findings if one.effect == "none" and (about.origin == "simulated" or one.code in DONE)]
    return [replace(finding, samples=()) for finding in own]
