"""Static laws of one form at many ports, sixteen side by side, solved from where the last rows point to.

A row of a record asks for p and w = law(p) with ``p + q w = r`` (``law_loop.solve_several``). Where a voltage runs
smoothly, a polynomial through the last four solutions is within 1e-7 of the next one, and one step of Newton's method
from there reaches it to rounding. Its matrix ``1 + q slopes`` needs no pivots: it is that of a symmetric and positive
definite one but for the scales of its rows and columns. Laws that give nothing take no part in it.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.compiled import kernel, part
from ipmclab.model.numerics.law_loop import CUBIC, EXPONENTIAL
from ipmclab.model.numerics.vectors_loop import (
    WIDTH,
    above,
    alike,
    all_below,
    exponential,
    less,
    load,
    plus,
    replaced,
    size,
    stays_apart,
    store,
)

FloatArray = npt.NDArray[np.float64]

_K0, _K1, _K2, _SHARP, _SCALE, _EDGE = range(6)
"""Of a law: its coefficients, 1/k2, within which voltage it bends by about itself, and up to which it gives nothing."""

LAW_ROWS: Final = 6

PAST_ROWS: Final = 4
"""Solutions that are looked back at."""

WORK_ROWS: Final = 3
"""Rows that ``nearby`` needs besides a column for each law."""

_SLOPE, _PLACES, _FIRST = range(3)
"""Of the rows of work: slopes; which laws give something; the matrix, and the right side behind it."""

_TURNS: Final = 4
_FAR: Final = 0.5
"""Part of a law's scale beyond which a step is none that this way is for."""

_NEAR: Final = 3e-7
"""Part of it up to which what a step leaves is its square, and below rounding."""


@kernel
def put_laws(form: int, coefficients: FloatArray, rows: FloatArray) -> None:
    """Write what ``nearby`` needs of laws of one form.

    Parameters
    ----------
    form : int
    coefficients : float array, shape (n_laws, 3)
    rows : float array, shape (LAW_ROWS, a multiple of WIDTH)
        Written; zeros before.
    """
    rows[_SHARP], rows[_SCALE], rows[_EDGE] = 1.0, 1.0, -1.0 if form == CUBIC else 0.0
    for l in range(coefficients.shape[0]):  # noqa: E741
        for c in range(3):
            rows[_K0 + c, l] = coefficients[l, c]
        if form != CUBIC:
            rows[_SHARP, l], rows[_SCALE, l] = 1.0 / coefficients[l, 2], coefficients[l, 2]
            rows[_EDGE, l] = coefficients[l, 1]


@part
def _law(form: int, laws: Any, width: int, b: int, p: Any) -> Any:
    """The currents [A] of sixteen laws at voltages, and their slopes."""
    zero, high = alike(0.0), size(p)
    k0, k1 = load(laws, _K0 * width + b), load(laws, _K1 * width + b)
    if form == CUBIC:
        k2 = load(laws, _K2 * width + b)
        slope = plus(k0, high, plus(k1 + k1, high, alike(3.0) * k2))
        return p * plus(k0, high, plus(k1, high, k2)), slope
    sign = above(p, zero, alike(1.0), alike(-1.0))
    sharp = load(laws, _SHARP * width + b)
    if form == EXPONENTIAL:
        grown = exponential((high - k1) * sharp)
        w, slope = k0 * (grown - alike(1.0)), k0 * (grown * sharp)
    else:
        grown = exponential((high - k1) * (alike(0.5) * sharp))
        shrunk = alike(1.0) / grown
        w, slope = k0 * (grown - shrunk), (alike(0.5) * k0) * (sharp * (grown + shrunk))
    return sign * above(high, k1, w, zero), above(high, k1, slope, zero)


