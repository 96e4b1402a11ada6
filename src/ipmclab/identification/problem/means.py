"""A record made shorter for a search: means over rows in which the voltage stands still.

Where a record goes on at one voltage, its readings change ever more slowly, and neighbours say the same. A mean over
n rows weighs as n readings: the squares about the model are then those of all rows, less what both vary within a mean.
Of an exponential that began t ago, means over t/24 hide (1/24)^2/12 of what the rows know of its rate
(``docs/identification.md`` has the derivation). A search sees as much in means as in rows. What a fit says in the end
rests on every reading: from where the search ended, all rows are fitted.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.problem.record import PreparedRun, Reading
from ipmclab.run import FloatArray, Run

Rows = npt.NDArray[np.intp]

LONG: Final = 5_000
"""Rows of a record from which means save more than they cost."""

_PART: Final = 24  # rows after an edge for each row of a mean: means are then short beside what has passed
_GROWS: Final = 3  # times as long is the next longer mean: odd, so that each has a row in its middle
_STILL: Final = 0.02  # of the largest voltage
_WORTH: Final = 0.5  # of the rows: with more left, nothing is gained


def in_means(record: PreparedRun) -> PreparedRun | None:
    """A record as means of its rows; None where that is not worth while.

    Every row is in one mean. A mean of readings stands at the row in its middle, where the model differs from its own
    mean by the curvature alone; the voltage between two such rows is the mean of what was held between them.

    Parameters
    ----------
    record : PreparedRun
    """
    run = record.run
    if len(run) < LONG or not run.is_uniform or run.hold == "first":
        return None  # straight lines between rows need the rows at their ends
    # What holds from each row on.
    after = np.append(run.voltage[1:], run.voltage[-1]) if run.hold == "zero-before" else run.voltage
    first = _firsts(after)
    if len(first) > _WORTH * len(run):
        return None
    end = np.append(first[1:], len(run))
    middle = (first + end - 1) // 2
    every = np.ones(len(run), dtype=bool)
    voltage = _sums(after, every, middle, np.append(middle[1:], len(run)))[0]
    voltage /= np.diff(np.append(middle, len(run)))
    if run.hold == "zero-before":
        voltage = np.append(run.voltage[middle[0]], voltage[:-1])
    return replace(
        record,
        run=Run(time=run.time[middle], voltage=voltage, hold=run.hold, metadata=run.metadata),
        readings={output: _reading(one, first, end) for output, one in record.readings.items()},
    )


def _reading(reading: Reading, first: Rows, end: Rows) -> Reading:
    """Means of the readings that are measured; bounds stay where a mean is of one row."""
    total, rows = _sums(reading.values, reading.exact, first, end)
    alone = (end - first == 1) & reading.used[first]
    values = np.where(alone, reading.values[first], total / np.maximum(rows, 1))
    used = alone | (rows > 0)
    side = np.where(alone, reading.side[first], 0).astype(np.int8)
    return Reading(np.where(used, values, 0.0), used, side, reading.noise, np.sqrt(np.maximum(rows, 1.0)))


def _firsts(voltage: FloatArray) -> Rows:
    """The first row of each mean."""
    still = _STILL * float(np.abs(voltage).max(initial=0.0))
    found = []
    row, since = 0, 0
    while row < len(voltage):
        size = 1
        while _GROWS * size <= since // _PART + 1 and row + _GROWS * size <= len(voltage):
            size *= _GROWS
        while size > 1 and float(np.ptp(voltage[row : row + size])) > still:
            size //= _GROWS
        found.append(row)
        after = row + size
        moved = after < len(voltage) and abs(voltage[after] - voltage[row]) > still
        since = 0 if moved else since + size
        row = after
    return np.array(found, dtype=np.intp)


def _sums(values: FloatArray, used: npt.NDArray[np.bool_], first: Rows, end: Rows) -> tuple[FloatArray, Rows]:
    """Sums of what is used from one row up to another, and of how many."""
    total = np.concatenate([[0.0], np.cumsum(np.where(used, values, 0.0))])
    count = np.concatenate([[0], np.cumsum(used)])
    return total[end] - total[first], count[end] - count[first]
