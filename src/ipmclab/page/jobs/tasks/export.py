"""A run in another format, written where it can be downloaded from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ipmclab.page.jobs.frames import Frame

if TYPE_CHECKING:
    from ipmclab.page.jobs.tasks import Progress


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Write the file ``run`` as ``out`` (.csv, .xlsx or .mat)."""
    from ipmclab.page.jobs.tasks.given import read_runs
    from ipmclab.store.exporting import export_run

    progress("writing")
    export_run(read_runs([arguments["run"]])[0], arguments["out"], overwrite=True)
    return Frame({"out": arguments["out"]}, {})
