"""The input of a run between its rows, and what a pole answers to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.poles_loop import pole_response

FloatArray = npt.NDArray[np.float64]

_EVERY: Final = np.empty(0, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Drive:
    """The input of one run between its knots: straight from ``start`` to ``end`` over each step.

    Step k lasts ``durations[kind[k]]``. ``present`` is the input as read at each row; ``rows`` are the knots at which
    the rows lie (None: all).
    """

    durations: FloatArray
    kind: npt.NDArray[np.int64]
    start: FloatArray
    end: FloatArray
    present: FloatArray
    rows: npt.NDArray[np.intp] | None = None


def responses(drive: Drive, poles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Response to the drive of 1/(s - pole) and its derivative with respect to the pole, shape (n_pole, n_time)."""
    state = np.empty((len(poles), len(drive.present)))
    slope = np.empty_like(state)
    respond(drive, poles, state, slope)
    return state, slope


def respond(drive: Drive, poles: FloatArray, state: FloatArray, slope: FloatArray) -> None:
    """Write the same where it is wanted."""
    rows = _EVERY if drive.rows is None else drive.rows
    pole_response(drive.durations, drive.kind, drive.start, drive.end, poles, rows, state, slope)
