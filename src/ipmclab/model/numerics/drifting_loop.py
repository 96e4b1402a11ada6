"""The compiled loop over samples of a system whose parameters drift in pieces, with or without static laws at ports."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.environment.path import Panel
from ipmclab.model.environment.track_loop import (
    NOW,
    Track,
    expect,
    go_on,
    look,
    no_lines,
    numbers_there,
    stay,
)
from ipmclab.model.numerics.compiled import kernel
from ipmclab.model.numerics.course import Course
from ipmclab.model.numerics.dense_loop import LawTable
from ipmclab.model.numerics.kernels import times_columns
from ipmclab.model.numerics.law_loop import solve_several
from ipmclab.model.numerics.law_near_loop import ANCHOR, solve_near
from ipmclab.model.numerics.vectors_loop import WIDTH, begin_of

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]


_LONG = 8
"""Intervals of a piece in which one more makes little difference."""


class Knots(NamedTuple):
    """The system at all states of a panel.

    Each as in ``dense_loop``, flattened: ``moves`` (n_kinds, n_states, n_moves) has ``step``, ``law_end`` and
    ``drop`` of an interval one after the other, ``reads`` (n_states, n_reads) ``outputs``, ``ports`` and ``drop``
    within an instant.
    """

    moves: FloatArray
    reads: FloatArray


class Drive(NamedTuple):
    """What is given to the strip.

    Parameters
    ----------
    course : Course
    ends : float array, shape (n_intervals + 1,) [s]
        When each interval ends, behind the begin of the record.
    area : float [m^2]
        Through which the laws leak together.
    """

    course: Course
    ends: FloatArray
    area: float


class Marching(NamedTuple):
    """What goes along.

    Parameters
    ----------
    x : float array, shape (n,)
        A state that goes on where parameters change: charges, not voltages, where capacitances do.
    laws : float array, shape (2 n_laws,)
        p and w.
    walk : float array, shape (WALK,)
        Where the water is.
    """

    x: FloatArray
    laws: FloatArray
    walk: FloatArray


class _AtLaws(NamedTuple):
    """The voltages p that laws read and the currents w that they give, for inputs that were seen; r is p + drop w."""

    r: FloatArray
    p: FloatArray
    w: FloatArray
    seen: FloatArray


@kernel
def _see(ports: FloatArray, inputs: FloatArray, i: int, x: FloatArray, now: _AtLaws) -> None:
    """What the ports read of the inputs in row i and of the state, but for what the laws lower themselves."""
    given = inputs.shape[1]
    for g in range(given):
        now.seen[g] = inputs[i, g]
    for l in range(now.r.shape[0]):  # noqa: E741
        total = 0.0
        for g in range(given):
            total += ports[l, g] * inputs[i, g]
        for j in range(x.shape[0]):
            total += ports[l, given + j] * x[j]
        now.r[l] = total


@kernel
def _was_seen(inputs: FloatArray, i: int, now: _AtLaws) -> bool:
    """Whether p and w already hold for the inputs in row i."""
    same = True
    for g in range(inputs.shape[1]):
        same = same and inputs[i, g] == now.seen[g]
    return same


@kernel
def _solve(table: LawTable, q: FloatArray, now: _AtLaws, anchor: FloatArray) -> bool:
    """Find p and w from r, beside the last ones; False where there is no solution.

    One law is expanded about an anchor, which is laid anew where q has changed: zeros then.
    """
    forms, coefficients = table
    if forms.shape[0] > 1:
        return solve_several(forms, coefficients, q, now.r, now.p, now.w)
    k, about = begin_of(coefficients), begin_of(anchor)
    now.p[0], now.w[0] = solve_near(forms[0], k, q[0, 0], now.r[0], now.p[0], about)
    return not math.isnan(now.p[0])


@kernel
def _write(read: FloatArray, reading: FloatArray, k: int, x: FloatArray, w: FloatArray, outputs: FloatArray) -> None:
    """The outputs of row k."""
    given, n = reading.shape[1], x.shape[0]
    for o in range(outputs.shape[0]):
        total = 0.0
        for g in range(given):
            total += read[o, g] * reading[k, g]
        for j in range(n):
            total += read[o, given + j] * x[j]
        for l in range(w.shape[0]):  # noqa: E741
            total += read[o, given + n + l] * w[l]
        outputs[o, k] = total


@kernel
def _begin(start: FloatArray, end: FloatArray, i: int, x: FloatArray, w: FloatArray, from_here: FloatArray) -> None:
    """Inputs, their changes, state and laws as interval i begins, side by side."""
    given, n = start.shape[1], x.shape[0]
    for g in range(given):
        from_here[g] = start[i, g]
        from_here[given + g] = end[i, g] - start[i, g]
    for j in range(n):
        from_here[2 * given + j] = x[j]
    for l in range(w.shape[0]):  # noqa: E741
        from_here[2 * given + n + l] = w[l]


@kernel
def drifting(
    track: Track,
    panel: Panel,
    knots: Knots,
    table: LawTable,
    drive: Drive,
    first: int,
    march: Marching,
    water: FloatArray,
    outputs: FloatArray,
) -> tuple[int, bool]:
    """As ``dense_loop.dense`` from an interval on, as far as a panel reaches.

    Parameters
    ----------
    first : int
        The interval.
    march : Marching
        Written.
    water : float array, shape (4, n)
        Its course (``track_loop.set_out``); written.

    Returns
    -------
    interval : int
        Up to which all is written; it needs another panel unless it is the end.
    found : bool
        False where laws have no solution in it (only where numbers overflow).
    """
    interval, start, end, row, reading = drive.course
    count, walk, ends = interval.shape[0], march.walk, drive.ends
    n, m, given = march.x.shape[0], table.forms.shape[0], start.shape[1]
    columns = 2 * given + n + m
    moves, reads = np.empty(knots.moves.shape[2]), np.empty(knots.reads.shape[1])
    step, law_end = moves[: n * columns].reshape(n, columns), moves[n * columns : n * (columns + m)].reshape(n, m)
    drop, within = moves[n * (columns + m) :].reshape(m, m), reads[reads.shape[0] - m * m :].reshape(m, m)
    seen = given + n
    shown = (reads.shape[0] - m * m - m * seen) // (seen + m)
    read = reads[: shown * (seen + m)].reshape(shown, seen + m)
    ports = reads[shown * (seen + m) : reads.shape[0] - m * m].reshape(m, seen)
    lines, read_lines = no_lines(knots.moves.shape[0], moves.shape[0]), no_lines(1, reads.shape[0])
    x, now = march.x, _AtLaws(np.empty(m), march.laws[:m], march.laws[m:], np.full(given, np.nan))
    # The step by columns, filled up with zeros: all sums are made at once, in the order of the columns.
    width = -(-n // WIDTH) * WIDTH
    by_columns, base, from_here = np.zeros(columns * width), np.empty(width), np.empty(columns)
    first_column, result, at_end = begin_of(by_columns), begin_of(base), base[:n]
    instant_anchor, end_anchor = np.zeros(ANCHOR), np.zeros(ANCHOR)
    i = first
    while i < count:
        last = _last_in(ends, i, count, walk[NOW] + stay(track, panel, walk))
        if not look(track, panel, walk, 0.5 * (ends[i] + ends[last])):
            return i, True
        numbers_there(panel, knots.reads, walk, read_lines, 0, reads)
        now.seen[:] = np.nan
        instant_anchor[:] = 0.0
        expected, room = expect(track, panel, walk)
        lost, flowed, kind = 0.0, 0.0, -1
        for j in range(i, last):
            if interval[j] != kind:
                kind = interval[j]
                numbers_there(panel, knots.moves[kind], walk, lines, kind, moves)
                end_anchor[:] = 0.0
                for c in range(columns):
                    for s in range(n):
                        by_columns[c * width + s] = step[s, c]
            if row[j] >= 0:
                if m > 0 and not _was_seen(reading, row[j], now):
                    _see(ports, reading, row[j], x, now)
                    if not _solve(table, within, now, instant_anchor):
                        return j, False
                _write(read, reading, row[j], x, now.w, outputs)
            if m > 0 and not _was_seen(start, j, now):
                _see(ports, start, j, x, now)
                if not _solve(table, within, now, instant_anchor):
                    return j, False
            _begin(start, end, j, x, now.w, from_here)
            times_columns(first_column, 0, columns, width, from_here, result)
            length = ends[j + 1] - ends[j]
            if m > 0:
                _see(ports, end, j, at_end, now)
                if not _solve(table, drop, now, end_anchor):
                    return j, False
                for l in range(m):  # noqa: E741
                    lost += abs(now.w[l]) * length
                    flowed += now.w[l] * length
            for s in range(n):
                total = base[s]
                for l in range(m):  # noqa: E741
                    total += law_end[s, l] * now.w[l]
                x[s] = total
            if lost > drive.area * (room + expected * (ends[j + 1] - walk[NOW])):
                last = j + 1  # more leaks than was expected: the piece ends here
                break
        lost, flowed = lost / drive.area, flowed / drive.area
        go_on(track, walk, ends[last], lost, flowed, water)
        i = last
        if i == count and row[i] >= 0:
            if m > 0 and not _was_seen(reading, row[i], now):
                _see(ports, reading, row[i], x, now)
                if not _solve(table, within, now, instant_anchor):
                    return i, False
            _write(read, reading, row[i], x, now.w, outputs)
    return i, True


@kernel
def _last_in(ends: FloatArray, first: int, count: int, until: float) -> int:
    """The interval behind the last of a piece that begins with one and should end by a time [s]."""
    last = first + 1
    while last < count and ends[last + 1] <= until + 1e-9:
        last += 1
    # A long piece has one interval more, so that it ends behind the time of the water that it was made for.
    return min(count, last + 1) if last - first >= _LONG else last
