"""The compiled loop that carries derivatives along with a system that has static laws at ports.

What state and laws go through is known before (``dense_loop.Trace``). Derivatives follow it by a linear recursion,
in which each law is its slope. Every derivative is a column, and sixteen columns are one vector: they are carried side
by side from the first row to the last. Of what an interval does to states and to the voltages of laws, four rows are
worked out at once: what the trace has is then loaded once for them, and no sum waits for another.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel, part
from ipmclab.model.numerics.course import Course
from ipmclab.model.numerics.dense_loop import LawTable, Trace
from ipmclab.model.numerics.law_loop import CUBIC, EXPONENTIAL
from ipmclab.model.numerics.moved_loop import FOUR, Matrices, Moved
from ipmclab.model.numerics.vectors_loop import (
    WIDTH,
    above,
    alike,
    begin_of,
    behind,
    exponential,
    less,
    load,
    on_lines,
    plus,
    replaced,
    size,
    store,
)

FloatArray = npt.NDArray[np.float64]


class Later(NamedTuple):
    """What a later voltage does to a course: ``timeline.Timeline`` has the fields of the same names.

    Parameters
    ----------
    column : int
        That of the derivative by the delay; -1 where there is none.
    durations : float array, shape (n_kinds,) [s]
    rate : float array, shape (n_intervals,) [V/s]
    reading_rate : float array, shape (n_time,) [V/s]
    arrives, leaves : float arrays, shape (n_intervals + 1,)
    flow : float array, shape (n, 1 + n + n_laws)
        What voltage, state and laws add to the rate of the state.
    """

    column: int
    durations: FloatArray
    rate: FloatArray
    reading_rate: FloatArray
    arrives: FloatArray
    leaves: FloatArray
    flow: FloatArray


@kernel
def law_slopes(table: LawTable, voltages: FloatArray, slopes: FloatArray) -> None:
    """The slopes of laws at voltages, and their derivatives by their three coefficients.

    At a threshold they are those above it.

    Parameters
    ----------
    table : LawTable
        All of one form.
    voltages : float array, shape (n_laws, a multiple of WIDTH) [V]
    slopes : float array, shape (4, n_laws, as many)
        Written.
    """
    (forms, coefficients), (laws, count) = table, voltages.shape
    zero = alike(0.0)
    for l in range(laws):  # noqa: E741
        given = behind(begin_of(voltages), l * count)
        found = behind(begin_of(slopes), l * count)
        k0, k1, k2 = alike(coefficients[l, 0]), alike(coefficients[l, 1]), alike(coefficients[l, 2])
        sharp = alike(1.0) / k2
        for i in range(0, count, WIDTH):
            p, form = load(given, i), forms[l]
            high = size(p)
            if form == CUBIC:
                slope = plus(k0, high, plus(k1 + k1, high, alike(3.0) * k2))
                first, second, third = p, p * high, p * (high * high)
            else:
                sign, part_above = above(zero, p, alike(-1.0), alike(1.0)), (high - k1) * sharp
                if form == EXPONENTIAL:
                    grown = exponential(part_above)
                    first, slope = sign * (grown - alike(1.0)), k0 * (sharp * grown)
                else:
                    grown = exponential(alike(0.5) * part_above)
                    shrunk = alike(1.0) / grown
                    first, slope = sign * (grown - shrunk), (alike(0.5) * k0) * (sharp * (grown + shrunk))
                first, slope = above(k1, high, zero, first), above(k1, high, zero, slope)
                second = zero - sign * slope
                third = second * part_above
            store(found, i, slope)
            store(found, laws * count + i, first)
            store(found, 2 * laws * count + i, second)
            store(found, 3 * laws * count + i, third)


@part
def _four_rows(values: Any, count: int, forced: Any, columns: Any, carried: Any, across: int, target: Any) -> None:
    """Four sums of what values force and of columns that are carried."""
    one, two, three, four = alike(0.0), alike(0.0), alike(0.0), alike(0.0)
    for e in range(count):
        value, own = alike(values[e]), behind(forced, e * FOUR * WIDTH)
        one, two = plus(one, value, load(own, 0)), plus(two, value, load(own, WIDTH))
        three, four = plus(three, value, load(own, 2 * WIDTH)), plus(four, value, load(own, 3 * WIDTH))
    for c in range(across):
        column, factors = load(columns, c * WIDTH), behind(carried, c * FOUR)
        one, two = plus(one, alike(factors[0]), column), plus(two, alike(factors[1]), column)
        three, four = plus(three, alike(factors[2]), column), plus(four, alike(factors[3]), column)
    store(target, 0, one)
    store(target, WIDTH, two)
    store(target, 2 * WIDTH, three)
    store(target, 3 * WIDTH, four)


@part
def _row(u: float, values: Any, count: int, by: Any, factors: Any, columns: Any, across: int) -> Any:
    """One sum of what the voltage and other values force, and of columns times factors behind that of the voltage."""
    total = alike(u) * load(by, 0)
    for e in range(count):
        total = plus(total, alike(values[e]), load(by, (1 + e) * WIDTH))
    for c in range(across):
        total = plus(total, alike(factors[1 + c]), load(columns, c * WIDTH))
    return total


@part
def _jump(
    laws: int,
    u: float,
    du: float,
    values: Any,
    count: int,
    by: Any,
    ports: Any,
    unit: Any,
    states: int,
    of_state: Any,
    of_r: Any,
) -> None:
    """Where the voltage jumps: the derivatives of what the laws read but for w."""
    for l in range(laws):  # noqa: E741
        factors = behind(ports, l * (1 + count))
        total = _row(u, values, count, behind(by, l * (1 + count) * WIDTH), factors, of_state, states)
        store(of_r, l * WIDTH, plus(total, alike(factors[0] * du), unit))


@part
def _by_laws(laws: int, drop: Any, slopes: Any, apart: int, by: Any, work: Any, columns: Any) -> None:
    """Of the derivatives of r those of w, where ``p + drop w = r`` and ``w = law(p)``.

    They solve ``(1 + slopes drop) d_w = own + slopes d_r``, whose matrix needs no pivots (``law_rows_loop``).

    Parameters
    ----------
    slopes : begin at an instant of ``law_slopes``
        Laws lie ``apart``.
    by : begin of float array, shape (n_laws, 3, WIDTH)
    columns : begin of float array, shape (n_laws, WIDTH)
        Derivatives of r; on return those of w.
    """
    for l in range(laws):  # noqa: E741
        at, own = behind(slopes, l * apart), behind(by, 3 * l * WIDTH)
        total = alike(at[laws * apart]) * load(own, 0)
        total = plus(total, alike(at[2 * laws * apart]), load(own, WIDTH))
        total = plus(total, alike(at[3 * laws * apart]), load(own, 2 * WIDTH))
        total = plus(total, alike(at[0]), load(columns, l * WIDTH))
        if laws == 1:
            store(columns, 0, total * alike(1.0 / (1.0 + at[0] * drop[0])))
            return
        store(columns, l * WIDTH, total)
        for j in range(laws):
            work[l * laws + j] = at[0] * drop[l * laws + j]
        work[l * laws + l] += 1.0
    for i in range(laws):
        inverse = 1.0 / work[i * laws + i]
        total = load(columns, i * WIDTH) * alike(inverse)
        store(columns, i * WIDTH, total)
        for l in range(i + 1, laws):  # noqa: E741
            work[i * laws + l] *= inverse
        for j in range(laws):
            factor = work[j * laws + i]
            if j != i and factor != 0.0:
                store(columns, j * WIDTH, less(load(columns, j * WIDTH), alike(factor), total))
                for l in range(i + 1, laws):  # noqa: E741
                    work[j * laws + l] -= factor * work[i * laws + l]


@part
def _rate(flow: Any, u: float, values: Any, count: int) -> float:
    """By how much a state changes in a second."""
    total: float = flow[0] * u
    for c in range(count):
        total += flow[1 + c] * values[c]
    return total


@part
def _move(shift: float, u: float, values: Any, count: int, flow: Any, unit: Any, states: int, columns: Any) -> None:
    """The delay moves an edge and not the row: in between the strip goes on as it does at that moment."""
    for j in range(states):
        rate = _rate(behind(flow, j * (1 + count)), u, values, count)
        store(columns, j * WIDTH, plus(load(columns, j * WIDTH), alike(shift * rate), unit))


def room(states: int, laws: int) -> FloatArray:
    """What ``carry_tangents`` writes on."""
    return on_lines(((2 * (states + laws) + FOUR) * WIDTH + laws * laws + states,))[0]


@kernel
def carry_tangents(
    at: Matrices,
    by: Moved,
    course: Course,
    trace: Trace,
    slopes: FloatArray,
    later: Later,
    by_states: int,
    written: FloatArray,
    outputs: FloatArray,
) -> None:
    """The derivatives of the outputs along a trace.

    The voltage is the only input. The delay moves its edges between the rows: it changes the lengths of intervals, and
    the voltage that a row sees. What is computed is the derivative of the recursion itself, to the last digit.

    Parameters
    ----------
    at : Matrices
    by : Moved
        Of ``lay_out``.
    slopes : float array, shape (4, n_laws, ...)
        Of ``law_slopes`` at the voltages of the trace.
    by_states : int
        The first column of derivatives by the initial states; -1 where there are none.
    written : float array
        ``room``.
    outputs : float array, shape (n_outputs, n_time, width)
        Written.
    """
    interval, row = course.interval, course.row
    _, durations, rate, reading_rate, arrives, leaves, flow_rows = later
    n, m, read, width = at.step.shape[1], at.ports.shape[0], at.outputs.shape[0], outputs.shape[2]
    given, noted, apart, count = n + m, 1 + n + m, trace.voltages.shape[1], at.step.shape[2]
    first_begin, fours, within = reading_rate.shape[0], by.carried.shape[1], (by.drop.shape[0] - 1) * m * m
    first_end = first_begin + interval.shape[0]
    step, shown, ports = begin_of(at.step), begin_of(at.outputs), begin_of(at.ports)
    forced, carried, drop = begin_of(by.forced), begin_of(by.carried), begin_of(by.drop)
    steep, flow = begin_of(slopes), begin_of(flow_rows)
    rows, begins, at_ends = begin_of(trace.rows), begin_of(trace.begins), begin_of(course.end)
    of_state = begin_of(written)
    of_laws, ahead = behind(of_state, n * WIDTH), behind(of_state, given * WIDTH)
    work = behind(ahead, fours * FOUR * WIDTH)
    more, of_r = behind(work, m * m), behind(ahead, n * WIDTH)
    for b in range(0, width, WIDTH):
        by_shown, by_ports = behind(begin_of(by.outputs), b * read * noted), behind(begin_of(by.ports), b * m * noted)
        by_laws, made = behind(begin_of(by.coefficients), b * m * 3), behind(begin_of(outputs), b)
        late = later.column - b
        moves = 0 <= late < WIDTH
        unit = replaced(alike(0.0), late, alike(1.0))
        for j in range(n):
            own = by_states + j if by_states >= 0 else -1
            store(of_state, j * WIDTH, replaced(alike(0.0), own - b, alike(1.0)))
        seen, seen_rate, du = np.nan, 0.0, 0.0  # the voltage that the laws' derivatives belong to, and how it moves
        for i in range(row.shape[0]):
            k, shift = row[i], 0.0
            if moves:
                shift = leaves[i] - arrives[i]
            if k >= 0:
                u, here = rows[k * noted], behind(rows, k * noted + 1)
                if moves:
                    du = reading_rate[k]
                if shift < 0.0:
                    _move(shift, u, here, given, flow, unit, n, of_state)
                    seen = np.nan
                if u != seen or du != seen_rate:
                    _jump(m, u, du, here, given, by_ports, ports, unit, n, of_state, of_laws)
                    _by_laws(m, behind(drop, within), behind(steep, k), apart, by_laws, work, of_laws)
                    seen, seen_rate = u, du
                for o in range(read):
                    factors = behind(shown, o * noted)
                    total = _row(u, here, given, behind(by_shown, o * noted * WIDTH), factors, of_state, given)
                    store(made, (o * first_begin + k) * width, plus(total, alike(factors[0] * du), unit))
                if shift > 0.0:
                    _move(shift, u, here, given, flow, unit, n, of_state)
                    seen = np.nan
            if i == interval.shape[0]:
                break
            if moves:
                du = rate[i] * (1.0 - leaves[i])
            if begins[i * count] != seen or du != seen_rate:
                u, here = begins[i * count], behind(begins, i * count + 2)
                _jump(m, u, du, here, given, by_ports, ports, unit, n, of_state, of_laws)
                _by_laws(m, behind(drop, within), behind(steep, first_begin + i), apart, by_laws, work, of_laws)
            kind, begin = interval[i], behind(begins, i * count)
            for four in range(fours):
                own = behind(forced, ((kind * width + b) * fours + four * WIDTH) * count * FOUR)
                factors = behind(carried, (kind * fours + four) * given * FOUR)
                _four_rows(begin, count, own, of_state, factors, given, behind(ahead, four * FOUR * WIDTH))
            if moves:
                before, du = du, rate[i] * (1.0 - arrives[i + 1])
                stretch = (arrives[i + 1] - leaves[i]) / durations[kind]
                for j in range(n):
                    factors = behind(step, (kind * n + j) * count)
                    more[j] = factors[0] * before + factors[1] * (du - before)
                    if stretch != 0.0:
                        more[j] += stretch * (factors[0] - factors[1]) * begin[1]
                        for c in range(n):
                            rises = _rate(behind(flow, c * noted), begin[0], behind(begin, 2), given)
                            more[j] += factors[2 + c] * stretch * durations[kind] * rises
                        for l in range(m):  # noqa: E741
                            more[j] += factors[2 + n + l] * stretch * (begin[2 + given + l] - begin[2 + n + l])
                    store(ahead, j * WIDTH, plus(load(ahead, j * WIDTH), alike(more[j]), unit))
                for l in range(m):  # noqa: E741
                    rises = _rate(behind(ports, l * noted), du, more, n)
                    store(of_r, l * WIDTH, plus(load(of_r, l * WIDTH), alike(rises), unit))
            _by_laws(m, behind(drop, kind * m * m), behind(steep, first_end + i), apart, by_laws, work, of_r)
            for j in range(n):
                total, factors = load(ahead, j * WIDTH), behind(step, (kind * n + j) * count + 2 + given)
                for l in range(m):  # noqa: E741
                    total = plus(total, alike(factors[l]), load(of_r, l * WIDTH))
                store(of_state, j * WIDTH, total)
            for l in range(m):  # noqa: E741
                store(of_laws, l * WIDTH, load(of_r, l * WIDTH))
            seen, seen_rate = at_ends[i], du
