"""What all sections share: the lab, its catalogue, the workers, the curves and fits that are kept while it runs."""

from __future__ import annotations

import re
import secrets
import tempfile
from pathlib import Path
from typing import Final

from ipmclab.campaign.state import MODELS
from ipmclab.destination import write_text
from ipmclab.errors import InputError, suggest
from ipmclab.page.curves import CurveStore
from ipmclab.page.fit_cards import FIT_KEY, FitCard, FitRequest, FittedFile
from ipmclab.page.jobs.jobs import Jobs
from ipmclab.page.lab import Lab
from ipmclab.page.lab_runs import LabRuns, labels
from ipmclab.page.steps import Steps
from ipmclab.page.uploads import Uploads
from ipmclab.toml_file import glance

_MOST_FITS: Final = 20
"""Fits of a session that are kept; then the oldest that is over goes."""

_LONGEST_NAME: Final = 40
"""Letters of a fit's name: so many fit wherever it is shown."""

_PLAIN: Final = re.compile(r"\w([\w .-]*[\w-])?")
"""The name of a fit: no plus and no slash, for in that of an actuator stages and folders begin there."""

_FILE: Final = re.compile(r"(?P<base>.+?\.toml)(?P<stages>(\+[^/\\]*)?)", re.IGNORECASE)
"""An actuator of a file, with stages behind it; its name may have a plus too."""


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
        self._named: set[str] = set()  # as files would be called: what was the name of a fit is not offered again
        self._gone: set[str] = set()  # those of fits that had a result and are kept no longer
        self._folder = tempfile.TemporaryDirectory(prefix="ipmclab-page-", ignore_cleanup_errors=True)
        self.scratch = Path(self._folder.name)
        self.uploads = Uploads(self.scratch)
        self.runs = LabRuns(lab, self.jobs)
        self.steps = Steps(lab, self.fit)

    def close(self) -> None:
        """End the workers, and forget what was not saved."""
        self.jobs.close()
        self._folder.cleanup()

    def new_scratch(self, suffix: str) -> Path:
        """A new file that goes when the server does."""
        return self.scratch / f"{secrets.token_hex(8)}{suffix}"

    def actuators(self) -> dict[str, str]:
        """Actuators that can be chosen: what is loaded, and what it is called."""
        fits = [one.asked.name for one in self.fits if one.frame is not None]
        return {name: name for name in [*fits, *self.library(), *self.own_actuators()]}

    @staticmethod
    def library() -> list[str]:
        """Actuators that are included, the one of the thesis's tables first."""
        from ipmclab.model.actuator_file import library_names

        return sorted(library_names(), key=lambda name: (name != "friend-2", name))

    def own_actuators(self) -> list[str]:
        """Actuator files of the lab, and the models of a campaign, by their path below the root."""
        tables = [*self.lab.tables(), *self.lab.files(f"{MODELS}/*.toml")]
        return [self.lab.below(path) for path in tables if {"geometry", "circuit"} <= {*(glance(path) or {})}]

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
            if one.frame is None:
                raise InputError(
                    f"the fit {one.asked.name!r} has no result: {one.job.state}",
                    code="no-result",
                    where="actuator",
                    repair="choose another actuator, or identify again",
                )
            return str(one.file)
        from ipmclab.model.actuator_file import is_library_name

        file = _FILE.fullmatch(name)
        if file is not None:
            return f"{self.lab.path(file['base'])}{file['stages']}"
        if is_library_name(name) and not set(name) & set("/\\"):
            return name
        raise self._unknown(name.partition("+")[0].strip())

    def _unknown(self, name: str) -> InputError:
        """Why a name is none of an actuator."""
        if not name:
            return InputError(
                "no actuator is named", code="no-actuator", where="actuator", repair="choose one, such as friend-2"
            )
        if name.startswith(FIT_KEY) or file_stem(name) in self._gone:
            which = "this fit" if name.startswith(FIT_KEY) else f"the fit {name!r}"
            return InputError(
                f"{which} is no longer kept: the page keeps the last {_MOST_FITS}, until it ends",
                code="no-such-fit",
                where="actuator",
                repair="identify again, and save what you want to keep",
            )
        known = [*self.actuators()]
        states = [one for one in known if one.startswith(f"{name}-")]
        return InputError(
            f"there is no actuator {_shown(name)}: neither a fit of this session, nor of the library, "
            "nor a .toml file of this folder",
            code="no-actuator",
            where="actuator",
            repair=f"choose one of {', '.join(states)}" if states else suggest(name[:_LONGEST_NAME], known),
        )

    def next_name(self) -> str:
        """A name for the next fit that no other ever had in this session, and no file of the lab has."""
        number = len(self._named) + 1
        while file_stem(f"fit {number}") in self._named or self._owner(f"fit {number}"):
            number += 1
        return f"fit {number}"

    def identify(self, asked: FitRequest) -> FitCard:
        """Let a worker identify; the fit stays until the server ends, whatever the browser does.

        The name of a fit that came to nothing can be given again: that fit then leaves the list.

        Raises
        ------
        InputError
            An actuator or a run that is not there, or a name that is another's or none (``where`` is ``"name"``).
        """
        self.refuse_name(asked.name)
        start = self.fit(asked.actuator)
        file = self.new_scratch(".toml")
        arguments = {
            "actuator": self.actuator_path(asked.actuator),
            "named": self.steps.file_name(asked.actuator),
            "runs": [str(self.runs.path(key)) for key in asked.runs],
            "labels": labels(asked.runs),
            "free": asked.free,
            "per_run": asked.per_run,
            "per_mounting": asked.per_mounting,
            "prior": asked.prior,
            "out": str(file),
        }
        about = FittedFile(asked, file, f"{FIT_KEY}{secrets.token_hex(4)}", None if start is None else start.made)
        made = FitCard(about, self.jobs.submit("identify", arguments, title=asked.name))
        stem = file_stem(asked.name)
        self.fits = [one for one in self.fits if not (one.is_vain and file_stem(one.asked.name) == stem)]
        over = [one for one in self.fits if one.job.is_over]
        for one in over[: max(0, len(self.fits) + 1 - _MOST_FITS)]:
            self.fits.remove(one)
            if not one.is_vain:
                self._gone.add(file_stem(one.asked.name))
        self.fits.append(made)
        self._named.add(stem)
        return made

    def save_fit(self, card: FitCard, name: str) -> str:
        """Write a fit as an actuator of the lab; its path below the root.

        Raises
        ------
        InputError
            As ``new_actuator``.
        """
        path = self.new_actuator(name, card)
        write_text(card.file.read_text(encoding="utf-8"), path, overwrite=False)
        card.made.saved = self.lab.below(path)
        return card.made.saved

    def new_actuator(self, name: str, card: FitCard | None = None) -> Path:
        """Where an actuator is written that a user named; ``card`` is the fit that it is, whose own name it may have.

        Raises
        ------
        InputError
            No plain name, one of the library's or of a fit, or that of a file that is there already.
        """
        stem = name.strip().removesuffix(".toml")
        path = self.lab.root / f"{stem}.toml"
        if _is_plain(stem) and path.exists():
            raise InputError(
                f"{path.name} exists already", code="file-exists", where="name", repair="choose another name"
            )
        self.refuse_name(stem, card)
        return self.lab.new_file(stem, ".toml")

    def refuse_name(self, name: str, card: FitCard | None = None) -> None:
        """Refuse to call a fit as something else is called already, or as no file can be.

        Raises
        ------
        InputError
            Its ``where`` is ``"name"``.
        """
        owner = self._owner(name, card)
        if owner:
            stem = name.removesuffix(".toml")
            raise InputError(
                f"{_shown(name)} is {owner} name already",
                code="name-taken",
                where="name",
                repair=f"choose another name, such as my-{stem.partition('+')[0]}",
            )
        if not _is_plain(name) or name.casefold().endswith(".toml"):
            raise InputError(
                f"{_shown(name)} is no plain name",
                code="bad-name",
                where="name",
                repair=f"use letters, digits, spaces, and . - _; at most {_LONGEST_NAME}, beginning with a letter or "
                "digit, without .toml",
            )
        self.lab.new_file(file_stem(name), ".toml")  # what no system can have as a file

    def _owner(self, name: str, card: FitCard | None = None) -> str:
        """Whose name it is, also where only capitals or a space for a hyphen distinguish the two; empty for
        nobody's."""
        from ipmclab.model.actuator_file import is_library_name

        stem = file_stem(name.removesuffix(".toml"))
        fits = {file_stem(one.asked.name) for one in self.fits if one is not card and not one.is_vain}
        if is_library_name(name.removesuffix(".toml").casefold()):
            return "another actuator's"
        if stem in fits | self._gone:
            return "another fit's"
        files = {file_stem(path.stem): path for path in self.lab.tables()}
        if stem not in files:
            return ""
        return "another actuator's" if self.lab.below(files[stem]) in self.own_actuators() else "another file's"

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
        there = {row.content_sha256: row.path for row in self.runs.rows() if row.path and not row.problem}
        found = [path for sha, _ in wanted if (path := there.get(sha)) is not None]
        return found, [label for sha, label in wanted if sha not in there]

    def reports(self) -> list[str]:
        """The reports of the lab, the newest first."""
        found = sorted(self.lab.files("*.html"), key=lambda path: path.stat().st_mtime, reverse=True)
        return [path.name for path in found]

    def models(self) -> dict[str, str]:
        """What can predict: fits of this session by their keys, then actuators; and what each is called."""
        return self._with_session([*self.own_actuators(), *self.library()])

    def every_fit(self) -> dict[str, str]:
        """Fits of this session by their keys, then files of fits; and what each is called."""
        return self._with_session(self.fitted_files())

    def _with_session(self, files: list[str]) -> dict[str, str]:
        fits = {card.key: card.asked.name for card in reversed(self.fits) if card.frame is not None}
        return {**fits, **{name: name for name in files}}

    def fit(self, key: str) -> FitCard | None:
        """A fit of this session, by its key or its name: of a name, one that came to something where there is one."""
        found = [one for one in reversed(self.fits) if key in (one.key, one.asked.name)]
        return min(found, key=lambda one: one.is_vain, default=None)


def file_stem(name: str) -> str:
    """What distinguishes names of fits and of their files: neither capitals do, nor a space for a hyphen.

    Examples
    --------
    >>> file_stem("Fit 3") == file_stem("fit-3")
    True
    """
    return name.strip().replace(" ", "-").casefold()


def _is_plain(name: str) -> bool:
    return len(name) <= _LONGEST_NAME and _PLAIN.fullmatch(name) is not None


def _shown(name: str) -> str:
    """A name in a message, which is read in a narrow column."""
    return repr(name if len(name) <= _LONGEST_NAME else f"{name[:_LONGEST_NAME]}…")
