"""What all sections share: the lab, its catalogue, the workers, the curves and fits that are kept while it runs."""

from __future__ import annotations

import os
import secrets
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ipmclab.errors import InputError
from ipmclab.page.curves import CurveStore
from ipmclab.page.jobs.jobs import Job, Jobs
from ipmclab.page.lab import Lab

if TYPE_CHECKING:
    from ipmclab.page.commands import Step
    from ipmclab.run import Run
    from ipmclab.store.catalogue.catalogue import Catalogue
    from ipmclab.store.catalogue.query import CatalogueRow

_KEPT_ROWS: Final = 2_000_000
"""Rows of runs that stay in memory for the next zoom."""

FITS: Final = "fits"


@dataclass
class FitCard:
    """One fit of this session: what was asked, its job, and what is shown of it.

    Parameters
    ----------
    name : str
        As people call it; the file's name once it is saved.
    actuator : str
        What it started from.
    runs, free, per_run : sequence of str
    file : Path
        The fitted actuator; beside the lab until it is saved.
    job : Job
    step : Step
        The same as a command and as Python.
    """

    name: str
    actuator: str
    runs: tuple[str, ...]
    free: tuple[str, ...]
    per_run: tuple[str, ...]
    file: Path
    job: Job
    step: Step
    key: str = field(default_factory=lambda: secrets.token_hex(4))
    saved: str | None = None
    document: dict[str, Any] = field(default_factory=dict)
    curves: str | None = None


class Workshop:
    """What all sections share; one for each server.

    Parameters
    ----------
    lab : Lab
    """

    def __init__(self, lab: Lab) -> None:
        self.lab = lab
        self.jobs = Jobs()
        self.curves = CurveStore()
        self.fits: list[FitCard] = []
        self._folder = tempfile.TemporaryDirectory(prefix="ipmclab-page-")
        self.scratch = Path(self._folder.name)
        self._runs: OrderedDict[tuple[str, int, int], Run] = OrderedDict()
        self._lock = threading.Lock()

    def close(self) -> None:
        """End the workers, and forget what was not saved."""
        self.jobs.close()
        self._folder.cleanup()

    def catalogue(self) -> Catalogue:
        """The catalogue of everything in the folder."""
        from ipmclab.store.catalogue.catalogue import Catalogue

        return Catalogue(self.lab.root)

    def rows(self) -> list[CatalogueRow]:
        """The runs of the folder as the catalogue has them, without looking at files."""
        from ipmclab.store.catalogue.query import RunQuery

        known = self.catalogue()
        return known.query(RunQuery(laboratory=known.laboratory)) if known.exists else []

    def run_keys(self) -> list[str]:
        """The paths below the folder of all runs that can be read, the newest first."""
        rows = reversed(self.rows())
        return [row.path for row in rows if row.path and not row.problem and row.state != "recording"]

    def look_again(self) -> Job:
        """Bring the catalogue up to date with the files, in a worker."""
        return self.jobs.submit(
            "inspect", {"folder": str(self.lab.root)}, title="looking at the runs", replaces="inspect"
        )

    def run_path(self, key: str) -> Path:
        """The file of a run, by its path below the folder.

        Raises
        ------
        InputError
            Outside the folder, or not there.
        """
        path = self.lab.path(key)
        if path.suffix.lower() != ".nc" or not path.is_file():
            raise InputError(
                f"there is no run {key!r}", code="no-such-file", where="run", repair="look at the runs again"
            )
        return path

    def read_run(self, key: str) -> Run:
        """A run of the lab; the last ones stay in memory.

        Raises
        ------
        InputError
            No such run, or a damaged one.
        """
        from ipmclab.store.run_file import read_run

        path = self.run_path(key)
        about = path.stat()
        this = (str(path), about.st_size, about.st_mtime_ns)
        with self._lock:
            if this in self._runs:
                self._runs.move_to_end(this)
                return self._runs[this]
        run = read_run(path)
        if run.metadata.source_file is None and run.metadata.signal is None:
            run = replace(run, metadata=replace(run.metadata, source_file=path.name))
        with self._lock:
            self._runs[this] = run
            while len(self._runs) > 1 and sum(len(one) for one in self._runs.values()) > _KEPT_ROWS:
                self._runs.popitem(last=False)
        return run

    def new_scratch(self, suffix: str) -> Path:
        """A new file that goes when the server does."""
        return self.scratch / f"{secrets.token_hex(8)}{suffix}"

    def actuators(self) -> dict[str, str]:
        """Actuators that can be chosen: what is loaded, and what it is called."""
        return {**{name: name for name in self.library()}, **{name: name for name in self.own_actuators()}}

    @staticmethod
    def library() -> list[str]:
        """Actuators that come along, the one of the thesis's tables first."""
        from ipmclab.model.actuator_file import library_names

        return sorted(library_names(), key=lambda name: (name != "friend-2", name))

    def own_actuators(self) -> list[str]:
        """Actuator files of the lab, by their path below the root."""
        import tomllib

        found = []
        for path in self.lab.tables():
            try:
                table = tomllib.loads(path.read_text(encoding="utf-8-sig"))
            except (OSError, ValueError, RecursionError):
                continue
            if "geometry" in table and "circuit" in table:
                found.append(self.lab.below(path))
        return found

    def actuator_path(self, name: str) -> str:
        """What ``load_actuator`` is given for a name of the page: a fit of this session, a file of the lab, or the
        library, with stages behind a plus.

        Raises
        ------
        InputError
            A file outside the lab.
        """
        for card in self.fits:
            if card.key == name:
                return str(card.file)
        base, plus, stages = name.partition("+")
        if base.lower().endswith(".toml"):
            return f"{self.lab.path(base)}{plus}{stages}"
        if os.sep in base or "/" in base or "\\" in base:
            raise InputError(
                f"{name!r} is neither an actuator of the library nor a .toml file of this folder",
                code="unknown-actuator",
                where="actuator",
                repair="choose one of the list",
            )
        return name

    def fit(self, key: str) -> FitCard | None:
        """A fit of this session."""
        return next((card for card in self.fits if card.key == key), None)


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
