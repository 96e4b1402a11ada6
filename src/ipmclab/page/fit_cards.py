"""A fit that a user asked the page for: the request, its file, and its card."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ipmclab.page.jobs.frames import Frame
from ipmclab.page.jobs.jobs import Job

FIT_KEY: Final = "fit:"
"""How keys of fits begin, and no name of one: a link that outlives its fit is distinguished from a name that is
misspelled."""


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
class FittedFile:
    """The file of a fit, and how it came about: kept as long as a fit that started from it.

    Parameters
    ----------
    asked : FitRequest
    path : Path
        Outside the lab.
    key : str
        As the page names the fit where an actuator is chosen.
    start : FittedFile or None
        The fit of this session that it started from.
    saved : str or None
        The file in the lab that it was saved as.
    """

    asked: FitRequest
    path: Path
    key: str
    start: FittedFile | None = None
    saved: str | None = None


@dataclass
class FitCard:
    """One fit of this session: its file, its job, and what came of it.

    Parameters
    ----------
    made : FittedFile
    job : Job
    """

    made: FittedFile
    job: Job

    @property
    def asked(self) -> FitRequest:
        """What it was asked for."""
        return self.made.asked

    @property
    def file(self) -> Path:
        """The fitted actuator, outside the lab."""
        return self.made.path

    @property
    def key(self) -> str:
        """As links name it."""
        return self.made.key

    @property
    def saved(self) -> str | None:
        """The file in the lab that it was saved as."""
        return self.made.saved

    @property
    def is_vain(self) -> bool:
        """Whether it is over without a result."""
        return self.job.is_over and self.frame is None

    @property
    def frame(self) -> Frame | None:
        """What is shown of it; None where it is not done."""
        return self.job.future.result() if self.job.is_over and self.job.state == "done" else None
