"""One operator holds the bench, others watch: who that is."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Final

from ipmclab.errors import IpmclabError

PATIENCE: Final = 30.0
"""How long [s] the bench stays with a browser that has gone away: a reload, or a computer that slept."""


class Seats:
    """Who watches, and who holds the bench. A seat is one browser. Every method may be called from any thread.

    Parameters
    ----------
    clock : callable
        Seconds that only grow.

    Examples
    --------
    >>> seats = Seats()
    >>> seats.take("anna")
    >>> seats.holds("anna"), seats.holds("ben")
    (True, False)
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._there: Counter[str] = Counter()
        self._holder: str | None = None
        self._was_held = False
        self._seen = 0.0
        self.version = 0

    @property
    def is_new(self) -> bool:
        """Whether nobody has held the bench yet."""
        return not self._was_held

    @property
    def watching(self) -> int:
        """How many browsers are there."""
        return len(+self._there)

    @property
    def held(self) -> bool:
        """Whether somebody holds the bench."""
        return self._holder is not None and (self._there[self._holder] > 0 or self._clock() - self._seen < PATIENCE)

    @property
    def operator_is_there(self) -> bool:
        """Whether whoever holds the bench has the page open."""
        return self._holder is not None and self._there[self._holder] > 0

    def holds(self, seat: str) -> bool:
        """Whether a browser holds the bench."""
        return bool(seat) and seat == self._holder and self.held

    def take(self, seat: str) -> None:
        """Let a browser hold the bench.

        Raises
        ------
        IpmclabError
            Another one does.
        """
        if not seat:
            raise IpmclabError(
                "this browser keeps no cookies, so it cannot be distinguished from others",
                code="no-seat",
                where="bench",
                repair="allow cookies for this page, and reload it",
            )
        with self._lock:
            if self.held and self._holder != seat:
                raise IpmclabError(
                    "somebody else holds the bench",
                    code="bench-held",
                    where="bench",
                    repair=f"ask them to release it; it is free {PATIENCE:g} s after their page is closed",
                )
            if self._holder != seat:
                self.version += 1
            self._holder, self._seen, self._was_held = seat, self._clock(), True

    def release(self, seat: str) -> None:
        """Give the bench back."""
        with self._lock:
            if self._holder == seat:
                self._holder = None
                self.version += 1

    def come(self, seat: str) -> None:
        """A page of a browser was opened."""
        with self._lock:
            self._there[seat] += 1
            self.version += 1

    def leave(self, seat: str) -> None:
        """A page of a browser was closed."""
        with self._lock:
            self._there[seat] -= 1
            self._there = +self._there  # who is gone is forgotten
            if seat == self._holder:
                self._seen = self._clock()
            self.version += 1
