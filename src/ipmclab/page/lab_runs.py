"""The runs of the lab: its catalogue, the looks that keep that up to date, and the rows that stay in memory."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.jobs.jobs import Job, JobCancelled, Jobs
from ipmclab.page.lab import Lab

if TYPE_CHECKING:
    from ipmclab.run import Run
    from ipmclab.store.catalogue.catalogue import Catalogue
    from ipmclab.store.catalogue.query import CatalogueRow

MOST_COMPARED: Final = 8
"""Runs on one plot: so many can be distinguished."""

_KEPT_ROWS: Final = 2_000_000
"""Rows of runs that stay in memory for the next zoom."""


class LabRuns:
    """The runs of the lab.

    Parameters
    ----------
    lab : Lab
    jobs : Jobs
        One of its workers looks at the files.
    """

    def __init__(self, lab: Lab, jobs: Jobs) -> None:
        self._lab = lab
        self._jobs = jobs
        self._read: OrderedDict[tuple[str, int, int], Run] = OrderedDict()
        self._lock = threading.Lock()
        self._look: Job | None = None

    def catalogue(self) -> Catalogue:
        """The catalogue of everything in the folder."""
        from ipmclab.store.catalogue.catalogue import Catalogue

        return Catalogue(self._lab.root)

    def rows(self) -> list[CatalogueRow]:
        """The runs of the folder as the catalogue has them, without looking at files."""
        from ipmclab.store.catalogue.query import RunQuery

        known = self.catalogue()
        return known.query(RunQuery(laboratory=known.laboratory)) if known.exists else []

    def looks(self) -> Iterator[Job]:
        """Bring the catalogue up to date with the files, in a worker; wait for each of these jobs before the next.

        A look of another window takes the place of one that has not begun. The last one is the newest.
        """
        arguments = {"folder": str(self._lab.root)}
        self._look = self._jobs.submit("inspect", arguments, title="looking at the runs", replaces="inspect")
        job = None
        while job is not self._look:
            job = self._look
            yield job

    async def looked(self) -> None:
        """Look at the files, and wait until the newest look is over; a file that cannot be read stops nobody."""
        for job in self.looks():
            with contextlib.suppress(JobCancelled, IpmclabError):  # Runs says what was wrong
                await asyncio.wrap_future(job.future)

    def path(self, key: str) -> Path:
        """The file of a run, by its path below the folder.

        Raises
        ------
        InputError
            Outside the folder, or not there.
        """
        path = self._lab.path(key)
        if path.suffix.lower() != ".nc" or not path.is_file():
            raise InputError(
                f"there is no run {key!r}", code="no-such-file", where="run", repair="look at the runs again"
            )
        return path

    def read(self, key: str) -> Run:
        """A run of the lab; the last ones stay in memory.

        Raises
        ------
        InputError
            No such run, or a damaged one.
        """
        from ipmclab.store.run_file import read_run

        path = self.path(key)
        about = path.stat()
        this = (str(path), about.st_size, about.st_mtime_ns)
        with self._lock:
            if this in self._read:
                self._read.move_to_end(this)
                return self._read[this]
        run = read_run(path)
        with self._lock:
            self._read[this] = run
            while len(self._read) > 1 and sum(len(one) for one in self._read.values()) > _KEPT_ROWS:
                self._read.popitem(last=False)
        return run


def labels(keys: Sequence[str]) -> list[str]:
    """A short name for each run: that of its file, with its folder where two are called alike.

    Examples
    --------
    >>> labels(["runs/a/step.nc", "runs/b/step.nc", "sine.nc"])
    ['runs/a/step', 'runs/b/step', 'sine']
    """
    names = [Path(key).stem for key in keys]
    return [
        name if names.count(name) == 1 else Path(key).with_suffix("").as_posix()
        for key, name in zip(keys, names, strict=True)
    ]
