"""The compiled loop over the modes of a strip with one static law at the node.

What leaks is, for everything behind the electrodes, a lower voltage at their front: ``e = v - series w``. The modes are
those of the strip without a leak, driven by e, which goes in a straight line between rows and jumps with the voltage.
A row is one equation ``p + q law(p) = r`` (two where the voltage jumps), solved from where the last rows point to.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel
from ipmclab.model.numerics.law_loop import CUBIC, EXPONENTIAL
from ipmclab.model.numerics.law_near_loop import expand, follow, reaches

FloatArray = npt.NDArray[np.float64]

BLOCK = 256
"""Rows whose modes are worked out before their outputs, as in ``modal_loop``."""

_X1, _X2, _X3, _X4, _X5, _X6, _BEGIN, _END, _READ, _LEAK, _NODE = range(11)
"""Of a row of a block: the modes; e at the begin and at the end of the period before it, and where it is read; w and p.
They are no arrays with names of their own: a piece of few rows would pay more for these than for its rows."""


@kernel
def short_exponential(x: float) -> float:
    """exp(x) for at most an eighth, by its series to rounding, in an order that leaves little to wait for."""
    square = x * x
    fourth = square * square
    low = (1.0 + x) + square * (0.5 + x * (1.0 / 6.0))
    middle = (1.0 / 24.0 + x * (1.0 / 120.0)) + square * (1.0 / 720.0 + x * (1.0 / 5040.0))
    high = (1.0 / 40320.0 + x * (1.0 / 362880.0)) + square * (1.0 / 3628800.0)
    return low + fourth * (middle + fourth * high)


STATE = 27
"""Numbers that one row leaves to the next."""


@kernel
def at_rest() -> FloatArray:
    """The state of a loop before its first row."""
    state = np.zeros(STATE)
    state[21] = state[23] = -np.inf
    return state


@kernel
def law_stretch(
    voltage: FloatArray,
    begin: int,
    end: int,
    jumps: int,
    circuit: FloatArray,
    mechanical: FloatArray,
    weights: FloatArray,
    form: int,
    k: FloatArray,
    state: FloatArray,
    store: FloatArray,
    expected: float,
    room: float,
    outputs: FloatArray,
    fronts: FloatArray,
) -> tuple[int, float, float]:
    """Some rows of ``law_modal``.

    Parameters
    ----------
    begin, end : int
        The rows, from which, and up to which at most.
    state : float array, shape (STATE,)
        What the row before has left: z1 to z6 (modes; the circuit's without what e now gives to them), the voltage, e
        now, at the begin and at the end of the period, by how much it jumped since, w, p, the last four solutions at
        the end of a period, those behind a jump, where exponentials were computed and what they were, and the
        circuit's modes at that row. Written.
    store : float array, shape (11, BLOCK)
        Written.
    expected : float [A]
        What leaks at the end of each period, as far as is known beforehand.
    room : float [A]
        By how much the sum over the rows may exceed this; the row that exceeds it is the last.

    The other parameters are those of ``law_modal``.

    Returns
    -------
    row : int
        Up to which all is written.
    lost, flowed : float [A]
        Sums of what leaks at the end of each period, without and with its sign.
    """
    a1, begin1, end1 = circuit[0], circuit[1], circuit[2]
    a2, begin2, end2 = circuit[3], circuit[4], circuit[5]
    series, v0 = circuit[6], circuit[7]
    i1, i2, i0 = weights[0, 0], weights[0, 1], weights[0, 6]
    v1, v2 = weights[1, 0], weights[1, 1]
    d1, d2, d3, d4, d5, d6 = weights[2, 0], weights[2, 1], weights[2, 2], weights[2, 3], weights[2, 4], weights[2, 5]
    f1, f2, f3, f4 = weights[3, 0], weights[3, 1], weights[3, 2], weights[3, 3]
    d0, f0 = weights[2, 6], weights[3, 6]
    k0, k1, k2 = k[0], k[1], k[2]
    sharp = 1.0 / k2
    least = 0.0 if form == CUBIC else k1  # up to here nothing leaks
    at_end = v0 + v1 * end1 + v2 * end2  # of the node voltage on e at the end of a period, through the modes as well
    q, q_instant = series * at_end, series * v0
    to_front = 1.0 / at_end
    # The node voltage at the end of a period, before e there is known, from the modes at its begin without e there
    # (z) and from e there: the shortest way from one row to the next.
    ahead1, ahead2 = v1 * a1, v2 * a2
    now1, now2 = begin1 + a1 * end1, begin2 + a2 * end2
    ahead = v1 * now1 + v2 * now2
    m3, m4, m5, m6 = mechanical[0, 0], mechanical[0, 1], mechanical[0, 2], mechanical[0, 3]
    b3, b4, c3, c4 = mechanical[0, 4], mechanical[0, 5], mechanical[0, 6], mechanical[0, 7]
    n3, n4, n5, n6 = mechanical[1, 0], mechanical[1, 1], mechanical[1, 2], mechanical[1, 3]
    b5, b6, c5, c6 = mechanical[1, 4], mechanical[1, 5], mechanical[1, 6], mechanical[1, 7]
    z1, z2, z3, z4, z5, z6, u = state[0], state[1], state[2], state[3], state[4], state[5], state[6]
    e, e_begin, e_end, jump, w, p = state[7], state[8], state[9], state[10], state[11], state[12]
    p1, p2, p3, p4 = state[13], state[14], state[15], state[16]
    j1, j2, j3, j4 = state[17], state[18], state[19], state[20]
    at, there, at_jump, there_jump = state[21], state[22], state[23], state[24]
    grown = lost = flowed = 0.0
    rows, first = 1, begin
    rate = sharp if form == EXPONENTIAL else 0.5 * sharp
    while first < end:
        rows = min(BLOCK, end - first)
        for l in range(rows):  # noqa: E741
            new = voltage[first + l]
            jumping = new != u and (jumps != 0 or first + l == 0)
            running = jumps > 0 or first + l > 0
            guess = 6.0 * p2 - 8.0 * p3 + 3.0 * p4
            sign = 1.0 if guess > 0.0 else -1.0
            guess = sign * guess
            ready = guess > least and running
            if ready:
                if form != CUBIC:
                    part = (guess - at) * rate
                    if abs(part) > 0.125:
                        at, part, there = guess, 0.0, math.exp((guess - k1) * rate)
                    grown = there * short_exponential(part)
                level, inverse, square, cube, w0, w1, w2, w3 = expand(form, k0, k1, k2, sharp, q, guess, grown)
            if jumping:  # the same once more, at the same modes
                other = 6.0 * j2 - 8.0 * j3 + 3.0 * j4
                way = 1.0 if other > 0.0 else -1.0
                other = way * other
                r = (v1 * z1 + v2 * z2) + ((at_end - v0) * e_end + v0 * new)
                near = False
                if other > least:
                    if form != CUBIC:
                        part = (other - at_jump) * rate
                        if abs(part) > 0.125:
                            at_jump, part, there_jump = other, 0.0, math.exp((other - k1) * rate)
                        grown = there_jump * short_exponential(part)
                    high, turn, bend, twist, g0, g1, g2, g3 = expand(form, k0, k1, k2, sharp, q_instant, other, grown)
                    d = (high - way * r) * turn
                    near = reaches(form, k1, k2, other, d, bend, twist)
                    step = d * (1.0 + d * (bend + d * twist))
                if form != CUBIC and abs(r) <= k1:
                    p, w = r, 0.0
                elif near:
                    p, w = way * (other - step), way * (g0 - step * (g1 - step * (g2 - step * g3)))
                else:
                    p, w = follow(form, k0, k1, k2, sharp, q_instant, r, 3.0 * (j1 - j2) + j3)
                j1, j2, j3, j4 = p, j1, j2, j3
                u, e = new, new - series * w
                jump = e - e_end
            if jumps > 0:
                store[_X1, l], store[_X2, l], store[_READ, l], store[_LEAK, l], store[_NODE, l] = z1, z2, e, w, p
                store[_BEGIN, l], store[_END, l] = e_begin, e_end
            if running:
                e_begin = e
                if jumps == 0:
                    u = new
                r = (ahead1 * z1 + ahead2 * z2) + (at_end * u + (v1 * begin1 + v2 * begin2) * jump) + ahead * e_end
                z1 = a1 * z1 + (now1 * e_end + begin1 * jump)
                z2 = a2 * z2 + (now2 * e_end + begin2 * jump)
                near = False
                if ready:
                    d = (level - sign * r) * inverse
                    step = d * (1.0 + d * (square + d * cube))
                    near = reaches(form, k1, k2, guess, d, square, cube)
                if form != CUBIC and abs(r) <= k1:
                    p, w = r, 0.0
                    e = u
                elif near:
                    p, w = sign * (guess - step), sign * (w0 - step * (w1 - step * (w2 - step * w3)))
                    e = u - (r - p) * to_front
                else:
                    p, w = follow(form, k0, k1, k2, sharp, q, r, 3.0 * (p1 - p2) + p3)
                    e = u - series * w
                p1, p2, p3, p4 = p, p1, p2, p3
                e_end, jump = e, 0.0
                lost += abs(w)
                flowed += w
            if jumps <= 0:
                store[_X1, l], store[_X2, l], store[_READ, l], store[_LEAK, l], store[_NODE, l] = z1, z2, e, w, p
                store[_BEGIN, l], store[_END, l] = e_begin, e_end
            if lost - expected * (first + l + 1 - begin) > room:
                rows, end = l + 1, first + l + 1
                break
        if fronts.shape[1] > 0:
            fronts[0, first : first + rows] = store[_BEGIN, :rows]
            fronts[1, first : first + rows] = store[_END, :rows]
            fronts[2, first : first + rows] = store[_READ, :rows]
        for l in range(rows):  # noqa: E741
            store[_X1, l] += end1 * store[_END, l]
            store[_X2, l] += end2 * store[_END, l]
            store[_X3, l] = b3 * store[_BEGIN, l] + c3 * store[_END, l]
            store[_X4, l] = b4 * store[_BEGIN, l] + c4 * store[_END, l]
            store[_X5, l] = b5 * store[_BEGIN, l] + c5 * store[_END, l]
            store[_X6, l] = b6 * store[_BEGIN, l] + c6 * store[_END, l]
        for l in range(rows):  # noqa: E741
            z3, z4 = m3 * z3 + (m4 * z4 + store[_X3, l]), m6 * z4 + (m5 * z3 + store[_X4, l])
            z5, z6 = n3 * z5 + (n4 * z6 + store[_X5, l]), n6 * z6 + (n5 * z5 + store[_X6, l])
            store[_X3, l], store[_X4, l], store[_X5, l], store[_X6, l] = z3, z4, z5, z6
        for l in range(rows):  # noqa: E741
            outputs[0, first + l] = (i1 * store[_X1, l] + i2 * store[_X2, l]) + (i0 * store[_READ, l] + store[_LEAK, l])
        for l in range(rows):  # noqa: E741
            outputs[1, first + l] = store[_NODE, l]
        for l in range(rows):  # noqa: E741
            outputs[2, first + l] = (
                (d1 * store[_X1, l] + d2 * store[_X2, l]) + (d3 * store[_X3, l] + d4 * store[_X4, l])
            ) + ((d5 * store[_X5, l] + d6 * store[_X6, l]) + d0 * store[_READ, l])
        for l in range(rows):  # noqa: E741
            outputs[3, first + l] = (
                (f1 * store[_X1, l] + f2 * store[_X2, l]) + (f3 * store[_X3, l] + f4 * store[_X4, l])
            ) + f0 * store[_READ, l]
        first += rows
    state[0], state[1], state[2], state[3], state[4], state[5], state[6] = z1, z2, z3, z4, z5, z6, u
    state[7], state[8], state[9], state[10], state[11], state[12] = e, e_begin, e_end, jump, w, p
    state[13], state[14], state[15], state[16] = p1, p2, p3, p4
    state[17], state[18], state[19], state[20] = j1, j2, j3, j4
    state[21], state[22], state[23], state[24] = at, there, at_jump, there_jump
    state[25], state[26] = store[_X1, rows - 1], store[_X2, rows - 1]
    return end, lost, flowed


@kernel
def law_modal(
    voltage: FloatArray,
    jumps: int,
    circuit: FloatArray,
    mechanical: FloatArray,
    weights: FloatArray,
    form: int,
    k: FloatArray,
    outputs: FloatArray,
    fronts: FloatArray,
) -> None:
    """Two real modes of the circuit with a law, and two pairs behind them, from rest.

    One row hangs on the one before through a few sums only: the law is expanded about where the row before the last
    and those before it point to, which is known long before, and what is left is a short series.

    Parameters
    ----------
    voltage : float array, shape (n_time,) [V]
    jumps : int
        When the voltage jumps: 1 just before a row is read (hold ``zero``), -1 just after the row before (hold
        ``zero-before``), 0 not at all (hold ``first``).
    circuit : float array, shape (8,)
        Of each mode: a, what e gives to it at the begin and at the end of a period; then the series resistance [ohm]
        and the direct term of the node voltage.
    mechanical : float array, shape (2, 8)
        Of each pair: its matrix over a period (4), what e gives to both at the begin and at the end of a period.
    weights : float array, shape (4, 7)
        Of current, applied voltage, displacement and force: the six modes and the direct term.
    form : int
    k : float array, shape (3,)
    outputs : float array, shape (4, n_time)
        Written: current, applied voltage, displacement, force.
    fronts : float array, shape (3, n_time) or (3, 0)
        Written, unless it is empty: e [V] at the begin and at the end of the period before each row, and where the row
        is read. With these in place of the voltage everything else behind the electrodes is a linear system.
    """
    store = np.empty((11, BLOCK))
    law_stretch(
        *(voltage, 0, voltage.shape[0], jumps, circuit, mechanical, weights, form, k),
        *(at_rest(), store, 0.0, np.inf, outputs, fronts),
    )
