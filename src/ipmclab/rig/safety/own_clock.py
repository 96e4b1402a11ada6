"""A clock of this program's own: it tells a program that was held up from a chassis that does not answer."""

from __future__ import annotations

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


class OwnClock:
    """A thread that only wakes: how late it does tells how long this program was stopped, or had no processor.

    A program that was stopped finds all its deadlines passed when it goes on, and the server that seems not to answer
    has answered long ago.
    """

    def __init__(self) -> None:
        self._progress = time.monotonic()
        self._late = 0.0
        self._due = self._progress + _TICK
        self._ended = threading.Event()
        threading.Thread(target=self._wake, name="own clock", daemon=True).start()

    def progress(self) -> None:
        """Something came of it: only what is late from now on counts."""
        self._progress, self._late = time.monotonic(), 0.0

    def held_up(self) -> float:
        """For how long this program was held up since the last progress [s]; 0 where that was not most of the time."""
        now = time.monotonic()
        due = self._due  # first: the thread, where it comes in between, has put into ``_late`` what this then lacks
        late = max(self._late, now - due)
        return late if late > max(_SHORTEST, now - self._progress) / 2.0 else 0.0

    def end(self) -> None:
        """Let the thread go."""
        self._ended.set()

    def _wake(self) -> None:
        while not self._ended.wait(_TICK):
            now = time.monotonic()
            self._late = max(self._late, now - self._due)
            self._due = now + _TICK


@contextmanager
def own_pauses_told(doing: str) -> Iterator[OwnClock]:
    """Where this program was held up, a failure inside says so and does not blame the chassis.

    Parameters
    ----------
    doing : str
        What is done meanwhile, as the end of a sentence: ``"while the channels were read at 0 V"``.

    Examples
    --------
    >>> with own_pauses_told("while nothing was done") as clock:
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
            failure.repair = "give this computer less to do beside the recording, and record again"
        raise
    finally:
        clock.end()
