"""The compiled loops over samples of a system with static laws at ports, and of its derivatives."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel
from ipmclab.model.numerics.course import Course
from ipmclab.model.numerics.kernels import multiply
from ipmclab.model.numerics.law_loop import eliminate, law, law_by_coefficients, solve_several

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]


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


class LawTable(NamedTuple):
    """The laws: their forms, shape (n_laws,), and coefficients, shape (n_laws, 3)."""

    forms: IndexArray
    coefficients: FloatArray


class AtLaws(NamedTuple):
    """The voltages p that laws read and the currents w that they give, for inputs that were seen; r is p + drop w."""

    r: FloatArray
    p: FloatArray
    w: FloatArray
    seen: FloatArray


@kernel
def _see(ports: FloatArray, inputs: FloatArray, i: int, x: FloatArray, now: AtLaws) -> None:
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
def _was_seen(inputs: FloatArray, i: int, now: AtLaws) -> bool:
    """Whether p and w already hold for the inputs in row i."""
    same = True
    for g in range(inputs.shape[1]):
        same = same and inputs[i, g] == now.seen[g]
    return same


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
def dense_laws(
    steps: Steps, readings: Readings, table: LawTable, course: Course, x: FloatArray, outputs: FloatArray
) -> int:
    """As ``kernels.dense``, with static laws, which go in a straight line over an interval and jump with the inputs.

    At the end of an interval state and laws hang on each other: with what the laws gave at its begin, the voltages
    that they read are ``p = r - drop w``, ``w = law(p)``, which has one solution. Where an input jumps, the state
    does not, and the same equation holds with what lies between the ports alone.

    Returns
    -------
    failed : int
        -1, or the interval in which no solution was found (only where numbers overflow).
    """
    interval, start, end, row, reading = course
    step, law_end, drop = steps
    read, ports = readings
    forms, coefficients = table
    n, m, given = x.shape[0], forms.shape[0], start.shape[1]
    within = drop[drop.shape[0] - 1]
    now = AtLaws(np.empty(m), np.zeros(m), np.zeros(m), np.full(given, np.nan))
    base, from_here = np.empty(n), np.empty(2 * given + n + m)
    for i in range(row.shape[0]):
        k = row[i]
        if k >= 0:
            if not _was_seen(reading, k, now):
                _see(ports, reading, k, x, now)
                if not solve_several(forms, coefficients, within, now.r, now.p, now.w):
                    return i
            _write(read, reading, k, x, now.w, outputs)
        if i == interval.shape[0]:
            break
        if not _was_seen(start, i, now):
            _see(ports, start, i, x, now)
            if not solve_several(forms, coefficients, within, now.r, now.p, now.w):
                return i
        kind = interval[i]
        _begin(start, end, i, x, now.w, from_here)
        multiply(step, kind, from_here, base)
        _see(ports, end, i, base, now)
        if not solve_several(forms, coefficients, drop[kind], now.r, now.p, now.w):
            return i
        for j in range(n):
            total = base[j]
            for l in range(m):  # noqa: E741
                total += law_end[kind, j, l] * now.w[l]
            x[j] = total
    return -1


@kernel
def _add(target: FloatArray, matrix: FloatArray, columns: FloatArray) -> None:
    """``target += matrix columns``, the innermost loop over the columns."""
    for i in range(target.shape[0]):
        for j in range(columns.shape[0]):
            factor = matrix[i, j]
            if factor != 0.0:
                for t in range(target.shape[1]):
                    target[i, t] += factor * columns[j, t]


@kernel
def _add_moved(target: FloatArray, d_matrix: FloatArray, values: FloatArray) -> None:
    """``target += (derivative of a matrix) values``; parameters are the last axis of the derivative."""
    for i in range(target.shape[0]):
        for j in range(values.shape[0]):
            for t in range(d_matrix.shape[2]):
                target[i, t] += d_matrix[i, j, t] * values[j]


@kernel
def _law_tangents(
    forms: IndexArray,
    coefficients: FloatArray,
    d_coefficients: FloatArray,
    q: FloatArray,
    p: FloatArray,
    d_r: FloatArray,
    d_w: FloatArray,
) -> None:
    """The derivatives of w where ``p + q w = r``, from those of r at this w; ``d_r`` becomes the derivatives of p."""
    m, forced = p.shape[0], d_coefficients.shape[2]
    jacobian, slopes = np.empty((m, m)), np.empty(m)
    own = np.zeros((m, forced))
    for l in range(m):  # noqa: E741
        slopes[l] = law(forms[l], coefficients[l], p[l])[1]
        by = law_by_coefficients(forms[l], coefficients[l], p[l])
        for t in range(forced):
            own[l, t] = (
                by[0] * d_coefficients[l, 0, t] + by[1] * d_coefficients[l, 1, t] + by[2] * d_coefficients[l, 2, t]
            )
    for l in range(m):  # noqa: E741
        for j in range(m):
            jacobian[l, j] = q[l, j] * slopes[j]
            for t in range(forced):
                d_r[l, t] -= q[l, j] * own[j, t]
        jacobian[l, l] += 1.0
    eliminate(jacobian, d_r)
    for l in range(m):  # noqa: E741
        for t in range(d_r.shape[1]):
            d_w[l, t] = slopes[l] * d_r[l, t]
        for t in range(forced):
            d_w[l, t] += own[l, t]


@kernel
def dense_laws_tangents(
    move: Any,
    d_move: Any,
    drop: FloatArray,
    durations: FloatArray,
    interval: IndexArray,
    start: FloatArray,
    end: FloatArray,
    row: IndexArray,
    reading: FloatArray,
    rate: FloatArray,
    reading_rate: FloatArray,
    arrives: FloatArray,
    leaves: FloatArray,
    flow: Any,
    read: Any,
    d_read: Any,
    ports: Any,
    d_ports: Any,
    forms: IndexArray,
    coefficients: FloatArray,
    d_coefficients: FloatArray,
    x: FloatArray,
    tangents: FloatArray,
    outputs: FloatArray,
    d_outputs: FloatArray,
) -> int:
    """As ``dense_laws``, with the derivatives of state, laws and outputs carried along; the last one is by the delay.

    The delay moves the edges of the voltage between the rows: it changes the lengths of intervals, and the voltage
    that a row sees. What is computed is the derivative of the recursion itself, to the last digit.

    Parameters
    ----------
    d_move, d_read, d_ports : tuples of float arrays
        Derivatives of ``move``, of ``read`` and of c, d and loop of the ports; their last axis is the parameters.
    durations : float array, shape (n_kinds,) [s]
    rate, reading_rate, arrives, leaves : float arrays
        Of the ``timeline.Timeline``.
    flow : tuple of float arrays
        ``a``, ``b`` and ``drive`` of the system.
    d_coefficients : float array, shape (n_laws, 3, n_parameters)
    tangents : float array, shape (n, n_tangents)
        Derivatives of the state before the first interval, parameters first, delay last; overwritten.
    d_outputs : float array, shape (n_outputs, n_time, n_tangents)
        Written. The rest is as in ``dense_laws``.
    """
    state, constant, slope, law_begin, law_end = move
    d_state, d_constant, d_slope, d_law_begin, d_law_end = d_move
    a, b, drive = flow
    c, d, reach = read
    d_c, d_d, d_reach = d_read
    c_law, d_law = ports
    d_c_law, d_d_law, d_loop = d_ports
    n, m, every, forced = x.shape[0], forms.shape[0], tangents.shape[1], d_coefficients.shape[2]
    instant, late = drop.shape[0] - 1, tangents.shape[1] - 1
    base, r, p, w, before = np.empty(n), np.empty(m), np.zeros(m), np.zeros(m), np.empty(m)
    moving, d_r, d_w = np.empty((n, every)), np.empty((m, every)), np.zeros((m, every))
    running = np.empty(n)
    seen = np.nan
    for i in range(row.shape[0]):
        k = row[i]
        shift = leaves[i] - arrives[i]
        for look in range(3):
            # 0: the voltage that is read, for an edge that comes before it; 1: the row; 2: the begin of the interval.
            if look < 2:
                if k < 0 or (look == 0 and shift >= 0.0):
                    continue
                u, du = reading[k], reading_rate[k]
            else:
                if i == interval.shape[0]:
                    continue
                u, du = start[i], rate[i] * (1.0 - leaves[i])
            if u != seen:
                for l in range(m):  # noqa: E741
                    total = d_law[l] * u
                    for j in range(n):
                        total += c_law[l, j] * x[j]
                    r[l] = total
                if not solve_several(forms, coefficients, drop[instant], r, p, w):
                    return i
                seen = u
            # Where the row saw the same, its derivatives still hold as the interval begins.
            seen_by_row = look == 2 and k >= 0 and shift <= 0.0 and u == reading[k] and du == reading_rate[k]
            if look > 0 and not seen_by_row:
                d_r[:] = 0.0
                _add(d_r, c_law, tangents)
                _add_moved(d_r, d_c_law, x)
                _add_moved(d_r, d_loop, w)
                for l in range(m):  # noqa: E741
                    for t in range(forced):
                        d_r[l, t] += d_d_law[l, t] * u
                    d_r[l, late] += d_law[l] * du
                _law_tangents(forms, coefficients, d_coefficients, drop[instant], p, d_r, d_w)
            if look == 1:
                for o in range(c.shape[0]):
                    total = d[o] * u
                    for j in range(n):
                        total += c[o, j] * x[j]
                    for l in range(m):  # noqa: E741
                        total += reach[o, l] * w[l]
                    outputs[o, k] = total
                    d_outputs[o, k, :] = 0.0
                    for t in range(forced):
                        d_outputs[o, k, t] = d_d[o, t] * u
                    d_outputs[o, k, late] = d[o] * du
                of_row = d_outputs[:, k, :]
                _add(of_row, c, tangents)
                _add(of_row, reach, d_w)
                _add_moved(of_row, d_c, x)
                _add_moved(of_row, d_reach, w)
            if (look == 0 and shift < 0.0) or (look == 1 and shift > 0.0):
                # The edge moves and the row does not: in between the strip goes on as it does at that moment.
                for j in range(n):
                    total = b[j] * u
                    for l in range(n):  # noqa: E741
                        total += a[j, l] * x[l]
                    for l in range(m):  # noqa: E741
                        total += drive[j, l] * w[l]
                    tangents[j, late] += shift * total
        if i < interval.shape[0]:
            kind = interval[i]
            u, du = start[i], end[i] - start[i]
            stretch = arrives[i + 1] - leaves[i]
            du_begin, du_end = rate[i] * (1.0 - leaves[i]), rate[i] * (1.0 - arrives[i + 1])
            moving[:] = 0.0
            _add(moving, state[kind], tangents)
            _add(moving, law_begin[kind], d_w)
            _add_moved(moving, d_state[kind], x)
            _add_moved(moving, d_law_begin[kind], w)
            for j in range(n):
                total = b[j] * u
                for l in range(n):  # noqa: E741
                    total += a[j, l] * x[l]
                for l in range(m):  # noqa: E741
                    total += drive[j, l] * w[l]
                running[j] = total
            for j in range(n):
                for t in range(forced):
                    moving[j, t] += d_constant[kind, j, t] * u + d_slope[kind, j, t] * du
                total = (constant[kind, j] - slope[kind, j]) * du / durations[kind]
                for l in range(n):  # noqa: E741
                    total += state[kind, j, l] * running[l]
                moving[j, late] += stretch * total + constant[kind, j] * du_begin + slope[kind, j] * (du_end - du_begin)
                total = constant[kind, j] * u + slope[kind, j] * du
                for l in range(n):  # noqa: E741
                    total += state[kind, j, l] * x[l]
                for l in range(m):  # noqa: E741
                    total += law_begin[kind, j, l] * w[l]
                base[j] = total
            for l in range(m):  # noqa: E741
                before[l] = w[l]
                total = d_law[l] * end[i]
                for j in range(n):
                    total += c_law[l, j] * base[j]
                r[l] = total
            if not solve_several(forms, coefficients, drop[kind], r, p, w):
                return i
            seen = end[i]
            for j in range(n):
                total = base[j]
                for l in range(m):  # noqa: E741
                    total += law_end[kind, j, l] * w[l]
                    moving[j, late] += stretch * law_begin[kind, j, l] * (w[l] - before[l]) / durations[kind]
                x[j] = total
            _add_moved(moving, d_law_end[kind], w)
            d_r[:] = 0.0
            _add(d_r, c_law, moving)
            _add_moved(d_r, d_c_law, x)
            _add_moved(d_r, d_loop, w)
            for l in range(m):  # noqa: E741
                for t in range(forced):
                    d_r[l, t] += d_d_law[l, t] * end[i]
                d_r[l, late] += d_law[l] * du_end
            _law_tangents(forms, coefficients, d_coefficients, drop[kind], p, d_r, d_w)
            _add(moving, law_end[kind], d_w)
            tangents[:] = moving
    return -1
