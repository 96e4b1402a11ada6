"""What a run says of itself, and its metrics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ipmclab.page.jobs.frames import Frame

if TYPE_CHECKING:
    from ipmclab.page.jobs.tasks import Progress


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Measure the file ``run``.

    Raises
    ------
    InputError
        It is no run.
    """
    from ipmclab.page.jobs.tasks.given import read_runs, rows_of
    from ipmclab.quality import measure
    from ipmclab.reporting.tables import metric_rows, run_facts

    progress("measuring the run")
    (record,) = read_runs([arguments["run"]])
    return Frame({"facts": run_facts(record), "metrics": rows_of(metric_rows(measure(record)))}, {})
