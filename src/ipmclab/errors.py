"""Errors that say what is wrong, where, and what to do about it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from functools import partial
from typing import Any, Final

_ALIKE: Final = 0.6
"""Likeness from which a name may have been meant: that of ``difflib.get_close_matches`` (convention)."""


INTERRUPTED: Final = 130
"""Exit status after Ctrl-C: 128 + the number of the interrupt signal, as shells have it."""


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

    def at(self, where: str, message: str | None = None) -> InputError:
        """The same error at another place.

        Parameters
        ----------
        where : str
        message : str, optional
            What is wrong, in other words.
        """
        return InputError(self.message if message is None else message, code=self.code, where=where, repair=self.repair)


def suggest(name: str, known: Iterable[str]) -> str:
    """A repair that names the nearest of the known names, all that are as near, or lists them.

    Where a dotted name begins as a known one does, the rest of both is compared; a name with fewer parts is compared
    with as many.

    Examples
    --------
    >>> suggest("circuit.dc_resistance", ["circuit.contact_resistance", "circuit.dc_resistivity"])
    "did you mean 'circuit.dc_resistivity'?"
    >>> suggest("relaxtion", ["relaxation.displacement", "relaxation.force", "clamp"])
    "did you mean 'relaxation.displacement' or 'relaxation.force'?"
    >>> suggest("STEP", ["step", "dc"])
    "did you mean 'step'?"
    >>> suggest("xyz", ["gain", "zero"])
    "known: 'gain', 'zero'"
    """
    names = list(known)
    likeness = {other: _likeness_of_parts(name.split("."), other.split(".")) for other in names}
    largest = max(likeness.values(), default=0.0)
    if largest < _ALIKE:
        return "known: " + ", ".join(repr(other) for other in names)
    *others, last = [repr(other) for other, found in likeness.items() if found == largest]
    return f"did you mean {', '.join(others)}{' or ' if others else ''}{last}?"


def missing_key(where: str, repair: str) -> InputError:
    """That a table has not the key that it needs."""
    return InputError("this key is missing", code="missing-key", where=where, repair=repair)


def unknown_name(what: str, name: object, known: Iterable[str], *, where: str) -> InputError:
    """That a name is none of those that are known, with the nearest of these; its code names what it should be.

    Examples
    --------
    >>> str(unknown_name("hold", "zeros", ["zero", "first"], where="hold"))
    "hold: unknown hold 'zeros'; did you mean 'zero'?"
    """
    return InputError(f"unknown {what} {name!r}", code=f"unknown-{what}", where=where, repair=suggest(str(name), known))


def _likeness_of_parts(name: list[str], other: list[str]) -> float:
    equal = 0
    while equal < min(len(name) - 1, len(other)) and name[equal] == other[equal]:
        equal += 1
    return _likeness(".".join(name[equal:]), ".".join(other[equal : len(name)]))


def _likeness(name: str, other: str) -> float:
    """How alike two names are in any case, from 0 to 1: where they have as many words, on average of the words."""
    name, other = name.casefold(), other.casefold()
    words, others = name.split("_"), other.split("_")
    pairs = [(name, other)] if len(words) != len(others) else list(zip(words, others, strict=True))
    return sum(difflib.SequenceMatcher(None, there, word).ratio() for word, there in pairs) / len(pairs)
