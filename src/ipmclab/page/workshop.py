"""What all sections share: the lab, its catalogue, the workers, the curves and fits that are kept while it runs."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.curves import CurveStore
from ipmclab.page.jobs.frames import Frame
from ipmclab.page.jobs.jobs import Job, JobCancelled, Jobs
from ipmclab.page.lab import Lab
from ipmclab.page.uploads import Uploads
from ipmclab.toml_file import glance

if TYPE_CHECKING:
    from ipmclab.run import Run
    from ipmclab.store.catalogue.catalogue import Catalogue
    from ipmclab.store.catalogue.query import CatalogueRow

MOST_COMPARED: Final = 8
"""Runs on one plot: so many can be told apart."""

_MOST_FITS: Final = 20
"""Fits of a session that are kept; then the oldest that is over goes."""

_KEPT_ROWS: Final = 2_000_000
"""Rows of runs that stay in memory for the next zoom."""


@dataclass(frozen=True)
class FitRequest:
    """What a fit is asked for.

    Parameters
    ----------
    name : str
        As people are going to call it.
    actuator : str
        What it starts from, as the page names it.
    runs, held : tuple of str
        Runs to identify from, and runs to predict.
    free, per_run, per_mounting, prior : tuple of str
    """

    name: str
    actuator: str
    runs: tuple[str, ...]
    free: tuple[str, ...]
    per_run: tuple[str, ...] = ()
    per_mounting: tuple[str, ...] = ()
    prior: tuple[str, ...] = ()
    held: tuple[str, ...] = ()


@dataclass
class FitCard:
    """One fit of this session: what was asked, its job, and what came of it.

    Parameters
    ----------
    asked : FitRequest
    file : Path
        The fitted actuator, beside the lab.
    job : Job
    key : str
        As the page names it where an actuator is chosen.
    saved : str or None
        The file in the lab that it was saved as.
    """

    asked: FitRequest
    file: Path
    job: Job
    key: str
    saved: str | None = None

    @property
    def frame(self) -> Frame | None:
        """What is shown of it; None where it is not done."""
        return self.job.future.result() if self.job.is_over and self.job.state == "done" else None


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
        self._folder = tempfile.TemporaryDirectory(prefix="ipmclab-page-", ignore_cleanup_errors=True)
        self.scratch = Path(self._folder.name)
        self.uploads = Uploads(self.scratch)
        self._runs: OrderedDict[tuple[str, int, int], Run] = OrderedDict()
        self._lock = threading.Lock()
        self._look: Job | None = None

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
        arguments = {"folder": str(self.lab.root)}
        self._look = self.jobs.submit("inspect", arguments, title="looking at the runs", replaces="inspect")
        return self._look

    async def looked(self) -> None:
        """Look again, and wait until the newest look is over; a file that cannot be read stops nobody."""
        job: Job | None = self.look_again()
        while job is not None:
            with contextlib.suppress(JobCancelled, IpmclabError):  # Runs says what was wrong
                await asyncio.wrap_future(job.future)
            job = self._look if self._look is not job else None

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
        fits = [one.asked.name for one in self.fits if one.frame is not None]
        return {name: name for name in [*fits, *self.library(), *self.own_actuators()]}

    @staticmethod
    def library() -> list[str]:
        """Actuators that come along, the one of the thesis's tables first."""
        from ipmclab.model.actuator_file import library_names

        return sorted(library_names(), key=lambda name: (name != "friend-2", name))

    def own_actuators(self) -> list[str]:
        """Actuator files of the lab, by their path below the root."""
        return [
            self.lab.below(path) for path in self.lab.tables() if {"geometry", "circuit"} <= {*(glance(path) or {})}
        ]

    def actuator_path(self, name: str) -> str:
        """What ``load_actuator`` is given for a name of the page: a fit of this session, a file of the lab, or the
        library, with stages behind a plus.

        Raises
        ------
        InputError
            A file outside the lab.
        """
        one = self.fit(name)
        if one is not None:
            return str(one.file)
        base, plus, stages = name.partition("+")
        if base.lower().endswith(".toml") and not set(stages) & set("/\\"):
            return f"{self.lab.path(base)}{plus}{stages}"
        if set(name) & set("/\\"):
            raise InputError(
                f"{name!r} is neither an actuator of the library nor a .toml file of this folder",
                code="unknown-actuator",
                where="actuator",
                repair="choose one of the list",
            )
        return name

    def identify(self, asked: FitRequest) -> FitCard:
        """Let a worker identify; the fit stays until the server ends, whatever the browser does.

        Raises
        ------
        InputError
            An actuator or a run that is not there, or the name of another actuator.
        """
        self._refuse_taken(asked.name)
        file = self.new_scratch(".toml")
        arguments = {
            "actuator": self.actuator_path(asked.actuator),
            "runs": [str(self.run_path(key)) for key in asked.runs],
            "labels": labels(asked.runs),
            "free": asked.free,
            "per_run": asked.per_run,
            "per_mounting": asked.per_mounting,
            "prior": asked.prior,
            "out": str(file),
        }
        made = FitCard(asked, file, self.jobs.submit("identify", arguments, title=asked.name), secrets.token_hex(4))
        over = [one for one in self.fits if one.job.is_over]
        for one in over[: max(0, len(self.fits) + 1 - _MOST_FITS)]:
            self.fits.remove(one)
        self.fits.append(made)
        return made

    def save_fit(self, card: FitCard, name: str) -> str:
        """Write a fit as an actuator of the lab; its path below the root.

        Raises
        ------
        InputError
            No plain file name, one of the library's, or one that is there already.
        """
        path = self.lab.new_file(name, ".toml")
        self._refuse_taken(path.stem)
        if path.exists():
            raise InputError(
                f"{path.name} exists already", code="file-exists", where="name", repair="choose another name"
            )
        path.write_text(card.file.read_text(encoding="utf-8"), encoding="utf-8")
        card.saved = self.lab.below(path)
        return card.saved

    def _refuse_taken(self, name: str) -> None:
        """Refuse to call a fit as an actuator that it would stand in front of."""
        from ipmclab.model.actuator_file import is_library_name

        if is_library_name(name.casefold()) or name in self.own_actuators():
            raise InputError(
                f"{name!r} is another actuator's name already",
                code="name-taken",
                where="name",
                repair=f"choose another name, such as my-{name}",
            )

    def fitted_files(self) -> list[str]:
        """Fitted actuators of the lab, by their path below the root."""
        return [name for name in self.own_actuators() if "[fit]" in self.lab.path(name).read_text(encoding="utf-8-sig")]

    def runs_of_fit(self, name: str) -> tuple[list[str], list[str]]:
        """The runs that a fit was made from, as the lab has them, and the labels of those that it lacks.

        Parameters
        ----------
        name : str
            A fit of this session by its key, or a fitted file of the lab.

        Raises
        ------
        InputError
            No fitted actuator.
        """
        try:
            used = (glance(Path(self.actuator_path(name))) or {})["fit"]["runs"]
            wanted = [(str(one["content_sha256"]), str(one["label"])) for one in used]
        except (KeyError, TypeError) as error:
            raise InputError(
                "this is no fitted actuator", code="not-a-fit", where="fit", repair="choose what identify wrote"
            ) from error
        there = {row.content_sha256: row.path for row in self.rows() if row.path and not row.problem}
        found = [path for sha, _ in wanted if (path := there.get(sha)) is not None]
        return found, [label for sha, label in wanted if sha not in there]

    def reports(self) -> list[str]:
        """The reports of the lab, the newest first."""
        found = sorted(self.lab.files("*.html"), key=lambda path: path.stat().st_mtime, reverse=True)
        return [path.name for path in found]

    def models(self) -> dict[str, str]:
        """What can predict: fits of this session by their keys, then actuators; and what each is called."""
        fits = {card.key: card.asked.name for card in reversed(self.fits) if card.frame is not None}
        return {**fits, **{name: name for name in [*self.own_actuators(), *self.library()]}}

    def fit(self, key: str) -> FitCard | None:
        """A fit of this session, by its key or its name."""
        return next((one for one in reversed(self.fits) if key in (one.key, one.asked.name)), None)

    def file_name(self, name: str) -> str:
        """An actuator as a command names it: a fit of this session by the file that it is saved as, or would be."""
        one = self.fit(name)
        return name if one is None else one.saved or f"{one.asked.name.replace(' ', '-')}.toml"


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
