"""A figure of runs, written where it can be downloaded from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ipmclab.page.jobs.frames import Frame

if TYPE_CHECKING:
    from ipmclab.page.jobs.tasks import Progress


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Draw the files ``runs`` to ``out`` (.svg, .png or .pdf)."""
    from ipmclab.page.jobs.tasks.given import read_runs
    from ipmclab.reporting import plot

    progress("drawing")
    labels = [Path(path).stem for path in arguments["runs"]]
    written = plot(read_runs(arguments["runs"]), arguments["out"], labels=labels, overwrite=True)
    return Frame({"out": str(written)}, {})
