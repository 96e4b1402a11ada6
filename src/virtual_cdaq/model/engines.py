"""Timing engines: what gives a task its sample clock, and how many of them there are.

A cDAQ-9174 has three for analog input and one for analog output. A task gets one when it is reserved, and which one it
gets is the chassis's choice: a program that needs the terminal asks the reserved task for it. A first input task gets
``ai``: published programs start an output with it by ``/cDAQ1/ai/StartTrigger``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Ticks = NDArray[np.int64]

INPUT_ENGINES = ("ai", "te0", "te1")
OUTPUT_ENGINE = "ao"
START_DELAY = 80  # ticks (1 us) from the start of a task to its first edge


class Engine:
    """One timing engine.

    Parameters
    ----------
    name : str
        As in the terminal ``/cDAQ1/te0/SampleClock``.

    Attributes
    ----------
    reserved : bool
        Whether a task holds it.
    running : bool
    start : int [ticks]
        Of the first edge.
    period : int [ticks]
    limit : int or None
        Number of edges; None for no end.
    next : int
        The first edge that has not come yet.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.reserved = False
        self.running = False
        self.start = 0
        self.period = 1
        self.limit: int | None = None
        self.next = 0

    def begin(self, start: int, period: int, limit: int | None) -> None:
        """Run from tick `start`."""
        self.start, self.period, self.limit = start, period, limit
        self.next = 0
        self.running = True

    def tick(self, edge: int) -> int | None:
        """When edge number `edge` comes [ticks]; None if it never does."""
        if not self.running or (self.limit is not None and edge >= self.limit):
            return None
        return self.start + edge * self.period

    def edges(self, until: int) -> Ticks:
        """The edges that have not come yet, up to and with tick `until`."""
        if not self.running or until < self.start:
            return np.empty(0, dtype=np.int64)
        end = (until - self.start) // self.period + 1
        if self.limit is not None:
            end = min(end, self.limit)
        return self.start + self.period * np.arange(self.next, max(end, self.next), dtype=np.int64)
