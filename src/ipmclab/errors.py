"""Errors that say what is wrong, where, and what to do about it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from functools import partial
from typing import Any


class IpmclabError(Exception):
    """A job that ran and failed (exit status 1).

    Parameters
    ----------
    message : str
        What is wrong, with the offending value and the allowed one.
    code : str
        A short stable name for programs, such as ``"unknown-parameter"``.
    where : str
        File, key, channel, sample or time; empty when there is no such place.
    repair : str
        What the user can do about it.

    Examples
    --------
    >>> str(InputError("the rate is -50 Hz, it must be above 0", code="bad-rate", where="rate", repair="give 50 Hz"))
    'rate: the rate is -50 Hz, it must be above 0; give 50 Hz'
    """

    exit_status = 1

    def __init__(self, message: str, *, code: str, where: str = "", repair: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.code = code
        self.where = where
        self.repair = repair

    def __str__(self) -> str:
        text = f"{self.where}: {self.message}" if self.where else self.message
        return f"{text}; {self.repair}" if self.repair else text

    def __reduce__(self) -> tuple[Any, ...]:
        """How it travels between processes: pickle would leave out what was given by name."""
        return partial(type(self), code=self.code, where=self.where, repair=self.repair), (self.message,), vars(self)

    def as_dict(self) -> dict[str, str]:
        """The error as the document that ``--json`` prints."""
        return {"code": self.code, "message": self.message, "where": self.where, "repair": self.repair}


class InputError(IpmclabError, ValueError):
    """Something the user gave cannot be used (exit status 2)."""

    exit_status = 2


def suggest(name: str, known: Iterable[str]) -> str:
    """A repair that names the nearest of the known names, or lists them.

    Examples
    --------
    >>> suggest("sheet_resistence", ["sheet_resistance", "gain"])
    "did you mean 'sheet_resistance'?"
    >>> suggest("xyz", ["gain", "zero"])
    "known: 'gain', 'zero'"
    """
    names = list(known)
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    if near:
        return f"did you mean {near[0]!r}?"
    return "known: " + ", ".join(repr(other) for other in names)
