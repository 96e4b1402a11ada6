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
    sensor : tuple of str
        What the sensor may add to the readings: ``offset``, ``drift``.
    """

    drive: Drive
    time: FloatArray
    readings: FloatArray
    weight: FloatArray
    free_start: bool = False
    step: float | None = None
    sensor: tuple[str, ...] = ()


def side_by_side(series: Sequence[SearchedRun]) -> Iterator[tuple[SearchedRun, slice, int]]:
    """Each run with its rows among those of all, and the place of its free start among these (0: it has none)."""
    begin = starts = 0
    for run in series:
        starts += run.free_start
        yield run, slice(begin, begin + len(run.time)), starts if run.free_start else 0
        begin += len(run.time)


def of_sensors(series: Sequence[SearchedRun]) -> FloatArray:
    """What the sensors of some runs add, all runs side by side: a row for each zero and slope.

    Returns
    -------
    rows : float array, shape (n_constants, n_total)
        1 for a zero; a slope is counted over the whole run.
    """
    rows = np.zeros((sum(len(run.sensor) for run in series), sum(len(run.time) for run in series)))
    left = iter(rows)
    for run, own, _ in side_by_side(series):
        for what, row in zip(run.sensor, left, strict=False):
            row[own] = 1.0 if what == "offset" else run.time / run.time[-1]
    return rows


def moves_of_rows(rows: FloatArray) -> FloatArray:
    """The edges of one of some records a row earlier or later, and those of all, shape (n_moves, n_records).

    No farther than they are searched.
    """
    each, every = np.eye(len(rows)), np.ones((1, len(rows)))
    moved = np.unique(rows + np.vstack([each, -each, every, -every]), axis=0)
    return np.asarray(moved[np.all((moved > -LONGEST_DELAY) & (moved <= LONGEST_DELAY), axis=1)])
