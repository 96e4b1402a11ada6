"""The compiled loops over samples. Everything that does not depend on the sample is done before."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.cascade_loop import cascade as _cascade
from ipmclab.model.numerics.compiled import kernel, part
from ipmclab.model.numerics.course import Course
from ipmclab.model.numerics.modal_loop import BLOCK
from ipmclab.model.numerics.modal_loop import modal_sections as _modal_sections
from ipmclab.model.numerics.modal_loop import stretch as _stretch
from ipmclab.model.numerics.vectors_loop import WIDTH, alike, begin_of, load, store

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

cascade = kernel(_cascade)
stretch = kernel(_stretch)
modal_sections = kernel(_modal_sections)


@kernel
def modal(voltage: FloatArray, coefficients: FloatArray, outputs: FloatArray) -> None:
    """``modal_loop.modal``"""
    z = coefficients[26:] * voltage[0]
    stretch(voltage, coefficients, 0, voltage.shape[0], z, np.empty((6, BLOCK)), outputs)


@kernel
def cascades(
    entries: FloatArray,
    wiring: IndexArray,
    sections: int,
    ports: int,
    nearly_meet: float,
    period: float,
    hold: int,
    room: FloatArray,
    numbers: FloatArray,
    found: npt.NDArray[np.bool_],
) -> None:
    """``cascade`` of many parameter sets: entries, numbers and what is returned have that axis first."""
    for k in range(len(entries)):
        room[:] = 0.0
        found[k] = cascade(entries[k], wiring, sections, ports, nearly_meet, period, hold, room, numbers[k])


@kernel
def multiply(matrices: FloatArray, kind: int, vector: FloatArray, result: FloatArray) -> None:
    """``result = matrices[kind] vector``, each sum in the order of the columns."""
    for i in range(result.shape[0]):
        total = 0.0
        for j in range(vector.shape[0]):
            total += matrices[kind, i, j] * vector[j]
        result[i] = total


@part
def times_columns(columns: Any, first: int, count: int, width: int, of: Any, result: Any) -> None:
    """The sum of columns times numbers, sixteen rows at a time: each to the last digit the one of ``multiply``."""
    for b in range(0, width, WIDTH):
        total = alike(0.0)
        for c in range(count):
            total = total + load(columns, first + c * width + b) * alike(of[c])
        store(result, b, total)


@kernel
def _write(read: FloatArray, reading: FloatArray, k: int, x: FloatArray, outputs: FloatArray) -> None:
    """The outputs of row k."""
    m = reading.shape[1]
    for o in range(outputs.shape[0]):
        total = 0.0
        for l in range(m):  # noqa: E741
            total += read[o, l] * reading[k, l]
        for j in range(x.shape[0]):
            total += read[o, m + j] * x[j]
        outputs[o, k] = total


@kernel
def dense(
    columns: FloatArray, read: FloatArray, course: Course, x: FloatArray, new: FloatArray, outputs: FloatArray
) -> None:
    """The state over intervals of any length, read wherever an interval begins at a row; without laws.

    All sums of a step are made at once, each to the last digit the one of ``multiply``.

    Parameters
    ----------
    columns : float array, shape (n_kinds, 2 n_inputs + n, width)
        What makes the next state over each kind of interval: of the inputs as it begins, of how much they change,
        and of the state (``discretise.Transition``, side by side); each column filled up with zeros.
    read : float array, shape (n_outputs, n_inputs + n)
        What makes the outputs: of the inputs, and of the state.
    course : Course
    x : float array, shape (n,)
        The state before the first interval; on return the state after the last.
    new : float array, shape (width,)
        Written on.
    outputs : float array, shape (n_outputs, n_time)
        Written.
    """
    interval, start, end, row, reading = course
    n, m = x.shape[0], start.shape[1]
    count, width = columns.shape[1:]
    from_here = np.empty(count)
    first, result = begin_of(columns), begin_of(new)
    for i in range(row.shape[0]):
        k = row[i]
        if k >= 0:
            _write(read, reading, k, x, outputs)
        if i < interval.shape[0]:
            for l in range(m):  # noqa: E741
                from_here[l] = start[i, l]
                from_here[m + l] = end[i, l] - start[i, l]
            for j in range(n):
                from_here[2 * m + j] = x[j]
            times_columns(first, interval[i] * count * width, count, width, from_here, result)
            for j in range(n):
                x[j] = new[j]


@kernel
def dense_delay(
    state: FloatArray,
    constant: FloatArray,
    interval: IndexArray,
    rate: FloatArray,
    jump: FloatArray,
    read_before_jump: Any,
    row: IndexArray,
    reading_rate: FloatArray,
    b: FloatArray,
    c: FloatArray,
    d: FloatArray,
    outputs: FloatArray,
) -> None:
    """The derivative by the delay: the response, from rest, to minus the rate of the voltage.

    Parameters
    ----------
    rate : float array, shape (n_intervals,) [V/s]
        Minus the rate of the voltage in each interval.
    jump : float array, shape (n_intervals + 1,) [V]
        Minus the jump of the voltage where interval i begins.
    read_before_jump : bool
        Whether a row is read before a jump at the same time.
    reading_rate : float array, shape (n_time,) [V/s]
        Minus the rate of the voltage that each row sees.
    b : float array, shape (n,)
        How a voltage drives the state.
    outputs : float array, shape (n_outputs, n_time)
        Written. The rest is as in ``dense``.
    """
    n = b.shape[0]
    z = np.zeros(n)
    new = np.empty(n)
    for i in range(row.shape[0]):
        if not read_before_jump:
            for j in range(n):
                z[j] += b[j] * jump[i]
        k = row[i]
        if k >= 0:
            for o in range(c.shape[0]):
                total = d[o] * reading_rate[k]
                for j in range(n):
                    total += c[o, j] * z[j]
                outputs[o, k] = total
        if read_before_jump:
            for j in range(n):
                z[j] += b[j] * jump[i]
        if i < interval.shape[0]:
            m = interval[i]
            for j in range(n):
                total = constant[m, j] * rate[i]
                for l in range(n):  # noqa: E741
                    total += state[m, j, l] * z[l]
                new[j] = total
            for j in range(n):
                z[j] = new[j]
