"""Compiled: what intervals do to a system that is driven in straight lines, with the derivatives of that.

Over an interval of length t the state goes on by ``exp(a t)``; a constant input adds ``phi_1(a t) b t``, and one that
rises from 0 to 1 ``phi_2(a t) b t``, with phi_1(z) = (exp z - 1)/z and phi_2(z) = (phi_1(z) - 1)/z. Of an interval that
is short enough the series of phi_2 gives all three, and twice the interval follows from these. No pole is computed, so
that equal ones are as good as any; carried is the exponential less 1, so that what moves slowly keeps its digits.

A matrix has the columns of the state, of inputs that are constant, and of those that rise; its rows are filled up to
whole vectors. Derivatives go through the same products by the rule of the product, sixteen at a time: they are exact.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel, part
from ipmclab.model.numerics.vectors_loop import WIDTH, alike, begin_of, behind, filled, load, on_lines, plus, store

FloatArray = npt.NDArray[np.float64]

_SHORT: Final = 0.25
"""The norm of ``a t`` up to which an interval is short enough: two more doubles cost less than six more terms."""

_SERIES: Final = np.array([*(1.0 / math.factorial(k) for k in range(13, 1, -1)), 1.0])
"""Of phi_2, the last term first, what is left out below 1e-18 of it; then the first term of phi_1."""

_TERMS: Final = len(_SERIES)


def room(states: int, inputs: int, *, moved: bool) -> FloatArray:
    """What the kernels write on."""
    every = states + 2 * inputs
    return on_lines((5 * states * (filled(every) + (every * WIDTH if moved else 0)),))[0]


@part
def _begin(a: FloatArray, drive: FloatArray, scales: FloatArray, duration: float, row: int, given: Any) -> int:
    """Write ``a t`` and ``b t`` of the shortest interval side by side, and say how often it is doubled."""
    n, m, norm = drive.shape[0], drive.shape[1], 0.0
    for j in range(n):
        total = 0.0
        for i in range(n):
            total += abs(a[i, j]) * (scales[j] / scales[i])
        norm = max(norm, total * duration)
    halved = 0  # of what is beyond floating point NaN comes out
    if _SHORT < norm < np.inf:
        halved = math.ceil(math.log2(norm / _SHORT))
    length = duration * 0.5**halved
    for i in range(n):
        for b in range(0, row, WIDTH):
            store(given, i * row + b, alike(0.0))
        for j in range(n):
            given[i * row + j] = length * (scales[j] / scales[i]) * a[i, j]
        for j in range(m):
            given[i * row + n + j] = length / scales[i] * drive[i, j]
    return halved


@part
def _product(left: Any, right: Any, n: int, row: int, kept: float, before: Any, target: Any) -> None:
    """Write ``kept before + left[:, :n] right``."""
    for i in range(n):
        for b in range(0, row, WIDTH):
            total = alike(kept) * load(before, i * row + b)
            for k in range(n):
                total = plus(total, alike(left[i * row + k]), load(right, k * row + b))
            store(target, i * row + b, total)


@part
def _term(k: int, given: Any, n: int, row: int, series: Any, target: Any) -> None:
    """The next term of the series, from the sum of those before."""
    _product(given, series, n, row, 0.0, given, target)
    for i in range(n):
        target[i * row + i] += _SERIES[k]


@part
def _shortest(given: Any, n: int, m: int, row: int, phi_1: Any, phi_2: Any, target: Any) -> None:
    """What the shortest interval does: the exponential less 1, and what inputs add."""
    _product(phi_1, given, n, row, 0.0, given, target)
    for i in range(n):
        for j in range(n, n + m):
            for k in range(n):
                target[i * row + m + j] += phi_2[i * row + k] * given[k * row + j]


@part
def _double(now: Any, n: int, m: int, row: int, target: Any) -> None:
    """What twice an interval does."""
    _product(now, now, n, row, 2.0, now, target)
    for i in range(n):
        for j in range(i * row + n + m, i * row + n + 2 * m):
            target[j] = 0.5 * (target[j] + now[j - m])


@kernel
def transitions(
    a: FloatArray,
    drive: FloatArray,
    inputs: int,
    scales: FloatArray,
    durations: FloatArray,
    written: FloatArray,
    step: FloatArray,
) -> None:
    """The transitions over intervals.

    Parameters
    ----------
    a, drive : float arrays, shapes (n, n), (n, n_inputs + n_laws)
    inputs : int
    scales : float array, shape (n,)
        Powers of two by which the states are divided, so that few doubles are needed (``discretise.balanced``).
    durations : float array, shape (n_kinds,) [s]
    written : float array
        ``room``.
    step : float array, shape (n_kinds, n, 2 n_inputs + n + 2 n_laws)
        Written, as ``discretise.step_and_slopes`` has it.
    """
    n, m, laws = drive.shape[0], drive.shape[1], drive.shape[1] - inputs
    first_law, row = 2 * inputs + n, -(-(n + 2 * m) // WIDTH) * WIDTH
    given = begin_of(written)
    one, two, three = behind(given, n * row), behind(given, 2 * n * row), behind(given, 3 * n * row)
    for kind in range(durations.shape[0]):
        halved = _begin(a, drive, scales, durations[kind], row, given)
        written[n * row :] = 0.0
        for k in range(_TERMS):
            one, two = two, one
            _term(k, given, n, row, two, one)
        _shortest(given, n, m, row, one, two, three)
        now, other = three, one
        for _ in range(halved):
            _double(now, n, m, row, other)
            now, other = other, now
        for i in range(n):
            own = behind(now, i * row)
            for g in range(inputs):
                step[kind, i, g] = scales[i] * own[n + g]
                step[kind, i, inputs + g] = scales[i] * own[n + m + g]
            for j in range(n):
                step[kind, i, 2 * inputs + j] = scales[i] / scales[j] * own[j]
            step[kind, i, 2 * inputs + i] += 1.0
            for l in range(laws):  # noqa: E741
                ramped = scales[i] * own[n + m + inputs + l]
                step[kind, i, first_law + l] = scales[i] * own[n + inputs + l] - ramped
                step[kind, i, first_law + laws + l] = ramped


@kernel
def transitions_of_many(
    a: FloatArray, drive: FloatArray, scales: FloatArray, durations: FloatArray, written: FloatArray, step: FloatArray
) -> None:
    """The transitions of many systems with one input over one interval.

    Parameters
    ----------
    a, drive : float arrays, shapes (n_sets, n, n), (n_sets, n, 1)
    durations : float array, shape (1,) [s]
    step : float array, shape (n_sets, n, 2 + n)
        Written. The others are as in ``transitions``.
    """
    for k in range(a.shape[0]):
        transitions(a[k], drive[k], 1, scales, durations, written, step[k : k + 1])


@part
def _product_moved(
    left: Any, by_left: Any, right: Any, by_right: Any, n: int, columns: int, row: int, every: int, target: Any
) -> None:
    """Write the derivatives of some columns of ``left[:, :n] right``, entry by entry, sixteen numbers each."""
    for i in range(n):
        for j in range(columns):
            total, other = alike(0.0), alike(0.0)
            for k in range(n):
                total = plus(total, alike(left[i * row + k]), load(by_right, (k * every + j) * WIDTH))
                other = plus(other, alike(right[k * row + j]), load(by_left, (i * every + k) * WIDTH))
            store(target, (i * every + j) * WIDTH, total + other)


@part
def _double_moved(now: Any, by_now: Any, n: int, m: int, row: int, target: Any) -> None:
    """The derivatives of ``_double``."""
    every = n + 2 * m
    _product_moved(now, by_now, now, by_now, n, every, row, every, target)
    for i in range(n):
        for j in range(every):
            place = (i * every + j) * WIDTH
            total = plus(load(target, place), alike(2.0), load(by_now, place))
            if j >= n + m:
                total = alike(0.5) * (total + load(by_now, place - m * WIDTH))
            store(target, place, total)


@kernel
def transition_slopes(
    a: FloatArray,
    drive: FloatArray,
    inputs: int,
    by_a: FloatArray,
    by_drive: FloatArray,
    scales: FloatArray,
    durations: FloatArray,
    written: FloatArray,
    by_step: FloatArray,
) -> None:
    """The derivatives of transitions; sixteen after sixteen go through it all, beside the matrices themselves.

    Parameters
    ----------
    by_a, by_drive : float arrays
        The derivatives of ``a`` and ``drive``, with an axis of columns behind, of a multiple of WIDTH.
    by_step : float array
        Written: those of ``step``, likewise. The others are as in ``transitions``.
    """
    n, m, width, laws = drive.shape[0], drive.shape[1], by_a.shape[2], drive.shape[1] - inputs
    every, count, first_law = n + 2 * m, 2 * inputs + n + 2 * laws, 2 * inputs + n
    row, size = -(-every // WIDTH) * WIDTH, n * every * WIDTH
    given = begin_of(written)
    one, two, three = behind(given, n * row), behind(given, 2 * n * row), behind(given, 3 * n * row)
    by_given = behind(given, 5 * n * row)
    by_one, by_two, by_three = behind(by_given, size), behind(by_given, 2 * size), behind(by_given, 3 * size)
    moved_a, moved_drive, made = begin_of(by_a), begin_of(by_drive), begin_of(by_step)
    for kind in range(durations.shape[0]):
        halved = _begin(a, drive, scales, durations[kind], row, given)
        length = durations[kind] * 0.5**halved
        for b in range(0, width, WIDTH):
            for i in range(n):
                for j in range(n):
                    factor = alike(length * (scales[j] / scales[i]))
                    store(by_given, (i * every + j) * WIDTH, factor * load(moved_a, (i * n + j) * width + b))
                for j in range(m):
                    own = load(moved_drive, (i * m + j) * width + b)
                    store(by_given, (i * every + n + j) * WIDTH, alike(length / scales[i]) * own)
            written[n * row : 5 * n * row] = 0.0
            written[5 * n * row + size :] = 0.0
            for k in range(_TERMS):
                one, two, by_one, by_two = two, one, by_two, by_one
                _product_moved(given, by_given, two, by_two, n, n, row, every, by_one)
                _term(k, given, n, row, two, one)
            _shortest(given, n, m, row, one, two, three)
            _product_moved(one, by_one, given, by_given, n, n + m, row, every, by_three)
            constant, by_constant, rising = behind(given, n), behind(by_given, n * WIDTH), (n + m) * WIDTH
            _product_moved(two, by_two, constant, by_constant, n, m, row, every, behind(by_three, rising))
            now, other, by_now, by_other = three, one, by_three, by_one
            for _ in range(halved):
                _double_moved(now, by_now, n, m, row, by_other)
                _double(now, n, m, row, other)
                now, other, by_now, by_other = other, now, by_other, by_now
            for i in range(n):
                own = behind(by_now, i * every * WIDTH)
                target = behind(made, (kind * n + i) * count * width + b)
                factor = alike(scales[i])
                for g in range(inputs):
                    store(target, g * width, factor * load(own, (n + g) * WIDTH))
                    store(target, (inputs + g) * width, factor * load(own, (n + m + g) * WIDTH))
                for j in range(n):
                    there = (2 * inputs + j) * width
                    store(target, there, alike(scales[i] / scales[j]) * load(own, j * WIDTH))
                for l in range(laws):  # noqa: E741
                    ramped = factor * load(own, (n + m + inputs + l) * WIDTH)
                    held = factor * load(own, (n + inputs + l) * WIDTH)
                    store(target, (first_law + l) * width, held - ramped)
                    store(target, (first_law + laws + l) * width, ramped)
