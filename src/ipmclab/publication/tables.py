"""Tables of what a folder holds, as text that any program reads; all numbers in SI units."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

from ipmclab.publication.inventory import Item

RUNS = "tables/runs.csv"
METRICS = "tables/metrics.csv"
PARAMETERS = "tables/parameters.csv"

ABOUT = {
    RUNS: "One row for each run: its file, sample, signal and conditions",
    METRICS: "One row for each metric of each run",
    PARAMETERS: "One row for each parameter of each fit, with its standard error and 95 % interval",
}
"""What each table holds."""


def tables(items: Sequence[Item]) -> dict[str, str]:
    """The tables by the name of their file; without those that would be empty.

    Parameters
    ----------
    items : sequence of Item
    """
    runs = [(one.name, one.run) for one in items if one.run is not None]
    fits = [(one.name, one.fit) for one in items if one.fit is not None]
    found = {}
    if runs:
        found[RUNS] = _text(
            (
                *("file", "sample", "signal", "origin", "recorded_at", "operator", "mounting", "rows", "rate (Hz)"),
                *("duration (s)", "temperature (degC)", "relative_humidity (percent)", "channels", "content_sha256"),
            ),
            (
                (
                    name,
                    "" if run.metadata.sample is None else run.metadata.sample.id,
                    run.metadata.signal or "",
                    run.metadata.origin,
                    run.metadata.recorded_at or "",
                    run.metadata.operator or "",
                    run.metadata.mounting_id or "",
                    run.rows,
                    run.rate,
                    run.duration,
                    _known(run.metadata.temperature),
                    _known(run.metadata.relative_humidity),
                    " ".join(run.channels),
                    run.content_sha256,
                )
                for name, run in runs
            ),
        )
        found[METRICS] = _text(
            ("file", "channel", "metric", "value (SI)", "low (SI)", "high (SI)", "unit", "definition"),
            (
                (name, one.channel, one.name, one.value, *(one.interval or ("", "")), one.unit, one.definition)
                for name, run in runs
                for one in run.metrics
            ),
        )
    if fits:
        found[PARAMETERS] = _text(
            ("file", "parameter", "value (SI)", "standard_error (SI)", "low (SI)", "high (SI)", "determined", "unit"),
            (
                (name, one.name, one.value, one.standard_error, *one.interval, str(one.determined).lower(), one.unit)
                for name, fit in fits
                for one in fit.parameters.values()
            ),
        )
    return found


def _known(value: float | None) -> float | str:
    return "" if value is None else value


def _text(heading: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    stream = io.StringIO()
    table = csv.writer(stream, lineterminator="\r\n")
    table.writerow(heading)
    table.writerows(rows)
    return stream.getvalue()
