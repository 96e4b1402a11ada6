"""A clock of this program's own: it distinguishes a program that was held up from a chassis that does not answer."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from ipmclab.errors import IpmclabError

OPENING: Final = "while the bench was opened"

_TICK: Final = 0.1  # s
_SHORTEST: Final = 0.5  # s; a call to the chassis may take longer than that anyway
_CONSEQUENCES: Final = ("bench-frozen", "bench-lost")
"""Failures that blame the chassis, its server or its cable for a deadline that has passed."""


class Lateness:
    """How late a thread wakes that does so every so often: so long this program was stopped, or had no processor.

    A program that was stopped finds all its deadlines passed when it continues, and the server that seems not to answer
    has answered long ago.

    Parameters
    ----------
    period : float [s]
        Of the thread.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._wakes: list[tuple[float, float]] = []
        self._due = math.inf

    def begin(self) -> None:
        """The thread begins to wait."""
        self._due = time.monotonic() + self._period

    def woke(self) -> None:
        """It has waited, and waits again."""
        now = time.monotonic()
        self._wakes.append((now, now - self._due))
        self._due = now + self._period

    def forget(self, until: float) -> None:
        """Only what is late from then on counts, by the clock: this program may have been stopped since."""
        while self._wakes and self._wakes[0][0] <= until:
            self._wakes.pop(0)

    def end(self) -> None:
        """The thread waits no more."""
        self._due = math.inf

    def at(self, now: float) -> float:
        """By how much the thread is, or was, late [s]."""
        due = self._due  # first: the thread, where it comes in between, has put into ``_wakes`` what this then lacks
        return max([0.0, now - due, *(late for _, late in self._wakes)])


class OwnClock:
    """A thread that only wakes, so that its lateness is known while something waits."""

    def __init__(self) -> None:
        self._lateness = Lateness(_TICK)
        self.progress()
        self._lateness.begin()
        self._ended = threading.Event()
        threading.Thread(target=self._wake, name="own clock", daemon=True).start()

    def progress(self) -> None:
        """Something came of it: only what is late from now on counts."""
        self._progress = time.monotonic()
        self._lateness.forget(self._progress)

    def held_up(self) -> float:
        """For how long this program was held up since the last progress [s]; 0 where that was not most of the time."""
        now = time.monotonic()
        late = self._lateness.at(now)
        return late if late > max(_SHORTEST, now - self._progress) / 2.0 else 0.0

    def end(self) -> None:
        """Let the thread go."""
        self._ended.set()

    def _wake(self) -> None:
        while not self._ended.wait(_TICK):
            self._lateness.woke()


@contextmanager
def own_pauses_reported(doing: str) -> Iterator[OwnClock]:
    """Where this program was held up, a failure inside says so and does not blame the chassis.

    Parameters
    ----------
    doing : str
        What is done meanwhile, as the end of a sentence: ``"while the channels were read at 0 V"``.

    Examples
    --------
    >>> with own_pauses_reported("while nothing was done") as clock:
    ...     clock.held_up()
    0.0
    """
    clock = OwnClock()
    try:
        yield clock
    except IpmclabError as failure:
        held_up = clock.held_up()
        if held_up and failure.code in _CONSEQUENCES:
            failure.message = f"this computer held the recording up for {held_up:.1f} s {doing}"
            failure.code, failure.where = "held-up", ""
            failure.repair = "give this computer less to do during the recording, and record again"
        raise
    finally:
        clock.end()
