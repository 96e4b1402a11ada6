"""The compiled loop over samples of a system with static laws at ports."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel
from ipmclab.model.numerics.course import Course
from ipmclab.model.numerics.kernels import multiply
from ipmclab.model.numerics.law_loop import solve_several

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
def see(ports: FloatArray, inputs: FloatArray, i: int, x: FloatArray, now: AtLaws) -> None:
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
def was_seen(inputs: FloatArray, i: int, now: AtLaws) -> bool:
    """Whether p and w already hold for the inputs in row i."""
    same = True
    for g in range(inputs.shape[1]):
        same = same and inputs[i, g] == now.seen[g]
    return same


@kernel
def write(read: FloatArray, reading: FloatArray, k: int, x: FloatArray, w: FloatArray, outputs: FloatArray) -> None:
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
def begin(start: FloatArray, end: FloatArray, i: int, x: FloatArray, w: FloatArray, from_here: FloatArray) -> None:
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
            if not was_seen(reading, k, now):
                see(ports, reading, k, x, now)
                if not solve_several(forms, coefficients, within, now.r, now.p, now.w):
                    return i
            write(read, reading, k, x, now.w, outputs)
        if i == interval.shape[0]:
            break
        if not was_seen(start, i, now):
            see(ports, start, i, x, now)
            if not solve_several(forms, coefficients, within, now.r, now.p, now.w):
                return i
        kind = interval[i]
        begin(start, end, i, x, now.w, from_here)
        multiply(step, kind, from_here, base)
        see(ports, end, i, base, now)
        if not solve_several(forms, coefficients, drop[kind], now.r, now.p, now.w):
            return i
        for j in range(n):
            total = base[j]
            for l in range(m):  # noqa: E741
                total += law_end[kind, j, l] * now.w[l]
            x[j] = total
    return -1
