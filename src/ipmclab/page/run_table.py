"""Rows of the catalogue as the table of runs shows them, and which of them a filter leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Any, Final

from ipmclab.page.lab_runs import labels
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    from ipmclab.store.catalogue.query import CatalogueRow

MOST_SHOWN: Final = 500
"""Rows sent to a browser; who looks for one of more runs filters."""

COLUMNS: Final[list[dict[str, Any]]] = [
    {"name": "file", "label": "Run", "field": "file", "align": "left", "sortable": True, "required": True},
    {"name": "recorded", "label": "Recorded", "field": "recorded", "align": "left", "sortable": True},
    {"name": "sample", "label": "Sample", "field": "sample", "align": "left", "sortable": True},
    {"name": "mounting", "label": "Mounting", "field": "mounting", "align": "left", "sortable": True},
    {"name": "signal", "label": "Signal", "field": "signal", "align": "left", "sortable": True},
    {"name": "measured", "label": "Measured", "field": "measured", "align": "left", "sortable": True},
    {"name": "duration", "label": "Length [s]", "field": "duration", "align": "right", "sortable": True},
    {"name": "humidity", "label": "RH [%]", "field": "humidity", "align": "right", "sortable": True},
    {"name": "findings", "label": "Findings", "field": "findings", "align": "left", "sortable": True},
]
"""The columns; numbers stay numbers, so that they sort as such."""


@dataclass(frozen=True)
class RunFilter:
    """What must be true of a run that is shown; what is empty says nothing.

    Parameters
    ----------
    text : str
        Words that must all stand somewhere in its row.
    sample, measured, finding, state : str
        A sample's id; a channel; a code, or ``"any"`` or ``"none"``; what became of it.
    """

    text: str = ""
    sample: str = ""
    measured: str = ""
    finding: str = ""
    state: str = ""

    def admits(self, row: CatalogueRow) -> bool:
        """Whether a run is shown."""
        codes = [code for code in row.codes or () if code != "fingerprint"]
        if self.sample and row.sample != self.sample:
            return False
        if self.measured and self.measured not in row.measured:
            return False
        if self.state and (row.state or "complete") != self.state:
            return False
        if self.finding and not (
            (self.finding == "none" and row.codes is not None and not codes)
            or (self.finding == "any" and codes)
            or self.finding in codes
        ):
            return False
        words = self.text.casefold().split()
        if not words:
            return True
        shown = table_row(row)  # what nobody sees, such as its number here, is not searched
        everything = " ".join(str(shown[one["field"]]) for one in COLUMNS if shown[one["field"]] is not None).casefold()
        return all(word in everything for word in words)


def runs_in_words(rows: Sequence[CatalogueRow]) -> dict[str, str]:
    """Of each run that can be read, the newest first, by its path: what it was, in words by which people know it."""
    shown = [one for one in map(table_row, reversed(rows)) if one["key"]]
    return {one["key"]: ", ".join(filter(None, (one["signal"], one["sample"], one["recorded"]))) for one in shown}


def table_row(row: CatalogueRow) -> dict[str, Any]:
    """One run as the table shows it; ``key`` is its path below the folder, empty where it has no sound file."""
    codes = [code for code in row.codes or () if code != "fingerprint"]
    state = "" if row.state in (None, "complete") else str(row.state)
    version = f"version {row.version}" if row.version > 1 else ""
    if row.codes is None:
        findings = "not checked yet" if row.path and not row.problem else ""
    else:
        findings = ", ".join(codes) or "none"
    drive = row.drive or ""
    readable = row.path is not None and row.problem is None and row.state != "recording"
    return {
        "id": row.id,
        "key": row.path if readable else "",
        "file": row.path or row.uuid or "",
        "recorded": "" if row.recorded is None else f"{datetime.fromtimestamp(row.recorded):%Y-%m-%d %H:%M:%S}",
        "sample": row.sample or "",
        "mounting": row.mounting or "",
        "signal": f"{row.purpose}: {drive}" if row.purpose not in (None, "signal") else drive,
        "measured": ", ".join(CHANNELS[name].name if name in CHANNELS else name for name in row.measured),
        "duration": None if row.duration is None else float(f"{row.duration:.4g}"),
        "humidity": None if row.relative_humidity is None else float(f"{row.relative_humidity:.3g}"),
        "findings": "; ".join(part for part in (state, version, row.problem or findings) if part),
    }


def table_rows(rows: Sequence[CatalogueRow], wanted: RunFilter) -> tuple[list[dict[str, Any]], int]:
    """The rows to show, the newest first, and how many runs the filter admits."""
    admitted = [row for row in rows if wanted.admits(row)]
    found = [table_row(row) for row in admitted[::-1][:MOST_SHOWN]]
    files = [row["file"] for row in found if row["file"]]  # a run whose file is gone may have none
    names = dict(zip(files, labels(files), strict=True))
    return [{**row, "name": names.get(row["file"], "–")} for row in found], len(admitted)
