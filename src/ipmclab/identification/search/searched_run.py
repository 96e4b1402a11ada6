"""One run as the searches for poles see it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ipmclab.identification.problem.record import LONGEST_DELAY
from ipmclab.model.numerics.drive import Drive
from ipmclab.run import FloatArray


@dataclass(frozen=True, eq=False)
class SearchedRun:
    """One run as the search sees it.

    Parameters
    ----------
    drive : Drive
    time : float array, shape (n_time,) [s]
        Since the start of the drive.
    readings : float array, shape (n_time,)
        Zero where ``weight`` is.
    weight : float array, shape (n_time,)
        One over the noise; zero for a reading to be left out.
    free_start : bool
        Whether the state at the start is unknown.
    step : float [s], optional
        Between two rows, where readings are means of several.
    """

    drive: Drive
    time: FloatArray
    readings: FloatArray
    weight: FloatArray
    free_start: bool = False
    step: float | None = None


def side_by_side(series: Sequence[SearchedRun]) -> Iterator[tuple[SearchedRun, slice, int]]:
    """Each run with its rows among those of all, and the place of its free start among these (0: it has none)."""
    begin = starts = 0
    for run in series:
        starts += run.free_start
        yield run, slice(begin, begin + len(run.time)), starts if run.free_start else 0
        begin += len(run.time)


def moves_of_rows(rows: FloatArray) -> FloatArray:
    """The edges of one of some records a row earlier or later, and those of all, shape (n_moves, n_records).

    No farther than they are searched.
    """
    each, every = np.eye(len(rows)), np.ones((1, len(rows)))
    moved = np.unique(rows + np.vstack([each, -each, every, -every]), axis=0)
    return np.asarray(moved[np.all((moved > -LONGEST_DELAY) & (moved <= LONGEST_DELAY), axis=1)])
