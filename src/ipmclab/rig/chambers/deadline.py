"""The moment until which something must be over."""

from __future__ import annotations

import time


class Deadline:
    """So many seconds from now, by a clock that nobody sets.

    Parameters
    ----------
    seconds : float [s]

    Examples
    --------
    >>> whole = Deadline(10.0)
    >>> 9.0 < whole.left <= 10.0, whole.within(2.0).left <= 2.0, Deadline(0.0).is_over
    (True, True, True)
    """

    def __init__(self, seconds: float) -> None:
        self._end = time.monotonic() + seconds

    @property
    def left(self) -> float:
        """What is left of it [s], never below 0."""
        return max(0.0, self._end - time.monotonic())

    @property
    def is_over(self) -> bool:
        """Whether nothing is left of it."""
        return self.left == 0.0

    def within(self, seconds: float) -> Deadline:
        """The earlier of this one and so many seconds from now."""
        return Deadline(min(seconds, self.left))
