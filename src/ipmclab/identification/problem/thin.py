"""Long records made shorter for a search: means over rows in which the voltage stands still.

Where a record goes on for hours at one voltage, its readings change ever more slowly, and neighbours say the same.
A search among many starts and valleys sees as much in means over rows, more of them the longer the last edge is past.
What a fit says in the end rests on every reading: from where the search ended, all rows are fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.problem.record import EdgeDelay, PreparedRun, Reading
from ipmclab.run import Run

FloatArray = npt.NDArray[np.float64]

LONG: Final = 10_000
"""Rows of all records together from which a search is shortened."""

_PART: Final = 48  # rows after an edge for each row of a mean: means are then short beside what has passed
_MOST: Final = 64  # rows of a mean
_STILL: Final = 0.02  # of the largest voltage
_WORTH: Final = 0.5  # of the rows: with more left, nothing is gained


def thinned(records: Sequence[PreparedRun], delays: Mapping[int, EdgeDelay]) -> list[PreparedRun] | None:
    """The records with fewer rows; None where that is not worth while.

    Parameters
    ----------
    records : sequence of PreparedRun
    delays : mapping of place to EdgeDelay
        Where the edges of foreign records lie: shortened records keep them there.
    """
    rows = sum(len(record.run) for record in records)
    if rows < LONG:
        return None
    found = [_thinned(record, delays.get(record.place)) for record in records]
    return found if sum(len(record.run) for record in found) < _WORTH * rows else None


def _thinned(record: PreparedRun, delay: EdgeDelay | None) -> PreparedRun:
    run = record.run
    if not run.is_uniform or run.hold == "first":
        return record  # straight lines between rows need the rows at their ends
    # What holds from each row on.
    after = np.append(run.voltage[1:], run.voltage[-1]) if run.hold == "zero-before" else run.voltage
    first = _firsts(after)
    sizes = np.diff(np.append(first, len(run)))
    # A mean stands for the middle of its rows: as many before the first as after.
    reach = np.minimum(sizes, np.append(1, sizes[:-1])) // 2
    begin, end = first - reach, first + reach + 1
    voltage = _means(after, np.ones(len(run), dtype=bool), first, first + sizes)[0]
    if run.hold == "zero-before":
        voltage = np.append(run.voltage[0], voltage[:-1])
    readings = {}
    for output, reading in record.readings.items():
        values, used = _means(reading.values, reading.exact, begin, end)
        # Bounds stay where no mean is taken.
        single = reach == 0
        side = np.where(single, reading.side[first], 0).astype(np.int8)
        used |= single & reading.used[first]
        values = np.where(single, reading.values[first], values)
        readings[output] = Reading(np.where(used, values, 0.0), used, side, reading.noise)
    return replace(
        record,
        run=Run(time=run.time[first], voltage=voltage, hold=run.hold, metadata=run.metadata),
        readings=readings,
        known_delay=delay.value if record.delay_is_free and delay is not None else record.known_delay,
    )


def _firsts(voltage: FloatArray) -> npt.NDArray[np.intp]:
    """The first row of each mean."""
    still = _STILL * float(np.abs(voltage).max(initial=0.0))
    found = []
    row, since = 0, 0
    while row < len(voltage):
        size = 1
        while 2 * size <= min(_MOST, since // _PART + 1) and row + 2 * size <= len(voltage):
            size *= 2
        while size > 1 and float(np.ptp(voltage[row : row + size])) > still:
            size //= 2
        found.append(row)
        after = row + size
        moved = after < len(voltage) and abs(voltage[after] - voltage[row]) > still
        since = 0 if moved else since + size
        row = after
    return np.array(found, dtype=np.intp)


def _means(
    values: FloatArray, used: npt.NDArray[np.bool_], begin: npt.NDArray[np.intp], end: npt.NDArray[np.intp]
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Means of what is used from one row up to another, and where there are any."""
    total = np.concatenate([[0.0], np.cumsum(np.where(used, values, 0.0))])
    count = np.concatenate([[0], np.cumsum(used)])
    end = np.minimum(end, len(values))
    number = count[end] - count[begin]
    return (total[end] - total[begin]) / np.maximum(number, 1), number > 0
