"""Questions that are asked again: what is garbled, late or lost on a line costs a question, never the wrong answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeVar

from ipmclab.rig.chambers.chamber import ChamberError
from ipmclab.rig.chambers.deadline import Deadline
from ipmclab.rig.chambers.line import LONGEST_QUIET, Line, garbled, silent

Meaning = TypeVar("Meaning")

ATTEMPTS: Final = 3
"""A question is asked so often at most."""

_QUIET: Final = 0.1
"""A line on which nothing comes for so long [s] has nothing more to say at once."""

SETTLED: Final = ("chamber-in-use", "no-chamber-client")
"""Errors after which asking again changes nothing."""


class Dialogue:
    """Asks until an answer is understood.

    The answers of a text line carry no number. One that comes too late could be taken for that to the next question.
    Once an answer was missed, the line is therefore opened again and a question is asked whose answer is like no
    other; only when that has come does the dialogue continue.

    Parameters
    ----------
    line : Line
    patience : float [s]
        How long one answer may take.
    landmark : (str, callable), optional
        A question, and whether some answer is that to it. Without it the line has to be quiet for a while.
    """

    def __init__(self, line: Line, patience: float, landmark: tuple[str, Callable[[str], bool]] | None = None) -> None:
        self.line = line
        self._patience = patience
        self._landmark = landmark
        self._lost = False

    @property
    def where(self) -> str:
        """The chamber, for messages."""
        return self.line.where

    def ask(self, question: str, understand: Callable[[str], Meaning], deadline: Deadline) -> Meaning:
        """What a chamber answers.

        Parameters
        ----------
        question : str
        understand : callable
            Makes something of an answer. Raises ValueError where it is no answer to this question, ChamberError where
            it is a refusal.
        deadline : Deadline

        Raises
        ------
        ChamberError
            No answer, or none that is understood, in three attempts or until the deadline.
        """
        for attempt in range(ATTEMPTS):
            try:
                if self._lost:
                    self._find_place(deadline)
                return self._once(question, understand, deadline.within(self._patience))
            except ChamberError as error:
                # A question that was garbled on its way is refused too: it is asked again, on the same line.
                self._lost = self._lost or error.code != "chamber-refused"
                if attempt == ATTEMPTS - 1 or deadline.is_over or error.code in SETTLED:
                    raise
        raise AssertionError("unreachable")

    def measure(self, question: str, understand: Callable[[str], float], near: float, deadline: Deadline) -> float:
        """A reading, taken twice and believed where both are near each other: nothing on a text line has a checksum.

        A reading of 3.0 may be what is left of 23.0. Raises ChamberError.
        """
        before = self.ask(question, understand, deadline)
        for _ in range(ATTEMPTS):
            now = self.ask(question, understand, deadline)
            if abs(now - before) <= near:
                return now
            before = now
        raise garbled(self.where, f"{before:g} at one time and {now:g} at the next to {question}")

    def say(self, command: str, deadline: Deadline) -> None:
        """A command that is not answered; whether it was heard, a question has to show. Raises ChamberError."""
        for attempt in range(ATTEMPTS):
            try:
                if self._lost:
                    self._find_place(deadline)
                self.line.tell(command, deadline.within(self._patience))
                return
            except ChamberError as error:
                self._lost = True
                if attempt == ATTEMPTS - 1 or deadline.is_over or error.code in SETTLED:
                    raise

    def close(self) -> None:
        """Let go of the line."""
        self.line.drop()

    def _once(self, question: str, understand: Callable[[str], Meaning], deadline: Deadline) -> Meaning:
        answer = self.line.ask(question, deadline)
        try:
            return understand(answer)
        except ValueError as error:
            raise garbled(self.where, answer) from error

    def _find_place(self, deadline: Deadline) -> None:
        """Continue only where the next answer is that to the next question."""
        self.line.drop()
        # Where no answer is like no other, one that is late has to be waited for.
        quiet = min(LONGEST_QUIET if self._landmark is None else _QUIET, self._patience)
        is_quiet = self.line.quieten(quiet, deadline.within(2.0 * self._patience))
        if self._landmark is None and not is_quiet:
            raise silent(self.where, "nobody knows what its next answer would be to")
        if self._landmark is not None:
            question, is_answer = self._landmark
            deadline = deadline.within(self._patience)
            self.line.tell(question, deadline)
            while not is_answer(answer := self.line.hear(deadline)):
                if deadline.is_over:  # a line without an end never lacks a next answer
                    raise garbled(self.where, answer)
        self._lost = False
