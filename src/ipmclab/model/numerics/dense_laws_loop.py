"""The compiled loop over samples of a system with static laws at ports.

Matrices lie by columns, filled up to whole vectors: a product is a sum of columns, sixteen rows at a time.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel, part
from ipmclab.model.numerics.course import Course
from ipmclab.model.numerics.law_loop import solve_several
from ipmclab.model.numerics.law_rows_loop import PAST_ROWS, WORK_ROWS, guess, nearby, remember
from ipmclab.model.numerics.vectors_loop import WIDTH, alike, begin_of, behind, load, plus, store

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

_carray: Any = numba.carray  # type: ignore[attr-defined]


class LawTable(NamedTuple):
    """The laws: their forms, shape (n_laws,), and coefficients, shape (n_laws, 3)."""

    forms: IndexArray
    coefficients: FloatArray


class Columns(NamedTuple):
    """What a system with laws does, by columns; rows are filled up with zeros to multiples of WIDTH.

    Parameters
    ----------
    step : float array, shape (n_kinds, 2 n_inputs + n + n_laws, n_shown + width)
        What an interval of each kind makes of the inputs as it begins, of how much they change, of the state and of the
        laws as it begins. Its rows are the next state and the outputs there, filled up to n_shown; then the voltages
        that the laws read, filled up to width: all but for what the laws give at the end.
    end : float array, shape (n_kinds, n_laws, n_shown)
        What the laws at the end add to next state and outputs.
    drop : float array, shape (n_kinds + 1, n_laws, width) [ohm]
        By how much w at the end of an interval of each kind lowers p there; in the last place within an instant.
    outputs : float array, shape (n_inputs + n + n_laws, outputs filled up)
        What is read within an instant of inputs, state and laws.
    ports : float array, shape (n_inputs + n, width)
        The voltages that the laws read within an instant, but for what they lower themselves.
    laws : float array, shape (LAW_ROWS, width)
        Of ``law_rows``.
    """

    step: FloatArray
    end: FloatArray
    drop: FloatArray
    outputs: FloatArray
    ports: FloatArray
    laws: FloatArray


_AT_LAWS: Final = 3 + 2 * PAST_ROWS + WORK_ROWS


def room(columns: Columns, inputs: int) -> FloatArray:
    """What ``dense_laws`` writes on, with zeros in it.

    Parameters
    ----------
    columns : Columns
    inputs : int
    """
    _, laws, width = columns.drop.shape
    _, begun, made = columns.step.shape
    return np.zeros(inputs + begun + 2 * made + columns.outputs.shape[1] + (_AT_LAWS + laws) * width)


@part
def _times(columns: Any, count: int, rows: int, of: Any, result: Any) -> None:
    """The sum of columns times numbers."""
    for b in range(0, rows, WIDTH):
        total = alike(0.0)
        for c in range(count):
            total = plus(total, alike(of[c]), load(columns, c * rows + b))
        store(result, b, total)


@kernel
def _from_anywhere(table: LawTable, drop: FloatArray, past: Any, r: Any, p: Any, w: Any) -> bool:
    """Solve what ``nearby`` did not, from the last solution."""
    count = table.forms.shape[0]
    for l in range(count):  # noqa: E741
        p[l] = past[l]
    return solve_several(
        table.forms, table.coefficients, drop, _carray(r, (count,)), _carray(p, (count,)), _carray(w, (count,))
    )


@part
def _same(inputs: FloatArray, i: int, seen: Any) -> bool:
    same = True
    for g in range(inputs.shape[1]):
        same = same and inputs[i, g] == seen[g]
    return same


@kernel
def dense_laws(
    columns: Columns,
    table: LawTable,
    drop: FloatArray,
    course: Course,
    x: FloatArray,
    outputs: FloatArray,
    written: FloatArray,
) -> int:
    """As ``kernels.dense``, with static laws, which go in a straight line over an interval and jump with the inputs.

    At the end of an interval state and laws hang on each other: with what the laws gave at its begin, the voltages
    that they read are ``p = r - drop w``, ``w = law(p)``, which has one solution. Where an input jumps, the state
    does not, and the same equation holds with what lies between the ports alone.

    Parameters
    ----------
    columns : Columns
    table : LawTable
        All of one form.
    drop : float array, shape (n_kinds + 1, n_laws, n_laws) [ohm]
        As in ``columns``.
    written : float array
        ``room``.

    The other parameters are those of ``kernels.dense``.

    Returns
    -------
    failed : int
        -1, or the interval in which no solution was found (only where numbers overflow).
    """
    interval, start, end, row, reading = course
    n, m, given, shown = x.shape[0], table.forms.shape[0], start.shape[1], outputs.shape[0]
    form, width, within = table.forms[0], columns.drop.shape[2], columns.drop.shape[0] - 1
    begun, made, high = columns.step.shape[1], columns.step.shape[2], columns.end.shape[2]
    step, at_end, lowered = begin_of(columns.step), begin_of(columns.end), begin_of(columns.drop)
    read, ports, laws = begin_of(columns.outputs), begin_of(columns.ports), begin_of(columns.laws)
    seen = begin_of(written)
    here = behind(seen, given)  # inputs as an interval begins, their change, state, laws
    new = behind(here, begun + made)  # state and outputs at its end, and what the laws read there
    shows = behind(new, made)
    p = behind(shows, columns.outputs.shape[1])
    w, r, past = behind(p, width), behind(p, 2 * width), behind(p, 3 * width)
    past_within, work = behind(past, PAST_ROWS * width), behind(past, 2 * PAST_ROWS * width)
    now = behind(here, given)  # inputs within an instant, state, laws
    state, current = behind(now, given), behind(now, given + n)
    for j in range(n):
        state[j] = x[j]
    for g in range(given):
        seen[g] = np.nan
    for i in range(row.shape[0]):
        at_hand = i > 0
        for read_here in (True, False):
            if not read_here and i == interval.shape[0]:
                break
            k = row[i] if read_here else i
            if k < 0:
                continue
            inputs = reading if read_here else start
            if not _same(inputs, k, seen):
                at_hand = False
                for g in range(given):
                    seen[g] = now[g] = inputs[k, g]
                _times(ports, given + n, width, now, r)
                guess(past_within, width, p)
                if not (
                    nearby(form, m, laws, width, behind(lowered, within * m * width), r, p, w, work)
                    or _from_anywhere(table, drop[within], past_within, r, p, w)
                ):
                    return i
                remember(past_within, width, p)
                for b in range(0, width, WIDTH):
                    store(current, b, load(w, b))
            if read_here and at_hand:
                for o in range(shown):
                    outputs[o, k] = new[n + o]
            elif read_here:
                for g in range(given):
                    now[g] = seen[g]
                _times(read, given + n + m, columns.outputs.shape[1], now, shows)
                for o in range(shown):
                    outputs[o, k] = shows[o]
        if i == interval.shape[0]:
            break
        kind = interval[i]
        for g in range(given):
            here[g], now[g] = start[i, g], end[i, g] - start[i, g]
            seen[g] = end[i, g]
        _times(behind(step, kind * begun * made), begun, made, here, new)
        for b in range(0, width, WIDTH):
            store(r, b, load(new, high + b))
        guess(past, width, p)
        if not (
            nearby(form, m, laws, width, behind(lowered, kind * m * width), r, p, w, work)
            or _from_anywhere(table, drop[kind], past, r, p, w)
        ):
            return i
        remember(past, width, p)
        for b in range(0, high, WIDTH):
            total = load(new, b)
            for l in range(m):  # noqa: E741
                total = plus(total, alike(w[l]), load(at_end, (kind * m + l) * high + b))
            store(new, b, total)
            store(state, b, total)
        for b in range(0, width, WIDTH):
            store(current, b, load(w, b))
    for j in range(n):
        x[j] = state[j]
    return -1
