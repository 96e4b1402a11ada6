"""The air around the strip, averaged to one reading a second."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

INTERVAL: Final = 1.0
"""Over so long [s] the readings are averaged."""


@dataclass(frozen=True)
class Air:
    """The means of one interval: its middle [s], and what was read in it (NaN for none)."""

    time: float
    values: Mapping[str, float]


class AirMean:
    """Averages what comes block by block.

    Parameters
    ----------
    names : sequence of str
        Of the readings.
    rate : float [Hz]

    Examples
    --------
    >>> mean = AirMean(("relative_humidity",), rate=2.0)
    >>> [air.time for air in mean.add(0, {"relative_humidity": np.array([40.0, 42.0, 50.0])}, 3)]
    [0.5]
    >>> [(air.time, air.values["relative_humidity"]) for air in mean.rest()]
    [(1.25, 50.0)]
    """

    def __init__(self, names: tuple[str, ...], rate: float) -> None:
        self._names = names
        self._rate = rate
        self._rows = max(1, round(INTERVAL * rate))
        self._place = 0
        self._last = 0
        self._sums = dict.fromkeys(names, 0.0)
        self._counts = dict.fromkeys(names, 0)

    def add(self, first_row: int, readings: Mapping[str, FloatArray], count: int) -> Iterator[Air]:
        """Take the readings of some rows; those of another length were taken some time during them.

        Yields
        ------
        air : Air
            Of each interval that is over.
        """
        edges = np.arange(first_row - first_row % self._rows, first_row + count, self._rows)
        for edge in edges.tolist():
            place = edge // self._rows
            if place != self._place:
                yield from self._finish((self._place + 1) * self._rows)
                self._place = place
            for name in self._names:
                values = readings.get(name)
                if values is None or not len(values):
                    continue
                if len(values) == count:
                    part = values[max(0, edge - first_row) : edge - first_row + self._rows]
                else:  # a slow instrument: its readings count where the rows begin
                    part = values if edge <= first_row else values[:0]
                part = part[np.isfinite(part)]
                self._sums[name] += float(part.sum())
                self._counts[name] += len(part)
            self._last = min(edge + self._rows, first_row + count)

    def rest(self) -> Iterator[Air]:
        """What there is of an interval that is not over."""
        yield from self._finish(self._last)

    def _finish(self, stop: int) -> Iterator[Air]:
        if any(self._counts.values()):
            start = self._place * self._rows
            values = {
                name: self._sums[name] / self._counts[name] if self._counts[name] else math.nan for name in self._names
            }
            yield Air((start + stop) / 2.0 / self._rate, values)
        self._sums = dict.fromkeys(self._names, 0.0)
        self._counts = dict.fromkeys(self._names, 0)
