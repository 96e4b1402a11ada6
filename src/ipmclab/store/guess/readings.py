"""What the cells of a column say of it: whether it is a time, counts rows, holds dates, or stands for no reading."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.run import FloatArray
from ipmclab.store.importers.columns import Columns
from ipmclab.store.importers.dates import DATE_ORDERS, DateOrder, read_dates

_EVEN: Final = 0.2
"""Steps of a time that nobody named: within this part of their median."""

_DAY: Final = 86_400_000_000_000  # ns

_NINES: Final = re.compile(
    r"-?(?:9{2,}(?:\.9+)?|9\.91?(?:e[+]?3[0-9])|1e[+]?3[0-9]|32767|32768|2147483647|2147483648)0*"
)
"""How numbers that stand for no reading are written by instruments."""

_MIDDLE: Final = (0.02, 0.98)
_FAR: Final = 3.0
"""A reading is far from the others where it is outside of their middle by more than so many times its width."""

_AGAIN: Final = 3
"""So many readings that are exactly one number, far from all others, are no chance."""

_MANY: Final = 10
"""A channel with fewer different readings is a signal of levels, which are far apart."""


@dataclass(frozen=True)
class Readings:
    """The numbers of a column.

    Parameters
    ----------
    values : float array, shape (n_rows,)
        NaN where there is none.
    """

    values: FloatArray

    @classmethod
    def of(cls, columns: Columns, place: int) -> Readings | None:
        """The numbers of a column; None where its cells are no numbers."""
        try:
            return cls(columns.numbers(place))
        except InputError:
            return None

    @property
    def present(self) -> FloatArray:
        """Those that are there."""
        return self.values[~np.isnan(self.values)]

    @property
    def count(self) -> int:
        return len(self.present)

    @property
    def rises(self) -> bool:
        """Whether every row has a number, none below the one before, and not all are one."""
        steps = np.diff(self.values)
        return len(steps) > 0 and bool(np.all(steps >= 0)) and bool(np.any(steps > 0))

    @property
    def is_regular(self) -> bool:
        """Whether the numbers rise in even steps, as times do."""
        steps = np.diff(self.values)
        return self.rises and bool(np.all(np.abs(steps - np.median(steps)) <= _EVEN * np.median(steps)))

    @property
    def counts_rows(self) -> bool:
        """Whether they are whole numbers from 0 that rise."""
        present = self.present
        return len(present) > 0 and present[0] >= 0 and bool(np.all(np.diff(present) > 0) and np.all(present % 1 == 0))


def find_dates(
    columns: Sequence[Sequence[Any] | npt.NDArray[Any]],
) -> tuple[tuple[int, ...], DateOrder, FloatArray] | None:
    """Which of some columns of texts say when the rows were read.

    Parameters
    ----------
    columns : sequence of sequence
        The cells of each.

    Returns
    -------
    places : tuple of int
        One column, or that of the date and that of the time of day.
    order : DateOrder
        The one that gives the shortest record: where all do, they give the same times.
    times : float array, shape (n_rows,) [s]
        From the first row.
    """
    whole: list[tuple[int, DateOrder, list[int]]] = []
    for place, cells in enumerate(columns):
        for order in DATE_ORDERS:
            try:
                read = read_dates(cells, order)
            except ValueError:
                continue
            if read and None not in read:
                whole.append((place, order, [time for time in read if time is not None]))
    clocks = [one for one in whole if one[1] == "time of day"]
    dated = sorted((one for one in whole if one[1] != "time of day"), key=lambda one: one[2][-1] - one[2][0])
    for place, order, times in dated:
        if any(time % _DAY for time in times):
            return (place,), order, _seconds(times)
        if clocks:
            joined = [day + clock % _DAY for day, clock in zip(times, clocks[0][2], strict=True)]
            return (place, clocks[0][0]), order, _seconds(joined)
    return ((clocks[0][0],), "time of day", _seconds(clocks[0][2])) if clocks else None


def _seconds(times: Sequence[int]) -> FloatArray:
    return np.array([(time - times[0]) / 1e9 for time in times])


def find_sentinels(present: FloatArray) -> tuple[list[float], list[tuple[float, int]]]:
    """The numbers that stand for no reading: those that surely do, and those that may, with how often they come.

    Examples
    --------
    >>> find_sentinels(np.array([0.1, 0.4, -99.9999, 0.2, -99.9999, 0.3]))
    ([-99.9999], [])
    """
    sure: list[float] = []
    perhaps: list[tuple[float, int]] = []
    rest = present
    for _ in range(4):
        values, counts = np.unique(rest, return_counts=True)
        if len(values) < 3:
            break
        ends = [(float(values[0]), int(counts[0])), (float(values[-1]), int(counts[-1]))]
        far = [(value, count) for value, count in ends if _is_far(value, rest[rest != value])]
        if not far:
            break
        value, count = far[0]
        if _NINES.fullmatch(f"{value:.10g}"):
            sure.append(value)
        elif count >= _AGAIN and len(values) > _MANY:
            perhaps.append((value, count))
        rest = rest[rest != value]
    return sorted(sure), perhaps


def _is_far(value: float, others: FloatArray) -> bool:
    low, high = np.quantile(others, _MIDDLE)
    return bool(max(low - value, value - high) > _FAR * max(high - low, 1e-12))
