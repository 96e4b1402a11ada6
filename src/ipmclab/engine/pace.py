"""How much a worker is given at once, from how long the work took so far."""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import Final

LEAST_SECONDS: Final = 1.0
"""Of work in a chunk: some hundred times of what it costs to send it (docs/sweeps.md)."""

SECONDS_EACH: Final = 0.015
"""Of work in a chunk for each worker: what sends and collects chunks is then busy a tenth of the time."""


_KEPT: Final = 16
"""Chunks from which the cost of a piece is taken: what a worker loads before its first is soon forgotten."""


class Pace:
    """How many pieces of work go into a chunk.

    Parameters
    ----------
    first : int
        Pieces, before it is known how long one takes.
    most : int
        Pieces that may travel together.

    Examples
    --------
    >>> pace = Pace(first=64)
    >>> pace.size(10**9, workers=2), pace.learn(64, 0.064), pace.size(10**9, workers=2), pace.size(400, workers=2)
    (64, None, 1000, 100)
    """

    def __init__(self, *, first: int = 1, most: int = 1_000_000) -> None:
        self._first, self._most = first, most
        self._costs: deque[float] = deque(maxlen=_KEPT)

    def learn(self, pieces: int, seconds: float) -> None:
        """So many pieces took so long."""
        self._costs.append(seconds / pieces)

    def size(self, left: int, workers: int) -> int:
        """Pieces of the next chunk, of so many that are left, for one of so many workers."""
        share = max(1, -(-left // (2 * max(workers, 1))))  # so that workers end at about the same time
        if not self._costs:
            return min(self._first, share)
        wanted = max(LEAST_SECONDS, SECONDS_EACH * workers)
        return max(1, min(round(wanted / max(median(self._costs), 1e-9)), share, self._most))
