"""The compiled loop over samples of a system with static laws at ports that carries derivatives along.

Every derivative is a column. The columns that a matrix moves by itself, its derivative by each parameter, stand side by
side for all rows of the matrix: what a state, an input or a law adds to all derivatives is one long row times a number.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel, part
from ipmclab.model.numerics.course import Course
from ipmclab.model.numerics.dense_laws_loop import LawTable
from ipmclab.model.numerics.kernels import multiply
from ipmclab.model.numerics.law_loop import eliminate, law, law_by_coefficients, solve_several

FloatArray = npt.NDArray[np.float64]


class Steps(NamedTuple):
    """What an interval of each kind does.

    Parameters
    ----------
    step : float array, shape (n_kinds, n, 2 n_inputs + n + n_laws)
        What makes the next state, but for what the laws give at the end: of the inputs as the interval begins, of how
        much they change, of the state and of the laws as it begins (``discretise.Transition``, side by side).
    law_end : float array, shape (n_kinds, n, n_laws)
        What the laws at the end add to it.
    drop : float array, shape (n_kinds + 1, n_laws, n_laws) [ohm]
        By how much w at the end of an interval of each kind lowers p there; in the last place within an instant.
    """

    step: FloatArray
    law_end: FloatArray
    drop: FloatArray


class Readings(NamedTuple):
    """What is read of inputs, state and laws.

    Parameters
    ----------
    outputs : float array, shape (n_outputs, n_inputs + n + n_laws)
    ports : float array, shape (n_laws, n_inputs + n)
        The voltages that the laws read, but for what they lower themselves.
    """

    outputs: FloatArray
    ports: FloatArray


class Slopes(NamedTuple):
    """Derivatives of ``Steps``, ``Readings`` and ``LawTable`` in every column, 0 in columns that do not move them.

    Parameters
    ----------
    step : float array, shape (n_kinds, 2 + n + n_laws, n * n_columns)
        What voltage, its change, state and laws as an interval begins add to the next state.
    law_end : float array, shape (n_kinds, n_laws, n * n_columns)
    outputs : float array, shape (1 + n + n_laws, n_outputs * n_columns)
        What voltage, state and laws add to the outputs.
    ports : float array, shape (1 + n + n_laws, n_laws * n_columns)
        What they add to the voltages that the laws read; here with what laws lower themselves within an instant.
    coefficients : float array, shape (n_laws, 3, n_columns)
    """

    step: FloatArray
    law_end: FloatArray
    outputs: FloatArray
    ports: FloatArray
    coefficients: FloatArray


class Later(NamedTuple):
    """What a later voltage does to a course: ``timeline.Timeline`` has the fields of the same names.

    Parameters
    ----------
    durations : float array, shape (n_kinds,) [s]
    rate : float array, shape (n_intervals,) [V/s]
    reading_rate : float array, shape (n_time,) [V/s]
    arrives, leaves : float arrays, shape (n_intervals + 1,)
    flow : float array, shape (n, 1 + n + n_laws)
        What voltage, state and laws add to the rate of the state.
    """

    durations: FloatArray
    rate: FloatArray
    reading_rate: FloatArray
    arrives: FloatArray
    leaves: FloatArray
    flow: FloatArray


@part
def _put(u: float, x: FloatArray, w: FloatArray, here: FloatArray, first: int) -> None:
    """Voltage, state and laws side by side; the voltage alone before ``first``."""
    here[0] = u
    for j in range(x.shape[0]):
        here[first + j] = x[j]
    for l in range(w.shape[0]):  # noqa: E741
        here[first + x.shape[0] + l] = w[l]


@part
def _times(matrix: FloatArray, i: int, vector: FloatArray) -> float:
    """Row i of a matrix times a vector that may be shorter."""
    total = 0.0
    for j in range(vector.shape[0]):
        total += matrix[i, j] * vector[j]
    return total


@part
def _carry(matrix: FloatArray, first: int, columns: FloatArray, target: FloatArray) -> None:
    """``target += matrix[:, first:] columns``, the innermost loop over the derivatives."""
    for i in range(target.shape[0]):
        for j in range(columns.shape[0]):
            factor = matrix[i, first + j]
            if factor != 0.0:
                for t in range(target.shape[1]):
                    target[i, t] += factor * columns[j, t]


@part
def _add(slopes: FloatArray, values: FloatArray, target: FloatArray) -> None:
    """``target += values slopes``: what the matrices' own derivatives give."""
    for j in range(slopes.shape[0]):
        value = values[j]
        if value != 0.0:
            for t in range(target.shape[0]):
                target[t] += value * slopes[j, t]


