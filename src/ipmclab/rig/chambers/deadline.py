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
    >>> part = whole.within(5.0)
    >>> whole.cut()
    >>> part.is_over
    True
    """

    def __init__(self, seconds: float, whole: Deadline | None = None) -> None:
        self._end = time.monotonic() + seconds
        self._whole = whole

    @property
    def left(self) -> float:
        """What is left of it [s], never below 0."""
        own = max(0.0, self._end - time.monotonic())
        return own if self._whole is None else min(own, self._whole.left)

    def cut(self) -> None:
        """Let it, and every part of it, be over now; may be called from another thread."""
        self._end = time.monotonic()

    @property
    def is_over(self) -> bool:
        """Whether nothing is left of it."""
        return self.left == 0.0

    def within(self, seconds: float) -> Deadline:
        """The earlier of this one and so many seconds from now."""
        return Deadline(seconds, self)