@part
def _solve(work: Any, active: int, width: int) -> None:
    """Solve ``(1 + m) d = right`` by Gauss and Jordan's elimination.

    Of m there are columns of the laws that are active, the right side is behind them and becomes d.
    """
    own = _FIRST * width
    right = own + active * width
    diagonal = 1.0 + work[own + int(work[_PLACES * width])]
    for i in range(active):
        place = int(work[_PLACES * width + i])
        inverse, follows = 1.0 / diagonal, own + width
        if i + 1 < active:  # the next pivot is known before its column
            after = int(work[_PLACES * width + i + 1])
            diagonal = (1.0 + work[follows + after]) - work[follows + place] * (work[own + after] * inverse)
        home = place // WIDTH * WIDTH
        for b in range(0, width, WIDTH):
            if b != home:
                factor = load(work, own + b) * alike(inverse)
                for column in range(follows, right + 1, width):
                    store(work, column + b, less(load(work, column + b), alike(work[column + place]), factor))
        # The row of the pivot is divided by it: what is left of a difference would have no digits where laws are steep.
        lane = place - home
        factor = replaced(load(work, own + home), lane, alike(-1.0)) * alike(inverse)
        for column in range(follows, right + 1, width):
            others = replaced(load(work, column + home), lane, alike(0.0))
            store(work, column + home, less(others, alike(work[column + place]), factor))
        own = follows


@part
def guess(past: Any, width: int, p: Any) -> None:
    """Where the last four solutions point to."""
    for b in range(0, width, WIDTH):
        one, two = load(past, b), load(past, width + b)
        three, four = load(past, 2 * width + b), load(past, 3 * width + b)
        store(p, b, less(plus(alike(0.0) - four, alike(4.0), one + three), alike(6.0), two))


@part
def remember(past: Any, width: int, p: Any) -> None:
    """Put a solution before the last ones."""
    for b in range(0, width, WIDTH):
        for row in range(PAST_ROWS - 1, 0, -1):
            store(past, row * width + b, load(past, (row - 1) * width + b))
        store(past, b, load(p, b))


@kernel
def nearby(form: int, count: int, laws: Any, width: int, q: Any, r: Any, p: Any, w: Any, work: Any) -> bool:
    """Solve ``p + q w = r``, ``w = law(p)`` from a guess that is near; whether it was.

    Parameters
    ----------
    form, count : int
        Of the laws, and how many there are.
    laws : begin of float array, shape (LAW_ROWS, width)
        Of ``put_laws``.
    width : int
        A multiple of WIDTH; what is behind the laws is 0.
    q : begin of float array, shape (count, width) [ohm]
        Its columns.
    r, p, w : begins of float arrays, shape (width,)
        p is the guess; p and w are written.
    work : begin of float array, shape (WORK_ROWS + count, width)
        Written.
    """
    stays_apart()
    zero = alike(0.0)
    for _ in range(_TURNS):
        for b in range(0, width, WIDTH):
            current, slope = _law(form, laws, width, b, load(p, b))
            store(w, b, current)
            store(work, _SLOPE * width + b, slope)
        active = 0
        for i in range(count):
            if work[_SLOPE * width + i] != 0.0:
                work[_PLACES * width + active] = i
                active += 1
        right = (_FIRST + active) * width
        for b in range(0, width, WIDTH):
            missing = load(r, b) - load(p, b)
            for i in range(active):
                place = int(work[_PLACES * width + i])
                column = load(q, place * width + b)
                missing = less(missing, alike(w[place]), column)
                store(work, (_FIRST + i) * width + b, alike(work[_SLOPE * width + place]) * column)
            store(work, right + b, missing)
        if active > 0:
            _solve(work, active, width)
        close, there = True, True
        for b in range(0, width, WIDTH):
            step, old, high = load(work, right + b), load(p, b), size(load(r, b))
            new, far = old + step, size(step)
            edge, scale = load(laws, _EDGE * width + b), load(laws, _SCALE * width + b)
            if form == CUBIC:
                scale = size(old)
            gives = above(size(old), edge, alike(1.0), zero)
            # Below its threshold a law does not bend; over a threshold, and over 0 V, it has a kink.
            scale = above(gives, zero, above(scale, high, high, scale), alike(1e300))
            straight = above(size(gives - above(size(new), edge, alike(1.0), zero)), zero, zero, alike(1.0))
            straight = above(zero, gives * (old * new), zero, straight)
            store(p, b, new)
            # What the straight line gives is the better current where a law is steep.
            store(w, b, plus(load(w, b), load(work, _SLOPE * width + b), step))
            least = plus(alike(1e-300), alike(1e-14), high)
            close = close and all_below(far, plus(least, alike(_FAR), scale))
            there = there and all_below(far, plus(least, alike(_NEAR), scale * straight))
        if there:
            return True
        if not close:
            return False
    return False