@part
def _see(ports: FloatArray, u: float, x: FloatArray, r: FloatArray) -> None:
    """What the ports read of the voltage and of the state."""
    for l in range(r.shape[0]):  # noqa: E741
        total = ports[l, 0] * u
        for j in range(x.shape[0]):
            total += ports[l, 1 + j] * x[j]
        r[l] = total


class Scratch(NamedTuple):
    """Room for the derivatives at the laws: shapes (n_laws, n_laws), (n_laws,) and twice (n_laws, n_columns)."""

    jacobian: FloatArray
    slopes: FloatArray
    own: FloatArray
    d_r: FloatArray


@part
def _by_laws(
    table: LawTable, by_coefficients: FloatArray, q: FloatArray, p: FloatArray, room: Scratch, d_w: FloatArray
) -> None:
    """The derivatives of w where ``p + q w = r``, from those of r at this w, which stand in the room."""
    forms, coefficients = table
    jacobian, slopes, own, d_r = room
    m, columns = d_w.shape
    for l in range(m):  # noqa: E741
        slopes[l] = law(forms[l], coefficients[l], p[l])[1]
        first, second, third = law_by_coefficients(forms[l], coefficients[l], p[l])
        for t in range(columns):
            own[l, t] = (
                first * by_coefficients[l, 0, t] + second * by_coefficients[l, 1, t] + third * by_coefficients[l, 2, t]
            )
    for l in range(m):  # noqa: E741
        for j in range(m):
            jacobian[l, j] = q[l, j] * slopes[j]
            for t in range(columns):
                d_r[l, t] -= q[l, j] * own[j, t]
        jacobian[l, l] += 1.0
    eliminate(jacobian, d_r)
    for l in range(m):  # noqa: E741
        for t in range(columns):
            d_w[l, t] = slopes[l] * d_r[l, t] + own[l, t]


