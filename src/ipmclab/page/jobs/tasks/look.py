"""One run looked at: its findings with their times."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ipmclab.page.jobs.frames import Frame

if TYPE_CHECKING:
    from ipmclab.page.jobs.tasks import Progress


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Check the file ``run``.

    Raises
    ------
    InputError
        It is no run.
    """
    from ipmclab.page.jobs.tasks.given import finding_row, read_runs
    from ipmclab.quality import check

    progress("checking the run")
    (record,) = read_runs([arguments["run"]])
    return Frame({"findings": [finding_row(one, record) for one in check(record)]}, {})
