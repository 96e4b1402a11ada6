"""A figure of runs, written where it can be downloaded from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ipmclab.page.jobs.frames import Frame

if TYPE_CHECKING:
    from ipmclab.page.jobs.tasks import Progress


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Draw the files ``runs`` with their ``labels`` to ``out`` (.svg, .png or .pdf)."""
    from ipmclab.page.jobs.tasks.given import read_runs
    from ipmclab.reporting import plot

    progress("drawing")
    written = plot(read_runs(arguments["runs"]), arguments["out"], labels=arguments["labels"], overwrite=True)
    return Frame({"out": str(written)}, {})
