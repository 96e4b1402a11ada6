"""The time of the chassis: real, faster than real, or only as fast as somebody waits for it.

Time is a whole number of ticks of the 80 MHz timebase of the chassis. Edges of two sample clocks that fall on one
instant are therefore equal, and a run gives the same data at every speed.
"""

from __future__ import annotations

import math
import time
from typing import Protocol

TICKS_PER_SECOND = 80_000_000  # the chassis timebase (cDAQ-9174: 80 MHz)
LONGEST_PERIOD = 2**32  # ticks; the divider has 32 bits


def ticks(seconds: float) -> int:
    """A time in ticks.

    Examples
    --------
    >>> ticks(0.02)
    1600000
    """
    return round(seconds * TICKS_PER_SECOND)


def seconds(tick: int) -> float:
    """A number of ticks in seconds.

    Examples
    --------
    >>> seconds(1600000)
    0.02
    """
    return tick / TICKS_PER_SECOND


def sample_period(rate: float) -> int:
    """Ticks between two edges of a sample clock: the divider is cut to a whole number, so the rate is raised.

    Examples
    --------
    >>> sample_period(50.0), round(TICKS_PER_SECOND / sample_period(60_000.0), 3)
    (1600000, 60015.004)
    """
    # A rate that was itself read back from a divider must give that divider again.
    return max(1, min(LONGEST_PERIOD, math.floor(TICKS_PER_SECOND / rate * (1 + 1e-12))))


class Clock(Protocol):
    """Where the chassis takes its time from."""

    steps: bool
    """Whether time passes only when the chassis is told to let it pass."""

    def now(self) -> int:
        """The present [ticks]."""

    def wall(self, span: int) -> float:
        """How long a span of ticks lasts on the wall [s]."""


class RealClock:
    """Time that runs by itself, `speed` times as fast as the wall clock.

    Parameters
    ----------
    speed : float
        1 for real time.

    Examples
    --------
    >>> RealClock(10.0).wall(TICKS_PER_SECOND)
    0.1
    """

    steps = False

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed
        self._zero = time.perf_counter()

    def now(self) -> int:
        """The present [ticks]."""
        return int((time.perf_counter() - self._zero) * self.speed * TICKS_PER_SECOND)

    def wall(self, span: int) -> float:
        """How long a span of ticks lasts on the wall [s]."""
        return span / TICKS_PER_SECOND / self.speed

    def continue_from(self, tick: int) -> None:
        """Let it be `tick` now."""
        self._zero = time.perf_counter() - self.wall(tick)


class LockStepClock:
    """Time that does not move until somebody waits for something, and then is there at once.

    Examples
    --------
    >>> clock = LockStepClock()
    >>> clock.step_to(ticks(40.0))
    >>> seconds(clock.now())
    40.0
    """

    steps = True

    def __init__(self) -> None:
        self._now = 0

    def now(self) -> int:
        """The present [ticks]."""
        return self._now

    def wall(self, span: int) -> float:  # noqa: ARG002 - no span lasts on this clock
        """How long a span of ticks lasts on the wall [s]: nothing."""
        return 0.0

    def step_to(self, tick: int) -> None:
        """Let time pass until `tick`; never back."""
        self._now = max(self._now, tick)


def make_clock(text: str) -> RealClock | LockStepClock:
    """The clock that a word names: ``real``, ``x10``, ``lock-step``.

    Raises
    ------
    ValueError
        Another word.

    Examples
    --------
    >>> make_clock("x10").speed
    10.0
    """
    if text == "real":
        return RealClock()
    if text == "lock-step":
        return LockStepClock()
    if text.startswith("x"):
        try:
            speed = float(text[1:])
        except ValueError:
            speed = 0.0
        if 0.01 <= speed <= 1000.0:
            return RealClock(speed)
    raise ValueError(f"clock '{text}': 'real', 'x10' (x0.01 to x1000) or 'lock-step'")
