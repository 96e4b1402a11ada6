"""The input of a run between its rows, and what a pole answers to it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.poles_loop import pole_response, shifted_levels

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

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


def complex_responses(drive: Drive, poles: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """The same of complex poles."""
    from ipmclab.model.numerics.tangents_modal_loop import pole_courses, pole_moves

    count, times = len(poles), len(drive.present)
    moves = np.empty((6, len(drive.durations), count), dtype=np.complex128)
    pole_moves(poles, drive.durations, 1.0, moves)
    row = np.full(len(drive.kind) + 1, -1)
    row[slice(None) if drive.rows is None else drive.rows] = np.arange(times)
    places = np.arange(0), np.arange(count), 2 * count + np.arange(count)
    courses = np.empty((2, 2, count, times))  # real and imaginary parts, of answers and slopes
    none_real = np.empty((*moves.shape[:2], 0))
    given = drive.kind, drive.start, drive.end, row, 0.0, courses.reshape(-1, times)
    pole_courses(none_real, moves, places, *given)
    found = np.empty((2, count, times), dtype=np.complex128)
    found.real, found.imag = courses
    return found[0], found[1]


def shifted(voltage: FloatArray, step: float, delay: float, *, from_rest: bool) -> Drive:
    """The same as a time line gives for a delay at regular rows, in a hundredth of its time.

    Parameters
    ----------
    voltage : float array, shape (n_time,) [V]
        Held from each row on.
    step : float [s]
        Between rows.
    delay : float [s]
        By how much its edges lie after the rows.
    from_rest : bool
        Whether it was 0 V before the first row, at rest.
    """
    rows = delay / step
    whole = math.floor(rows + 1e-9)
    part = rows - whole
    # The input begins with the first edge where that comes before the record; a given state begins at row 0.
    first = min(whole, 0) if from_rest else 0
    between = part >= 1e-9
    levels = np.concatenate([[0.0 if from_rest else voltage[0]], voltage])
    steps = (len(voltage) - 1 - first) * (2 if between else 1)
    kind, level, knots = np.empty(steps, np.int64), np.empty(steps), np.empty(len(voltage), np.intp)
    shifted_levels(levels, whole, first, between, kind, level, knots)
    read = np.clip(np.arange(len(voltage)) - whole + (0 if between else 1), 0, len(voltage))
    durations = np.array([part * step, (1.0 - part) * step] if between else [step])
    return Drive(durations, kind, level, level, levels[read], knots)
