"""Which rows of a record were given to a fit, whatever file they were read from: identified by marks of its readings.

The checksum of a run is that of all its rows: of a longer or a shorter cut of the same record it says nothing, and cuts
made by other programs keep no clock. Readings have noise, so that 64 of them in a row happen once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.run import Run
from ipmclab.tabled import Tabled

_CHANNELS: Final = ("current", "displacement", "force")  # the first that moves is marked
_TOGETHER: Final = 64  # consecutive readings of one mark
_MARKS: Final = 64  # of a run, evenly spaced
_LEVELS: Final = 3  # different readings of a mark, at least: what does not move looks alike in every record
_FEWEST: Final = 2  # marks that have to be found again, at the same distance
_ODD: Final = np.uint64(0x9E3779B97F4A7C15)  # of a multiplicative hash: 2^64 over the golden ratio
_POWERS: Final = _ODD ** np.arange(_TOGETHER, dtype=np.uint64)[::-1]  # by which the readings of a mark count


@dataclass(frozen=True)
class RowMarks(Tabled):
    """By what the rows of a run are known again.

    Parameters
    ----------
    channel : str
        Whose readings are marked.
    rows : int
        Of the run.
    at : tuple of int
        The first row of each mark.
    checks : tuple of str
        A check of the 64 readings from there on.
    """

    channel: str
    rows: int
    at: tuple[int, ...]
    checks: tuple[str, ...]

    @classmethod
    def of(cls, run: Run) -> RowMarks | None:
        """The marks of a run; None where no reading moves, or there are too few."""
        for channel in (name for name in _CHANNELS if name in run.channels):
            values = run.channels[channel]
            last = len(values) - _TOGETHER
            if last < 0:
                return None
            at = np.linspace(0, last, min(_MARKS, 1 + last // _TOGETHER)).astype(np.intp)
            marked = values[np.add.outer(at, np.arange(_TOGETHER))]
            levels = 1 + np.count_nonzero(np.diff(np.sort(marked, axis=1), axis=1) > 0.0, axis=1)  # NaN comes last
            at, marked = at[levels >= _LEVELS], marked[levels >= _LEVELS]
            if len(at) >= _FEWEST:
                checks = tuple(f"{check:016x}" for check in _checks(marked.T)[0].tolist())
                return cls(channel, len(values), tuple(at.tolist()), checks)
        return None

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> RowMarks:
        """Read what ``to_table`` gave."""
        one = cls(**{**table, "at": tuple(map(int, table["at"])), "checks": tuple(map(str, table["checks"]))})
        if len(one.at) != len(one.checks):
            raise ValueError(f"{len(one.at)} rows and {len(one.checks)} checks of them in 'marks'")
        return one

    def rows_of(self, run: Run) -> tuple[int, int] | None:
        """The first row and the one after the last that a run shares with the run of these marks; None if none."""
        if self.channel not in run.channels:
            return None
        here = _checks(run.channels[self.channel])
        found = [
            np.flatnonzero(here == np.uint64(int(check, 16))) - row
            for row, check in zip(self.at, self.checks, strict=True)
        ]
        shifts = Counter(int(shift) for of_mark in found for shift in of_mark)
        shift, again = max(shifts.items(), key=lambda one: one[1], default=(0, 0))
        wanted = sum(0 <= row + shift < len(here) for row in self.at)
        if again < _FEWEST or 2 * again < wanted:
            return None
        return max(0, shift), min(len(run), self.rows + shift)


def shared_rows(marks: Iterable[RowMarks], run: Run) -> tuple[int, int] | None:
    """The most rows of a run that one of the runs of a fit has too: the first, and the one after the last."""
    found = [rows for one in marks if (rows := one.rows_of(run)) is not None]
    return max(found, key=lambda rows: rows[1] - rows[0], default=None)


def _checks(values: npt.NDArray[np.float64]) -> npt.NDArray[np.uint64]:
    """A check of the readings from each row on, shape (n_time - 63, ...), or empty."""
    bits = np.ascontiguousarray(values + 0.0, dtype=np.float64).view(np.uint64)  # no minus zero
    mixed = (bits ^ (bits >> np.uint64(32))) * _ODD
    mixed ^= mixed >> np.uint64(29)
    if len(mixed) < _TOGETHER:
        return mixed[:0]
    return np.asarray(np.lib.stride_tricks.sliding_window_view(mixed, _TOGETHER, axis=0) @ _POWERS)
