"""What tasks are given by name: actuators and runs of the lab folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final

from ipmclab.store.run_file import read_run

if TYPE_CHECKING:
    from ipmclab.page.wire import FloatArray
    from ipmclab.prediction.scores import Comparison
    from ipmclab.run import Finding, Run

_SHOWN_SEPARATELY: Final = 400
"""Parts of a record that can be distinguished on a plot."""

_WHOLE: Final = 0.9
"""Of a record: what covers so much of it is said in words alone."""


def read_runs(paths: Sequence[str]) -> list[Run]:
    """Read runs.

    Raises
    ------
    InputError
        A file that is no run.
    """
    return [read_run(path) for path in paths]


def finding_row(finding: Finding, run: Run | None = None) -> dict[str, Any]:
    """A finding as the page shows it; with its run, also from when to when [s]."""
    row: dict[str, Any] = {
        "code": finding.code,
        "severity": finding.severity,
        "message": finding.message,
        "repair": finding.repair,
        "channel": finding.channel,
        "effect": finding.effect,
    }
    if run is not None:
        row["times"] = _times(finding, run)
    return row


def _times(finding: Finding, run: Run) -> list[list[float]]:
    """From when to when a finding is [s], with what no screen could show separately put together.

    Nowhere, where it concerns nearly the whole record: a mark would hide what it marks.
    """
    last = len(run.time) - 1
    near = (run.time[-1] - run.time[0]) / _SHOWN_SEPARATELY
    times: list[list[float]] = []
    for first, stop in sorted(finding.samples):
        begin, end = float(run.time[min(first, last)]), float(run.time[min(stop, last)])
        if times and begin - times[-1][1] <= near:
            times[-1][1] = max(end, times[-1][1])
        else:
            times.append([begin, end])
    marked = sum(end - begin for begin, end in times)
    return times if marked < _WHOLE * (run.time[-1] - run.time[0]) else []


def comparison_arrays(key: str, one: Comparison) -> dict[str, FloatArray]:
    """Measured, model and residual of an output, NaN where a reading does not count."""
    return {
        f"{key}.time": one.time,
        f"{key}.measured": one.measured,
        f"{key}.model": one.predicted,
        f"{key}.residual": one.error,
    }


def rows_of(rows: Sequence[Any]) -> list[dict[str, Any]]:
    """Dataclasses of a report's tables as JSON values."""
    return [asdict(row) for row in rows]
