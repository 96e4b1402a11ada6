"""What a bench gives out, row after row: a signal, or what decides its voltages while the readings come."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Mapping
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.signals import Signal

FloatArray = npt.NDArray[np.float64]

ENDLESS: Final = sys.maxsize
"""As many rows as nobody waits for."""

_AT_ONCE: Final = 1024
"""Rows of a signal that are computed at once: one call costs as much for one row as for hundreds."""


class RowSource(Protocol):
    """The voltages of the rows of a record, asked for piece by piece.

    A bench asks for every row once, in order, and some time before it is given out: a chassis half a second, a chassis
    that is simulated up to 20 s, a virtual bench a block. What was read comes back through ``look``, so that a source
    may compute voltages from readings. Its text, ``str(source)``, is in the record; without one, its class does.
    """

    @property
    def length(self) -> int | None:
        """How many rows it has; None where it continues until it is ended."""

    def voltages(self, first_row: int, count: int, rate: float) -> FloatArray:
        """The voltages of some rows.

        Parameters
        ----------
        first_row : int
        count : int
        rate : float [Hz]
            Of the rows.

        Returns
        -------
        voltages : float array, shape (count,) [V]
        """

    def look(self, first_row: int, readings: Mapping[str, FloatArray]) -> None:
        """Take the readings of some rows, once the guard has checked them.

        Parameters
        ----------
        first_row : int
        readings : mapping of channel to float array, shape (n_rows,) [SI]
            Without those rows that the bench lost; NaN for a reading that is none.
        """


class SignalRows:
    """A signal as a source of rows: all is known beforehand, and readings change nothing.

    Parameters
    ----------
    signal : Signal
    length : int

    Examples
    --------
    >>> from ipmclab.signals import Square
    >>> SignalRows(Square(amplitude=1.0, frequency=1.0), 8).voltages(1, 3, rate=4.0).tolist()
    [1.0, -1.0, -1.0]
    """

    def __init__(self, signal: Signal, length: int) -> None:
        self.signal = signal
        self._length = length
        self._first = 0
        self._computed = np.empty(0)
        self._rate = 0.0

    @property
    def length(self) -> int:
        """How many rows there are."""
        return self._length

    def voltages(self, first_row: int, count: int, rate: float) -> FloatArray:
        """The voltages of some rows: see ``RowSource.voltages``."""
        start = first_row - self._first
        if rate != self._rate or start < 0 or start + count > len(self._computed):
            rows = np.arange(first_row, first_row + max(count, _AT_ONCE))
            self._first, self._rate, start = first_row, rate, 0
            self._computed = self.signal.voltage(rows / rate)
        return self._computed[start : start + count].copy()

    def look(self, first_row: int, readings: Mapping[str, FloatArray]) -> None:
        """Nothing: a signal does not depend on readings."""

    def __str__(self) -> str:
        return str(self.signal)


class RestedRows:
    """A source with rows at 0 V before and after it.

    Parameters
    ----------
    source : RowSource
    before, after : int
        Rows.
    length : int, optional
        Rows of the source that are played; all where it is left out.
    """

    def __init__(self, source: RowSource, before: int, after: int, length: int | None = None) -> None:
        self._source = source
        self._before = before
        self._after = after
        self._played = source.length if length is None else length

    @property
    def length(self) -> int | None:
        """How many rows there are with those at 0 V."""
        return None if self._played is None else self._before + self._played + self._after

    def voltages(self, first_row: int, count: int, rate: float) -> FloatArray:
        """The voltages of some rows: see ``RowSource.voltages``."""
        length = ENDLESS if self._played is None else self._played
        start = min(max(first_row - self._before, 0), length)
        stop = min(max(first_row + count - self._before, 0), length)
        voltages = np.zeros(count)
        if stop > start:
            at = start + self._before - first_row
            given = np.asarray(self._source.voltages(start, stop - start, rate), dtype=np.float64)
            if given.shape != (stop - start,):
                raise InputError(
                    f"the source was asked for {stop - start} voltages and gave an array of shape {given.shape}",
                    code="unequal-lengths",
                    where="source",
                    repair="return one voltage for each row",
                )
            voltages[at : at + stop - start] = given
        return voltages

    def look(self, first_row: int, readings: Mapping[str, FloatArray]) -> None:
        """Hand the readings on, in the rows of the source; those before its first row are negative."""
        self._source.look(first_row - self._before, readings)

    def __str__(self) -> str:
        named = type(self._source).__str__ is not object.__str__
        return str(self._source) if named else type(self._source).__name__


class ClampedRows:
    """A source that cannot leave its limits, and ends at 0 V.

    Parameters
    ----------
    source : RowSource
    low, high : float [V]
        No voltage is beyond them; what is no number becomes 0 V.
    more : int
        Rows at 0 V that follow.

    Examples
    --------
    >>> from ipmclab.signals import Step
    >>> clamped = ClampedRows(SignalRows(Step(35.0), 2), -3.5, 3.5, more=10)
    >>> clamped.length, clamped.voltages(0, 4, rate=50.0).tolist()
    (12, [3.5, 3.5, 0.0, 0.0])
    """

    def __init__(self, source: RowSource, low: float, high: float, more: int = 0) -> None:
        self._source = RestedRows(source, 0, more)
        self.low = low
        self.high = high

    @property
    def length(self) -> int | None:
        """How many rows there are with those that follow."""
        return self._source.length

    def voltages(self, first_row: int, count: int, rate: float) -> FloatArray:
        """The voltages of some rows: see ``RowSource.voltages``."""
        wanted = self._source.voltages(first_row, count, rate)
        if np.isnan(wanted).any():
            wanted = np.nan_to_num(wanted, nan=0.0)
        return np.asarray(wanted).clip(self.low, self.high)

    def look(self, first_row: int, readings: Mapping[str, FloatArray]) -> None:
        """Hand the readings on: see ``RowSource.look``."""
        self._source.look(first_row, readings)

    def __str__(self) -> str:
        return str(self._source)


def as_rows(source: Signal | RowSource, rows: int | None = None) -> RowSource:
    """A source of rows from what a bench is given.

    Parameters
    ----------
    source : Signal or RowSource
    rows : int, optional
        Of a signal; any other source knows how many it has.

    Raises
    ------
    InputError
        A signal without a number of rows.
    """
    if not isinstance(source, Signal):
        return source
    if rows is None:
        raise InputError(
            "a signal is given out for a number of rows",
            code="missing-rows",
            where="rows",
            repair="say for how many rows, such as 2000",
        )
    return SignalRows(source, rows)


class Feed:
    """A source that is taken piece by piece, and continues with its last voltage for as long as it is asked for.

    It is computed as it is taken, once: what was taken can be had once more, in the same order.

    Parameters
    ----------
    source : RowSource
        Of at least 1 row.
    rate : float [Hz]
    """

    def __init__(self, source: RowSource, rate: float) -> None:
        self._source = source
        self._rows = ENDLESS if source.length is None else source.length
        self._rate = rate
        self._computed = 0
        self._ready = np.empty(0)
        self._last = 0.0
        self._taken: deque[FloatArray] = deque()
        self._told = 0.0

    def prepare(self, count: int) -> None:
        """Compute the next ``count`` voltages, before time is short."""
        missing = count - len(self._ready)
        if missing <= 0:
            return
        parts, there = [self._ready], min(missing, self._rows - self._computed)
        if there > 0:
            parts.append(self._source.voltages(self._computed, there, self._rate))
            self._computed += there
            self._last = float(parts[-1][-1])
        parts.append(np.full(missing - there, self._last))
        self._ready = np.concatenate(parts)

    def take(self, count: int) -> FloatArray:
        """The next ``count`` voltages [V].

        Examples
        --------
        >>> from ipmclab.signals import Square
        >>> feed = Feed(SignalRows(Square(amplitude=1.0, frequency=1.0), 4), rate=4.0)
        >>> feed.take(3).tolist(), feed.take(3).tolist()
        ([1.0, 1.0, -1.0], [-1.0, -1.0, -1.0])
        >>> feed.again(2).tolist(), feed.again(3).tolist()
        ([1.0, 1.0], [-1.0, -1.0, -1.0])
        """
        self.prepare(count)
        found, self._ready = self._ready[:count], self._ready[count:]
        self._taken.append(found)
        return found

    def again(self, count: int) -> FloatArray:
        """The next ``count`` voltages [V] of those that were taken; from their end on the last of them."""
        parts, missing = [], count
        while missing and self._taken:
            part = self._taken.popleft()
            if len(part) > missing:
                self._taken.appendleft(part[missing:])
                part = part[:missing]
            missing -= len(part)
            parts.append(part)
        found = np.concatenate([*parts, np.empty(0)])
        if len(found):
            self._told = float(found[-1])
        return np.concatenate([found, np.full(missing, self._told)])
