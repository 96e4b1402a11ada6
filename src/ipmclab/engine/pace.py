"""How much a worker is given at once, from how long the work took so far."""

from __future__ import annotations

from collections import deque
from typing import Final

LEAST_SECONDS: Final = 1.0
"""Of work in a chunk: some hundred times of what it costs to send it (docs/sweeps.md)."""

SECONDS_EACH: Final = 0.015
"""Of work in a chunk for each worker: what sends and collects chunks is then busy a tenth of the time."""


class Pace:
    """How many pieces of work go into a chunk.

    Parameters
    ----------
    workers : int
    first : int
        Pieces, before it is known how long one takes.
    most : int
        Pieces that may travel together.

    Examples
    --------
    >>> pace = Pace(workers=2, first=64)
    >>> pace.size(10**9), pace.learn(64, 0.064), pace.size(10**9), pace.size(400)
    (64, None, 1000, 100)
    """

    def __init__(self, workers: int, *, first: int = 1, most: int = 1_000_000) -> None:
        self._workers = max(workers, 1)
        self._first, self._most = first, most
        self._last: deque[tuple[int, float]] = deque(maxlen=2 * self._workers)  # what a first one loads is forgotten

    def learn(self, pieces: int, seconds: float) -> None:
        """So many pieces took so long."""
        self._last.append((pieces, seconds))

    def size(self, left: int) -> int:
        """Pieces of the next chunk, of so many that are left."""
        share = max(1, -(-left // (2 * self._workers)))  # so that workers end at about the same time
        if not self._last:
            return min(self._first, share)
        pieces, seconds = sum(one for one, _ in self._last), sum(one for _, one in self._last)
        wanted = max(LEAST_SECONDS, SECONDS_EACH * self._workers)
        return max(1, min(round(wanted * pieces / max(seconds, 1e-9)), share, self._most))
