"""How much time has passed in an experiment."""

from __future__ import annotations

import time


class BenchClock:
    """How much time has passed: that of the wall, or that of a bench whose clock runs faster.

    At a simulated bench half an hour passes in a second; at a real one both say the same.

    Examples
    --------
    >>> clock = BenchClock()
    >>> clock.start("in environment")
    >>> clock.passed(120.0, since=clock.now)
    >>> round(clock.minutes_since("in environment"), 1), clock.minutes_since("out of water")
    (2.0, None)
    """

    def __init__(self) -> None:
        self._ahead = 0.0
        self._marks: dict[str, float] = {}

    @property
    def now(self) -> float:
        """Time [s]."""
        return time.monotonic() + self._ahead

    def passed(self, seconds: float, *, since: float) -> None:
        """So much time has passed at the bench since a moment."""
        self._ahead += max(0.0, seconds - (self.now - since))

    def start(self, what: str) -> None:
        """Count the time of something from now on."""
        self._marks[what] = self.now

    def minutes_since(self, what: str) -> float | None:
        """Minutes since it was started, None if it was not."""
        began = self._marks.get(what)
        return None if began is None else round((self.now - began) / 60.0, 3)
