"""One run looked at: its facts, its findings with their times, its metrics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ipmclab.page.jobs.frames import Frame

if TYPE_CHECKING:
    from ipmclab.page.jobs.tasks import Progress


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Look at the file ``run``.

    Raises
    ------
    InputError
        It is no run.
    """
    from ipmclab.page.jobs.tasks.given import finding_row, read_runs, rows_of
    from ipmclab.quality import check, measure
    from ipmclab.report.tables import metric_rows, run_facts

    progress("reading the run")
    (record,) = read_runs([arguments["run"]])
    progress("checking the run")
    findings = check(record)
    progress("measuring the run")
    return Frame(
        {
            "facts": run_facts(record),
            "findings": [finding_row(one, record) for one in findings],
            "metrics": rows_of(metric_rows(measure(record))),
        },
        {},
    )
