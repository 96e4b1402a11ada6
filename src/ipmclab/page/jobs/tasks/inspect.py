"""The catalogue brought up to date with its files, and findings of runs that nobody has looked into yet."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ipmclab.page.jobs.frames import Frame

if TYPE_CHECKING:
    from ipmclab.page.jobs.tasks import Progress


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Sweep ``folder``; the document names what could not be read."""
    from ipmclab.rig.experiments.fingerprint import inspect
    from ipmclab.store.catalogue.catalogue import Catalogue

    def tell(done: int, of: int) -> None:
        progress(f"run {done} of {of}", done / of if of else None)

    swept = Catalogue(arguments["folder"]).sweep(inspect, tell)
    problems = [{"path": one.path, "message": one.message} for one in swept.problems]
    return Frame({"files": swept.files, "added": swept.added, "problems": problems}, {})
