"""The course of a simulation: what drives a system over its intervals, and where rows are read."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]


class Course(NamedTuple):
    """What the compiled loops go along; every input is a straight line within an interval.

    Parameters
    ----------
    interval : int array, shape (n_intervals,)
        The kind of each interval.
    start, end : float arrays, shape (n_intervals, n_inputs) [SI]
        The inputs at both ends of each interval.
    row : int array, shape (n_intervals + 1,)
        The row that is read where interval i begins (and after the last), or -1.
    reading : float array, shape (n_time, n_inputs) [SI]
        The inputs that each row sees.
    """

    interval: IndexArray
    start: FloatArray
    end: FloatArray
    row: IndexArray
    reading: FloatArray


def voltage_course(
    interval: IndexArray, start: FloatArray, end: FloatArray, row: IndexArray, reading: FloatArray
) -> Course:
    """The course of a system whose only input is the voltage, from arrays of one axis."""
    return Course(interval, start[:, None], end[:, None], row, reading[:, None])
