"""Runs of the catalogue as people and programs read them."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Any

from ipmclab.cli.output import print_lines, read, with_unit
from ipmclab.units import RELATIVE_HUMIDITY, TIME

if TYPE_CHECKING:
    from ipmclab.store.catalogue.catalogue import Catalogue
    from ipmclab.store.catalogue.query import CatalogueRow


def print_runs(rows: Sequence[CatalogueRow], catalogue: Catalogue) -> None:
    """Print runs as a table, the newest last, where a terminal still shows it."""
    cells = [
        [
            "" if row.recorded is None else f"{datetime.fromtimestamp(row.recorded):%Y-%m-%d %H:%M:%S}",
            row.sample or "",
            what_cell(row),
            ", ".join(row.measured),
            "" if row.duration is None else read(row.duration, TIME, digits=3),
            "" if row.relative_humidity is None else read(row.relative_humidity, RELATIVE_HUMIDITY, digits=2),
            state_cell(row),
            codes_cell(row),
            _place(row, catalogue),
        ]
        for row in rows
    ]
    print_lines(["recorded", "sample", "signal", "measured", "length", "humidity", "state", "findings", "file"], cells)


def _place(row: CatalogueRow, catalogue: Catalogue) -> str:
    """Where a run is, as short as its folder allows."""
    if row.path is None:
        return ""
    return row.path if row.laboratory == catalogue.laboratory else f"{row.laboratory}/{row.path}"


def what_cell(row: CatalogueRow) -> str:
    """What was applied, and why where that is not the signal itself."""
    drive = row.drive or ""
    return f"{row.purpose}: {drive}" if row.purpose not in (None, "signal") else drive


def state_cell(row: CatalogueRow) -> str:
    """What became of a run, and which version of it this is; nothing where all is well with the only one."""
    state_words = [] if row.state in (None, "complete") else [str(row.state)]
    return ", ".join([*state_words, *([f"version {row.version}"] if row.version > 1 else [])])


def codes_cell(row: CatalogueRow) -> str:
    """Its findings; a question mark where it was not inspected."""
    if row.codes is None:
        return "?" if row.path else ""
    return ", ".join(code for code in row.codes if code != "fingerprint")


def run_document(row: CatalogueRow, catalogue: Catalogue) -> dict[str, Any]:
    """A run of the catalogue as it is written to a JSON document."""
    return {
        "uuid": row.uuid,
        "version": row.version,
        "content_sha256": row.content_sha256,
        "file": catalogue.file_of(row),
        "state": row.state,
        "state_reason": row.state_reason,
        "problem": row.problem,
        "recorded_at": row.recorded_at,
        "origin": row.origin,
        "sample": row.sample,
        "mounting": row.mounting,
        "run_number": row.run_number,
        "purpose": row.purpose,
        "signal": row.signal,
        "drive": row.drive,
        "amplitude": with_unit(row.amplitude, "V"),
        "frequency": with_unit(row.frequency, "Hz"),
        "measured": row.measured,
        "rows": row.rows,
        "duration": with_unit(row.duration, "s"),
        "rate": with_unit(row.rate, "Hz"),
        "temperature": with_unit(row.temperature, "degC"),
        "relative_humidity": with_unit(row.relative_humidity, "percent"),
        "minutes_out_of_water": row.minutes_out_of_water,
        "minutes_in_environment": row.minutes_in_environment,
        "operator": row.operator,
        "rig": row.rig,
        "series_resistance": with_unit(row.series_resistance, "ohm"),
        "capacitance": with_unit(row.capacitance, "F"),
        "findings": row.codes,
    }
