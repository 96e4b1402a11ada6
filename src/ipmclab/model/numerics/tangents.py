"""Outputs over a time line with their derivatives, by matrices: laws at ports or none, poles that meet or do not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ipmclab.model.joined import Joined
from ipmclab.model.numerics.course import Course
from ipmclab.model.numerics.dense import check_solved, linear
from ipmclab.model.numerics.discretise import step_and_slopes
from ipmclab.model.numerics.timeline import Timeline

if TYPE_CHECKING:
    from ipmclab.model.numerics.dense_loop import Columns, Trace
    from ipmclab.model.numerics.moved_loop import Matrices, Moved

FloatArray = npt.NDArray[np.float64]

Shape = tuple[int, int, int, int, int, int, int]
"""Kinds of intervals, states, outputs, laws, columns, rows and intervals."""


@dataclass(frozen=True, eq=False)
class Scratch:
    """What the loops write on between their begin and their end; it serves one evaluation after the other."""

    columns: Columns
    trace: Trace
    slopes: FloatArray
    moved: Moved
    laws: FloatArray
    tangents: FloatArray

    @classmethod
    def of(cls, shape: Shape) -> Scratch:
        """Of this size."""
        from ipmclab.model.numerics import dense_loop, moved_loop, tangents_loop

        kinds, n, outputs, m, width, rows, intervals = shape
        columns = dense_loop.columns_for(kinds, 1, n, outputs, m)
        trace = dense_loop.trace_for(columns, 1, rows, intervals)
        return cls(
            columns,
            trace,
            np.empty((4, *trace.voltages.shape)),
            moved_loop.moved_for(kinds, n, outputs, m, width),
            dense_loop.room(columns, 1),
            tangents_loop.room(n, m),
        )


def moves(joined: Joined, durations: FloatArray, *, moved: bool) -> tuple[Matrices, Matrices]:
    """What a system does over intervals of some durations [s], and its derivatives, which have no columns unless they
    are wanted (``moved``).
    """
    from ipmclab.model.numerics.moved_loop import Matrices

    at, by = joined.at, joined.by
    step, by_step = step_and_slopes(at.a, at.drive, 1, durations, (by.a, by.drive) if moved else None)
    return Matrices(step, at.outputs, at.ports), Matrices(by_step, by.outputs, by.ports)


def outputs_along(at: Matrices, line: Timeline, state: FloatArray) -> FloatArray:
    """The outputs of a linear system at the rows of a time line, shape (n_outputs, n_time)."""
    values = np.empty((len(at.outputs), len(line.reading)))
    linear(at.step, at.outputs, line.course, state.copy(), values)
    return values


def tangents(
    joined: Joined, moved: tuple[Matrices, Matrices], line: Timeline, state: FloatArray, scratch: Scratch
) -> tuple[FloatArray, FloatArray]:
    """The outputs at the rows of a time line, and their derivatives.

    Parameters
    ----------
    joined : Joined
    moved : tuple of Matrices
        Of ``moves``.
    line : Timeline
    state : float array, shape (n,)
        The initial state.
    scratch : Scratch
        Of this size; written.

    Returns
    -------
    values : float array, shape (n_outputs, n_time)
    derivatives : float array, shape (n_outputs, n_time, n_columns)
        By the parameters, by the initial states and by the delay, as ``Joined`` was asked.

    Raises
    ------
    IpmclabError
        The equation of a law has no solution in floating point.
    """
    from ipmclab.model.numerics.moved_loop import lay_out
    from ipmclab.model.numerics.tangents_loop import Later, carry_tangents

    (at, by), numbers, course, trace = moved, joined.at, line.course, scratch.trace
    derivatives = np.empty((len(at.outputs), len(line.reading), joined.width))
    if len(joined.forms):
        values = _traced_with_laws(joined, at, course, state, scratch)
    else:
        values = _traced(at, course, state, trace)
    lay_out(at, by, joined.by.coefficients, scratch.moved)
    flow = np.concatenate([numbers.drive[:, :1], numbers.a, numbers.drive[:, 1:]], axis=1)
    later = Later(
        column=joined.columns - 1 if joined.by_delay else -1,
        durations=line.durations,
        rate=line.rate,
        reading_rate=line.reading_rate,
        arrives=line.arrives,
        leaves=line.leaves,
        flow=flow,
    )
    first, written = joined.count if joined.by_states else -1, scratch.tangents
    carry_tangents(at, scratch.moved, course, trace, scratch.slopes, later, first, written, derivatives)
    return values, derivatives[..., : joined.columns]


def _traced(at: Matrices, course: Course, state: FloatArray, trace: Trace) -> FloatArray:
    """The outputs of a system without laws, whose trace is written: the kernel that simulates it shows its state too.

    The loop for laws would do the same, and takes a third of all the time that compiling a first fit takes.
    """
    intervals, outputs, seen = len(course.interval), len(at.outputs), np.eye(at.outputs.shape[1])
    values = np.empty((outputs + len(seen), len(course.reading)))
    linear(at.step, np.vstack([at.outputs, seen]), course, state.copy(), values)
    trace.rows[: values[outputs:].size] = values[outputs:].T.ravel()
    begun = np.empty((len(seen), intervals))
    each = course._replace(row=np.append(np.arange(intervals), -1), reading=course.start)
    linear(at.step, seen, each, state.copy(), begun)
    begins = np.hstack([course.start, course.end - course.start, begun[1:].T])
    trace.begins[: begins.size] = begins.ravel()
    return values[:outputs]


def _traced_with_laws(joined: Joined, at: Matrices, course: Course, state: FloatArray, scratch: Scratch) -> FloatArray:
    """The same of a system with laws, and how these rise along its trace."""
    from ipmclab.model.numerics.dense_loop import LawTable, dense, fill
    from ipmclab.model.numerics.tangents_loop import law_slopes

    values, table = np.empty((len(at.outputs), len(course.reading))), LawTable(joined.forms, joined.at.coefficients)
    fill(at.step, at.outputs, at.ports, table, 1, scratch.columns)
    check_solved(dense(scratch.columns, table, course, state.copy(), values, scratch.laws, scratch.trace))
    law_slopes(table, scratch.trace.voltages, scratch.slopes)
    return values