@kernel
def dense_laws_tangents(
    steps: Steps,
    readings: Readings,
    table: LawTable,
    by: Slopes,
    course: Course,
    later: Later,
    x: FloatArray,
    tangents: FloatArray,
    outputs: FloatArray,
    d_outputs: FloatArray,
) -> int:
    """As ``dense_laws``, with the derivatives of state, laws and outputs carried along; the last one is by the delay.

    The voltage is the only input. The delay moves its edges between the rows: it changes the lengths of intervals, and
    the voltage that a row sees. What is computed is the derivative of the recursion itself, to the last digit.

    Parameters
    ----------
    tangents : float array, shape (n, n_columns)
        Derivatives of the state before the first interval, the delay last; overwritten.
    d_outputs : float array, shape (n_outputs, n_time, n_columns)
        Written. The rest is as in ``dense_laws``.
    """
    interval, start, end, row, reading = course
    step, law_end, drop = steps
    read, ports = readings
    forms, coefficients = table
    durations, rate, reading_rate, arrives, leaves, flow = later
    n, m, columns = x.shape[0], forms.shape[0], tangents.shape[1]
    late, within = columns - 1, drop[drop.shape[0] - 1]
    r, p, w, before = np.empty(m), np.empty(m), np.zeros(m), np.empty(m)
    here, from_here, base = np.empty(1 + n + m), np.empty(2 + n + m), np.empty(n)
    moves = np.zeros((n + m, columns))
    moves[:n] = tangents
    of_state, of_laws = moves[:n], moves[n:]
    ahead, of_outputs = np.empty((n, columns)), np.empty((read.shape[0], columns))
    room = Scratch(np.empty((m, m)), np.empty(m), np.empty((m, columns)), np.empty((m, columns)))
    d_r = room.d_r
    flat_ahead, flat_outputs, flat_r = ahead.reshape(-1), of_outputs.reshape(-1), d_r.reshape(-1)
    seen = np.nan
    for i in range(row.shape[0]):
        k = row[i]
        shift = leaves[i] - arrives[i]
        for look in range(3):
            # 0: the voltage that is read, for an edge that comes before it; 1: the row; 2: the begin of the interval.
            if look < 2:
                if k < 0 or (look == 0 and shift >= 0.0):
                    continue
                u, du = reading[k, 0], reading_rate[k]
            else:
                if i == interval.shape[0]:
                    continue
                u, du = start[i, 0], rate[i] * (1.0 - leaves[i])
            if u != seen:
                _see(ports, u, x, r)
                if not solve_several(forms, coefficients, within, r, p, w):
                    return i
                seen = u
            _put(u, x, w, here, 1)
            # Where the row saw the same, its derivatives still hold as the interval begins.
            seen_by_row = look == 2 and k >= 0 and shift <= 0.0 and u == reading[k, 0] and du == reading_rate[k]
            if look > 0 and not seen_by_row:
                d_r[:] = 0.0
                _carry(ports, 1, of_state, d_r)
                _add(by.ports, here, flat_r)
                for l in range(m):  # noqa: E741
                    d_r[l, late] += ports[l, 0] * du
                _by_laws(table, by.coefficients, within, p, room, of_laws)
            if look == 1:
                of_outputs[:] = 0.0
                _carry(read, 1, moves, of_outputs)
                _add(by.outputs, here, flat_outputs)
                for o in range(read.shape[0]):
                    outputs[o, k] = _times(read, o, here)
                    for t in range(columns):
                        d_outputs[o, k, t] = of_outputs[o, t]
                    d_outputs[o, k, late] += read[o, 0] * du
            if (look == 0 and shift < 0.0) or (look == 1 and shift > 0.0):
                # The edge moves and the row does not: in between the strip goes on as it does at that moment.
                for j in range(n):
                    of_state[j, late] += shift * _times(flow, j, here)
        if i == interval.shape[0]:
            break
        kind = interval[i]
        u, du = start[i, 0], end[i, 0] - start[i, 0]
        _put(u, x, w, here, 1)
        _put(u, x, w, from_here, 2)
        from_here[1] = du
        ahead[:] = 0.0
        _carry(step[kind], 2, moves, ahead)
        _add(by.step[kind], from_here, flat_ahead)
        multiply(step, kind, from_here, base)
        stretch = arrives[i + 1] - leaves[i]
        du_begin, du_end = rate[i] * (1.0 - leaves[i]), rate[i] * (1.0 - arrives[i + 1])
        for j in range(n):
            ahead[j, late] += step[kind, j, 0] * du_begin + step[kind, j, 1] * (du_end - du_begin)
        if stretch != 0.0:
            for j in range(n):
                ahead[j, late] += stretch * (step[kind, j, 0] - step[kind, j, 1]) * du / durations[kind]
            for l in range(n):  # noqa: E741
                running = stretch * _times(flow, l, here)
                for j in range(n):
                    ahead[j, late] += step[kind, j, 2 + l] * running
        for l in range(m):  # noqa: E741
            before[l] = w[l]
        seen = end[i, 0]
        _see(ports, seen, base, r)
        if not solve_several(forms, coefficients, drop[kind], r, p, w):
            return i
        for j in range(n):
            total = base[j]
            for l in range(m):  # noqa: E741
                total += law_end[kind, j, l] * w[l]
                ahead[j, late] += stretch * step[kind, j, 2 + n + l] * (w[l] - before[l]) / durations[kind]
            x[j] = total
        _add(by.law_end[kind], w, flat_ahead)
        d_r[:] = 0.0
        _carry(ports, 1, ahead, d_r)
        _put(seen, x, w, here, 1)
        _add(by.ports, here, flat_r)
        for l in range(m):  # noqa: E741
            d_r[l, late] += ports[l, 0] * du_end
        _by_laws(table, by.coefficients, drop[kind], p, room, of_laws)
        _carry(law_end[kind], 0, of_laws, ahead)
        of_state[:] = ahead
    tangents[:] = of_state
    return -1
