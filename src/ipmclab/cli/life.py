"""The life of a sample, as ``ipmclab runs --sample ID`` shows it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ipmclab.cli.output import print_lines, read, with_unit
from ipmclab.cli.run_rows import codes_cell, run_document, state_cell, what_cell
from ipmclab.units import CAPACITANCE, RELATIVE_HUMIDITY, RESISTANCE, TIME, Quantity

if TYPE_CHECKING:
    from ipmclab.store.catalogue.catalogue import Catalogue
    from ipmclab.store.catalogue.life import Event, Life
    from ipmclab.store.catalogue.query import CatalogueRow


def print_life(life: Life) -> None:
    """Print a sample's life: what it was at first and is now, then every event in its order."""
    runs = life.runs
    ended = sum(row.state in ("aborted", "recovered") for row in runs)
    known = [f"{len(runs) + len(life.undated)} runs" + (f" ({ended} ended early)" if ended else "")]
    if life.mountings:
        known.append(f"{len(life.mountings)} mounting{'s' if len(life.mountings) > 1 else ''}")
    if runs:
        known.append(f"driven for {_long(life.driven)}")
        first, last = (datetime.fromtimestamp(row.recorded or 0.0) for row in (runs[0], runs[-1]))
        known.append(f"{first:%Y-%m-%d}" + (f" to {last:%Y-%m-%d}" if last.date() != first.date() else ""))
    print(f"{life.sample}: {', '.join(known)}")
    for name, quantity, change in changes(life):
        print(f"{name}: {change_text(change, quantity)}")
    print()
    rows: list[list[str]] = []
    day = ""
    numbers = {name: number for number, name in enumerate(life.mountings, start=1)}
    for event in life.events:
        moment = datetime.fromtimestamp(event.time)
        today = f"{moment:%Y-%m-%d}"
        rows.append(["" if today == day else today, f"{moment:%H:%M:%S}", *_cells(event, numbers)])
        day = today
    for row in life.undated:
        rows.append(["no date", "", *_run_cells(row)])
    print_lines(["day", "time", "", "length", "out of water", "humidity", "R", "C", "state", "findings"], rows)


def _cells(event: Event, numbers: Mapping[str, int]) -> list[str]:
    if event.kind == "run":
        return _run_cells(event.row)
    if event.kind == "out of water":
        return ["taken out of the water", *[""] * 7]
    mounting = str(event.row.mounting)
    return [f"clamped: mounting {numbers[mounting]}, {mounting}", *[""] * 7]


def _run_cells(row: CatalogueRow) -> list[str]:
    number = f"run {row.run_number}, " if row.run_number is not None else ""
    out = "" if row.minutes_out_of_water is None else f"{row.minutes_out_of_water:.0f} min"
    return [
        f"  {number}{what_cell(row)}",
        "" if row.duration is None else read(row.duration, TIME, digits=3),
        out,
        _known(row.relative_humidity, RELATIVE_HUMIDITY, 2),
        _known(row.series_resistance, RESISTANCE, 3),
        _known(row.capacitance, CAPACITANCE, 3),
        state_cell(row),
        codes_cell(row),
    ]


def _known(value: float | None, quantity: Quantity, digits: int) -> str:
    return "" if value is None else read(value, quantity, digits=digits)


def _long(seconds: float) -> str:
    if seconds < 600.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60} min"


def changes(life: Life) -> list[tuple[str, Quantity, tuple[float, float]]]:
    """What the fingerprints show: name, quantity, and the value of the first and of the last of them."""
    found: list[tuple[str, Quantity, tuple[float, float]]] = []
    for name, quantity in (("series_resistance", RESISTANCE), ("capacitance", CAPACITANCE)):
        values = [getattr(row, name) for row in life.fingerprints]
        known = [value for value in values if value is not None]
        if known:
            found.append((name.replace("_", " "), quantity, (known[0], known[-1])))
    return found


def change_text(change: tuple[float, float], quantity: Quantity) -> str:
    """First and last value of a number, and the change between them.

    Examples
    --------
    >>> change_text((16.6, 18.9), RESISTANCE)
    '16.6 ohm at first, 18.9 ohm at last (+14 %)'
    """
    first, last = change
    if first == last:
        return read(first, quantity, digits=3)
    percent = f" ({100.0 * (last - first) / first:+.0f} %)" if first else ""
    return f"{read(first, quantity, digits=3)} at first, {read(last, quantity, digits=3)} at last{percent}"


def life_document(life: Life, catalogue: Catalogue) -> dict[str, Any]:
    """A sample's life as it is written to a JSON document."""
    return {
        "sample": life.sample,
        "mountings": life.mountings,
        "driven": with_unit(life.driven, "s"),
        "changes": {
            name.replace(" ", "_"): {"first": with_unit(first, quantity.unit), "last": with_unit(last, quantity.unit)}
            for name, quantity, (first, last) in changes(life)
        },
        "events": [
            {
                "kind": event.kind,
                "time": datetime.fromtimestamp(event.time).astimezone().isoformat("T", "seconds"),
                "mounting": event.row.mounting,
                "run": event.row.uuid or catalogue.file_of(event.row),
            }
            for event in life.events
        ],
        "runs": _documents([*life.runs, *life.undated], catalogue),
    }


def _documents(rows: Sequence[CatalogueRow], catalogue: Catalogue) -> list[dict[str, Any]]:
    return [run_document(row, catalogue) for row in rows]


def draw_life(life: Life, out: Path, *, force: bool) -> None:
    """Write a sample's life as a figure."""
    from ipmclab.reporting.figures.life import life_figure
    from ipmclab.reporting.save import save_figure

    save_figure(lambda: life_figure(life), out, overwrite=force)
