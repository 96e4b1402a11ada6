"""The readings of the run that is being recorded, as far as plots need them; the record itself is the journal's."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.page.thin import envelope

FloatArray = npt.NDArray[np.float64]

MOST_ROWS: Final = 1 << 20
"""Rows that are held: 60 MB for six channels. Beyond them the older half is thinned to its extremes."""

_BUNCH: Final = 8


class Columns:
    """Time and channels of one run, appended block by block.

    Parameters
    ----------
    channels : sequence of str
    rate : float [Hz]
    most : int
        Rows above which the older half is thinned four to one, lowest and highest of each channel kept.

    Examples
    --------
    >>> columns = Columns(["voltage"], rate=2.0)
    >>> columns.append(0, {"voltage": np.array([0.0, 1.0])})
    >>> columns.append(5, {"voltage": np.array([3.0])})
    >>> time, values = columns.snapshot()
    >>> time.tolist(), values["voltage"].tolist()
    ([0.0, 0.5, 1.0, 2.5], [0.0, 1.0, nan, 3.0])
    """

    def __init__(self, channels: Sequence[str], rate: float, most: int = MOST_ROWS) -> None:
        self.channels = tuple(channels)
        self.rate = rate
        self.rows_received = 0
        self.thinned = 0
        """How often older rows were thinned, or a channel was added: what was sent before that is void."""
        self._most = most
        self._lock = threading.Lock()
        self._count = 0
        self._held = np.empty((1 + len(self.channels), 4096))

    def __len__(self) -> int:
        return self._count

    def snapshot(self, first: int = 0) -> tuple[FloatArray, dict[str, FloatArray]]:
        """Time [s] and each channel [SI] of the rows that are held, from a place on. Not to be written to."""
        with self._lock:
            held, channels = self._held[:, first : self._count], self.channels
        return held[0], dict(zip(channels, held[1:], strict=True))

    def append(self, first_row: int, values: Mapping[str, FloatArray]) -> None:
        """Take some rows; where some were missed before them, a row of NaN says so."""
        count = len(next(iter(values.values()), ()))
        if not count or first_row < self.rows_received:
            return
        with self._lock:
            if new := tuple(name for name in values if name not in self.channels):
                rows = np.full((len(new), self._held.shape[1]), np.nan)
                self._held, self.channels = np.vstack([self._held, rows]), (*self.channels, *new)
                self.thinned += 1
            if first_row > self.rows_received:
                self._put(np.array([self.rows_received / self.rate]), {})
            self._put((first_row + np.arange(count)) / self.rate, values)
            self.rows_received = first_row + count
            if self._count > self._most:
                self._thin()

    def _put(self, time: FloatArray, values: Mapping[str, FloatArray]) -> None:
        end = self._count + len(time)
        if end > self._held.shape[1]:
            larger = np.empty((self._held.shape[0], max(end, 2 * self._held.shape[1])))
            larger[:, : self._count] = self._held[:, : self._count]
            self._held = larger
        self._held[0, self._count : end] = time
        for place, name in enumerate(self.channels, start=1):
            self._held[place, self._count : end] = values.get(name, np.nan)
        self._count = end

    def _thin(self) -> None:
        older = self._count // 2 - (self._count // 2) % _BUNCH
        time, columns = envelope(self._held[0, :older], list(self._held[1:, :older]), _BUNCH)
        held = np.empty_like(self._held)
        kept, rest = len(time), self._count - older
        held[0, :kept] = time
        for place, column in enumerate(columns, start=1):
            held[place, :kept] = column
        held[:, kept : kept + rest] = self._held[:, older : self._count]
        # Another array: whoever reads the old one continues with what it has.
        self._held, self._count = held, kept + rest
        self.thinned += 1
