"""The compiled loop over samples of a system with static laws at ports.

Matrices lie by columns, filled up to whole vectors: a product is a sum of columns, sixteen rows at a time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from ipmclab.model.blocks import Law
from ipmclab.model.numerics.compiled import kernel, part
from ipmclab.model.numerics.course import Course
from ipmclab.model.numerics.law_loop import solve_several
from ipmclab.model.numerics.law_near_loop import ANCHOR, solve_near
from ipmclab.model.numerics.law_rows_loop import LAW_ROWS, PAST_ROWS, WORK_ROWS, guess, nearby, put_laws, remember
from ipmclab.model.numerics.vectors_loop import (
    WIDTH,
    alike,
    begin_of,
    behind,
    filled,
    load,
    on_lines,
    plus,
    stays_apart,
    store,
)

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

_carray: Any = numba.carray  # type: ignore[attr-defined]


class LawTable(NamedTuple):
    """The laws: their forms, shape (n_laws,), and coefficients, shape (n_laws, 3)."""

    forms: IndexArray
    coefficients: FloatArray


def law_table(laws: Sequence[Law]) -> LawTable:
    """Of some laws."""
    return LawTable(
        np.array([law.form for law in laws], dtype=np.int64),
        np.array([law.coefficients for law in laws], dtype=np.float64).reshape(-1, 3),
    )


class Columns(NamedTuple):
    """What a system with laws does, by columns; rows are filled up with zeros to multiples of WIDTH.

    Parameters
    ----------
    step : float array, shape (n_kinds, 2 n_inputs + n + n_laws, n + n_outputs + n_laws filled up)
        What an interval of each kind makes of the inputs as it begins, of how much they change, of the state and of the
        laws as it begins. Its rows are the next state and the outputs there, then the voltages that the laws read: all
        but for what the laws give at the end.
    end : float array, shape (n_kinds, n_laws, n + n_outputs filled up)
        What the laws at the end add to next state and outputs.
    drop : float array, shape (n_kinds + 1, n_laws, width) [ohm]
        By how much w at the end of an interval of each kind lowers p there; in the last place within an instant.
    outputs : float array, shape (n_inputs + n + n_laws, outputs filled up)
        What is read within an instant of inputs, state and laws.
    ports : float array, shape (n_inputs + n, width)
        The voltages that the laws read within an instant, but for what they lower themselves.
    laws : float array, shape (LAW_ROWS, width)
        Of ``put_laws``.
    """

    step: FloatArray
    end: FloatArray
    drop: FloatArray
    outputs: FloatArray
    ports: FloatArray
    laws: FloatArray


def columns_for(kinds: int, inputs: int, states: int, outputs: int, laws: int) -> Columns:
    """Room for the columns of a system: zeros."""
    width = filled(laws)
    return Columns(
        *on_lines(
            (kinds, 2 * inputs + states + laws, filled(states + outputs + laws)),
            (kinds, laws, filled(states + outputs)),
            (kinds + 1, laws, width),
            (inputs + states + laws, filled(outputs)),
            (inputs + states, width),
            (LAW_ROWS, width),
        )
    )


def columns_of(step: FloatArray, outputs: FloatArray, ports: FloatArray, table: LawTable, inputs: int) -> Columns:
    """The columns of a system, from what ``fill`` takes."""
    columns = columns_for(len(step), inputs, step.shape[1], len(outputs), len(ports))
    fill(step, outputs, ports, table, inputs, columns)
    return columns


@kernel
def fill(
    step: FloatArray, outputs: FloatArray, ports: FloatArray, table: LawTable, inputs: int, columns: Columns
) -> None:
    """Write the columns of a system.

    Parameters
    ----------
    step : float array, shape (n_kinds, n, 2 n_inputs + n + 2 n_laws)
        What makes the next state: as in ``Columns``, then of the laws at the end.
    outputs : float array, shape (n_outputs, n_inputs + n + n_laws)
    ports : float array, shape (n_laws, n_inputs + n + n_laws)
    table : LawTable
    inputs : int
    columns : Columns
        Of ``columns_for``; written.
    """
    kinds, n, shown, m = step.shape[0], step.shape[1], outputs.shape[0], ports.shape[0]
    begun = columns.step.shape[1]
    put_laws(table.forms[0], table.coefficients, columns.laws)
    for o in range(shown):
        for c in range(inputs + n + m):
            columns.outputs[c, o] = outputs[o, c]
    for l in range(m):  # noqa: E741
        for c in range(inputs + n):
            columns.ports[c, l] = ports[l, c]
        for c in range(m):
            columns.drop[kinds, c, l] = -ports[l, inputs + n + c]
    for kind in range(kinds):
        for row in range(n + shown + m):
            for c in range(begun + m):
                if row < n:
                    total = step[kind, row, c]
                else:
                    reads = outputs[row - n] if row < n + shown else ports[row - n - shown]
                    # Of the inputs at the end, of the state there, and of the laws.
                    total = 0.0
                    if c < 2 * inputs:
                        total = reads[c % inputs]
                    elif c >= begun:
                        total = reads[inputs + n + c - begun]
                    for i in range(n):
                        total += reads[inputs + i] * step[kind, i, c]
                if c < begun:
                    columns.step[kind, c, row] = total
                elif row < n + shown:
                    columns.end[kind, c - begun, row] = total
                else:
                    columns.drop[kind, c - begun, row - n - shown] = -total


class Trace(NamedTuple):
    """What the laws and the state went through, which derivatives follow; empty where nobody asks (``trace_for``).

    Parameters
    ----------
    rows : float array, n_inputs + n + n_laws numbers for each row
        Inputs, state and laws as each row sees them, one after the other.
    begins : float array, 2 n_inputs + n + 2 n_laws numbers for each interval
        As each interval begins: inputs, how much they change until its end, state and laws; then the laws at its end.
    voltages : float array, shape (n_laws, n_time + 2 n_intervals filled up) [V]
        What the laws read at the rows, at the begins and at the ends.
    """

    rows: FloatArray
    begins: FloatArray
    voltages: FloatArray


def trace_for(columns: Columns, inputs: int, rows: int, intervals: int) -> Trace:
    """Room for a trace; whole vectors are written, beyond the last row too."""
    laws, begun = columns.drop.shape[1], columns.step.shape[1]
    return Trace(
        np.empty(rows * (begun - inputs) + WIDTH),
        np.empty(intervals * (begun + laws) + WIDTH),
        np.zeros((laws, filled(rows + 2 * intervals))),
    )


NO_TRACE: Final = Trace(np.zeros(0), np.zeros(0), np.zeros((0, 0)))

_AT_LAWS: Final = 3 + 2 * PAST_ROWS + WORK_ROWS


def room(columns: Columns, inputs: int) -> FloatArray:
    """What ``dense`` writes on."""
    kinds, laws, width = columns.drop.shape
    _, begun, made = columns.step.shape
    numbers = filled(3 * inputs) + filled(begun + made) + made + columns.outputs.shape[1]
    return on_lines((numbers + (_AT_LAWS + laws) * width + kinds * ANCHOR,))[0]


@part
def _times(columns: Any, count: int, rows: int, of: Any, result: Any) -> None:
    """The sum of columns times numbers: two sums, so that one goes on while the other waits."""
    for b in range(0, rows, WIDTH):
        one, two = alike(0.0), alike(0.0)
        for c in range(0, count - 1, 2):
            one = plus(one, alike(of[c]), load(columns, c * rows + b))
            two = plus(two, alike(of[c + 1]), load(columns, (c + 1) * rows + b))
        if count % 2 == 1:
            one = plus(one, alike(of[count - 1]), load(columns, (count - 1) * rows + b))
        store(result, b, one + two)


@kernel
def _from_anywhere(table: LawTable, lowered: Any, width: int, past: Any, r: Any, p: Any, w: Any) -> bool:
    """Solve what ``nearby`` did not, from the last solution."""
    stays_apart()
    count = table.forms.shape[0]
    drop = _carray(lowered, (count, width))[:, :count]
    for l in range(count):  # noqa: E741
        p[l] = past[l]
    return solve_several(
        table.forms, table.coefficients, drop, _carray(r, (count,)), _carray(p, (count,)), _carray(w, (count,))
    )


@part
def _copied(values: Any, count: int, target: Any) -> None:
    """Sixteen numbers at a time: what comes behind is written over."""
    for b in range(0, count, WIDTH):
        store(target, b, load(values, b))


@part
def _put(values: Any, first: int, shown: int, place: int, outputs: FloatArray) -> None:
    """The outputs of a row, which stand from a first place on."""
    for o in range(shown):
        outputs[o, place] = values[first + o]


@part
def _same(given: Any, count: int, seen: Any) -> bool:
    same = True
    for g in range(count):
        same = same and given[g] == seen[g]
    return same


@kernel
def dense(
    columns: Columns,
    table: LawTable,
    course: Course,
    x: FloatArray,
    outputs: FloatArray,
    written: FloatArray,
    trace: Trace,
) -> int:
    """The state over intervals of any length, read wherever an interval begins at a row; with static laws.

    What laws give goes in a straight line over an interval and jumps with the inputs. At the end of an interval state
    and laws hang on each other: with what the laws gave at its begin, the voltages that they read are
    ``p = r - drop w``, ``w = law(p)``, which has one solution. Where an input jumps, the state does not, and the same
    equation holds with what lies between the ports alone.

    Parameters
    ----------
    columns : Columns
    table : LawTable
        One or more, all of one form.
    course : Course
    x : float array, shape (n,)
        The state before the first interval; on return the state after the last.
    outputs : float array, shape (n_outputs, n_time)
        Written.
    written : float array
        ``room``.
    trace : Trace
        Written, where it is not empty.

    Returns
    -------
    failed : int
        -1, or the interval in which no solution was found (only where numbers overflow).
    """
    interval, start, end, row, reading = course
    n, m, given, shown = x.shape[0], table.forms.shape[0], start.shape[1], outputs.shape[0]
    width, within, read_rows = columns.drop.shape[2], columns.drop.shape[0] - 1, columns.outputs.shape[1]
    form, begun, made, high = table.forms[0], columns.step.shape[1], columns.step.shape[2], columns.end.shape[2]
    step, at_end, lowered = begin_of(columns.step), begin_of(columns.end), begin_of(columns.drop)
    read, ports, laws = begin_of(columns.outputs), begin_of(columns.ports), begin_of(columns.laws)
    k = begin_of(table.coefficients)
    starts, ends, readings = begin_of(start), begin_of(end), begin_of(reading)
    traced, instants, noted = trace.begins.shape[0] > 0, trace.voltages.shape[1], given + n + m
    rows, begins, voltages = begin_of(trace.rows), begin_of(trace.begins), begin_of(trace.voltages)
    # States begin on a cache line: what is stored across two is not there for a load that follows.
    seen, state = begin_of(written), behind(begin_of(written), -(-3 * given // WIDTH) * WIDTH)
    here, now = behind(state, -2 * given), behind(state, -given)
    # here: inputs as an interval begins, their change, state, laws; now: inputs within an instant, state, laws.
    current = behind(state, n)
    new = behind(state, -(-(begun + made) // WIDTH) * WIDTH)  # state and outputs at its end, and what the laws read
    shows = behind(new, made)
    p = behind(shows, read_rows)
    w, r, past = behind(p, width), behind(p, 2 * width), behind(p, 3 * width)
    past_within, work = behind(past, PAST_ROWS * width), behind(past, 2 * PAST_ROWS * width)
    anchors = behind(work, (WORK_ROWS + m) * width)
    written[:] = 0.0
    for j in range(n):
        state[j] = x[j]
    for g in range(given):
        seen[g] = np.nan
    for i in range(row.shape[0]):
        at_hand = i > 0
        for read_here in (True, False):
            if not read_here and i == interval.shape[0]:
                break
            place = row[i] if read_here else i
            if place < 0:
                continue
            inputs = behind(readings if read_here else starts, place * given)
            if not _same(inputs, given, seen):
                at_hand = False
                for g in range(given):
                    seen[g] = now[g] = inputs[g]
                _times(ports, given + n, width, now, r)
                there = behind(lowered, within * m * width)
                if m == 1:
                    p[0], w[0] = solve_near(form, k, there[0], r[0], p[0], behind(anchors, within * ANCHOR))
                    if math.isnan(p[0]):
                        return i
                else:
                    guess(past_within, width, p)
                    if not (
                        nearby(form, m, laws, width, there, r, p, w, work)
                        or _from_anywhere(table, there, width, past_within, r, p, w)
                    ):
                        return i
                    remember(past_within, width, p)
                for l in range(m):  # noqa: E741
                    current[l] = w[l]
            if traced and read_here:
                for g in range(given):
                    now[g] = seen[g]
                _copied(now, noted, behind(rows, place * noted))
                for l in range(m):  # noqa: E741
                    voltages[l * instants + place] = p[l]
            if read_here and at_hand:
                _put(new, n, shown, place, outputs)
            elif read_here:
                for g in range(given):
                    now[g] = seen[g]
                _times(read, noted, read_rows, now, shows)
                _put(shows, 0, shown, place, outputs)
        if i == interval.shape[0]:
            break
        kind = interval[i]
        for g in range(given):
            here[g], seen[g] = starts[i * given + g], ends[i * given + g]
            now[g] = seen[g] - here[g]
        if traced:
            _copied(here, begun, behind(begins, i * (begun + m)))
            for l in range(m):  # noqa: E741
                voltages[l * instants + reading.shape[0] + i] = p[l]
        _times(behind(step, kind * begun * made), begun, made, here, new)
        there = behind(lowered, kind * m * width)
        if m == 1:
            p[0], w[0] = solve_near(form, k, there[0], new[n + shown], p[0], behind(anchors, kind * ANCHOR))
            if math.isnan(p[0]):
                return i
        else:
            for l in range(m):  # noqa: E741
                r[l] = new[n + shown + l]
            guess(past, width, p)
            if not (
                nearby(form, m, laws, width, there, r, p, w, work) or _from_anywhere(table, there, width, past, r, p, w)
            ):
                return i
            remember(past, width, p)
        for b in range(0, high, WIDTH):
            total = load(new, b)
            for l in range(m):  # noqa: E741
                total = plus(total, alike(w[l]), load(at_end, (kind * m + l) * high + b))
            store(new, b, total)
            store(state, b, total)
        for l in range(m):  # noqa: E741
            current[l] = w[l]
        if traced:
            for l in range(m):  # noqa: E741
                begins[i * (begun + m) + begun + l] = w[l]
                voltages[l * instants + reading.shape[0] + interval.shape[0] + i] = p[l]
    for j in range(n):
        x[j] = state[j]
    return -1
