"""What was done on the page, as steps that do the same without it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable

from ipmclab.errors import InputError
from ipmclab.page.commands import Step, identify_step, in_order
from ipmclab.page.fit_cards import FIT_KEY, FitCard, FittedFile
from ipmclab.page.lab import Lab


class Steps:
    """Steps as commands and Python, in which a fit is named by its file.

    Parameters
    ----------
    lab : Lab
    fit : callable
        Gives a fit of this session by its key or its name, or None.
    """

    def __init__(self, lab: Lab, fit: Callable[[str], FitCard | None]) -> None:
        self._lab = lab
        self._fit = fit

    def file_name(self, name: str) -> str:
        """An actuator as a command names it: a fit of this session by the file that it is saved as, or would be."""
        one = self._fit(name)
        return name if one is None else self._file_name(one.made)

    def of(self, made: FittedFile) -> Step:
        """The step that makes the file of a fit from the file that it started from."""
        asked = made.asked
        actuator = asked.actuator if made.start is None else self._file_name(made.start)
        names = (asked.free, asked.per_run, asked.per_mounting, asked.prior)
        return identify_step(actuator, asked.runs, *names, out=self._file_name(made))

    def repeatable(self, step: Step, names: Iterable[str]) -> Step:
        """A step that can be done without the page: before it, those that make the files of fits that are not saved.

        Parameters
        ----------
        step : Step
        names : iterable of str
            The actuators that it uses, as the page names them.
        """
        before: dict[str, tuple[str, Step]] = {}

        def make(made: FittedFile) -> None:
            if made.key in before or self._is_saved(made):
                return
            if made.start is not None:
                make(made.start)
            before[made.key] = made.asked.name, self.of(made)

        for name in names:
            one = self._fit(name)
            if one is not None:
                make(one.made)
        if not before:
            return step
        fits = " and ".join(f"“{name}”" for name, _ in before.values())
        if len(before) == 1:
            note = f"{fits} is not saved: it is identified again first. Save it under Identify, and its file is named."
        else:
            note = f"{fits} are not saved: they are identified again first. Save them, and their files are named."
        return in_order([*(made for _, made in before.values()), step], note=note)

    def _file_name(self, made: FittedFile) -> str:
        """The file of the lab that a fit is saved as, or one that nothing else is called."""
        if made.saved is not None and self._is_saved(made):
            return made.saved
        stem = made.asked.name.replace(" ", "-")
        is_taken = (self._lab.root / f"{stem}.toml").exists()
        return f"{stem}-{made.key.removeprefix(FIT_KEY)}.toml" if is_taken else f"{stem}.toml"

    def _is_saved(self, made: FittedFile) -> bool:
        """Whether the file that it was saved as is still there, and still that fit."""
        if made.saved is None:
            return False
        with contextlib.suppress(OSError, InputError):
            return self._lab.path(made.saved).read_bytes() == made.path.read_bytes()
        return False
