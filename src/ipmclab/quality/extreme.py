"""The extreme of a noisy curve, which is not the extreme of its noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from ipmclab.quality.record import GUARD_ROWS, Channel, IntArray
from ipmclab.quality.scatter import Scatter
from ipmclab.run import FloatArray

_FEWEST: Final = 7  # readings: a parabola takes three, and four show whether it fits (convention)
_WIDEST: Final = 2000  # rows on either side of an extreme: a limit
_GROWTH: Final = 1.3  # ratio of one half-width to the next (convention)
_BENT: Final = 12.0
"""Chi-square with two degrees of freedom at which a curve is no parabola: 99.75 % (derived: exp(-6) is left beyond
it)."""
_EQUAL: Final = 1e-6
"""Share by which distances of rows may differ and count as equal (convention)."""

_CANDIDATES: Final = 20  # extremes that are looked at: a limit
_CLIMBS: Final = 5  # steps to a higher top next to it: a limit

_UNSEEN: Final = 1.15
"""What the bend that the test does not see adds to the standard error (by simulation) (measured once by simulation;
no benchmark repeats it)."""

HOW: Final = (
    "Where the channel is noisy this is no single reading but the top of the parabola through the readings around it: "
    "over half the widest stretch in which a polynomial of degree four is not significantly better, so that it bends "
    "with the response and not with its noise. The stretch does not reach across a jump at a voltage edge. The reading "
    "itself is taken where the response bends within seven rows (an inrush) and where the rounding hides the noise. "
    "Of several peaks alike within their errors it is their mean, as far as noise explains their scatter."
)
"""How extremes are read, for the definitions of metrics."""


@dataclass(frozen=True)
class Extreme:
    """Where a curve is highest: the row, the height, and the height's standard error."""

    row: int
    value: float
    error: float


def breaks_of(channel: Channel, values: FloatArray, edges: IntArray) -> IntArray:
    """Rows at which a channel starts again: where its readings jump next to a voltage edge.

    A current jumps with the voltage even where its noise hides it; displacement and force run on.
    """
    breaks: list[int] = []
    for edge in edges:
        first = max(int(edge) - GUARD_ROWS, 1)
        jumps = np.nan_to_num(np.abs(np.diff(values[first - 1 : edge + GUARD_ROWS + 1])))
        if len(jumps) and jumps.max() > 8.0 * channel.noise:
            breaks.append(first + int(jumps.argmax()))
        elif channel.name == "current":
            breaks.append(int(edge))
    return np.unique(np.array(breaks, dtype=np.intp))


def highest(
    channel: Channel,
    scatter: Scatter,
    time: FloatArray,
    values: FloatArray,
    breaks: IntArray,
    before: int | None = None,
) -> Extreme:
    """The maximum of a curve from its noisy readings.

    The highest readings lead to candidates: around each, the parabola of ``HOW`` is fitted, and
    again where its top lies elsewhere. The candidate with the highest top counts.

    Parameters
    ----------
    channel : Channel
    scatter : Scatter
        The noise of its readings.
    time : float array, shape (n_time,) [s]
    values : float array, shape (n_time,)
        Readings, or their negatives for the minimum; NaN where there is none.
    breaks : int array
        Rows that no parabola reaches across from the row before.
    before : int, optional
        The maximum is looked for before this row; the parabola may reach beyond it.

    Returns
    -------
    highest : Extreme
    """
    left = np.where(np.isfinite(values), values, -math.inf)[:before]
    row = int(left.argmax())
    reading = Extreme(row, float(values[row]), scatter.of_one)
    if channel.noise <= 1.001 * channel.quantum / math.sqrt(12.0):
        return reading
    even = _is_even(time) and bool(np.isfinite(values).all())
    best: Extreme | None = None
    found: list[Extreme] = []
    while len(found) < _CANDIDATES:
        row = int(left.argmax())
        if best is not None and left[row] <= best.value:
            break
        top, span = _climb(scatter, time, values, breaks, row, len(left), even=even)
        left[row] = -math.inf
        left[span] = -math.inf
        found.append(top)
        best = max(found, key=lambda extreme: extreme.value - extreme.error)
    return _without_luck(best, found) if best else reading


def _without_luck(best: Extreme, found: list[Extreme]) -> Extreme:
    """The best of several equal peaks owes its height to noise: it is drawn to the mean of those like it."""
    alike = [top.value for top in found if best.value - top.value <= 3.0 * math.hypot(best.error, top.error)]
    mean = sum(alike) / len(alike)
    scatter = sum((value - mean) ** 2 for value in alike) / max(len(alike) - 1, 1)
    real = max(0.0, 1.0 - best.error**2 / scatter) if scatter > 0.0 else 1.0
    return Extreme(best.row, mean + real * (best.value - mean), best.error)


def _climb(
    noise: Scatter, time: FloatArray, values: FloatArray, breaks: IntArray, row: int, before: int, *, even: bool
) -> tuple[Extreme, slice]:
    """The top that a row leads to, and the rows that it represents; ``even`` for equal distances and no gap."""
    found = Extreme(row, float(values[row]), noise.of_one)
    span = slice(row, row + 1)
    for _ in range(_CLIMBS):
        place = int(np.searchsorted(breaks, row, side="right"))
        start = int(breaks[place - 1]) if place else 0
        stop = int(breaks[place]) if place < len(breaks) else len(values)
        wide = _widest(noise, time, values, row, start, stop, even=even)
        if wide is None:
            break
        span = wide
        half = max(1, (wide.stop - 1 - row) // 2, (row - wide.start) // 2)
        low, high = max(start, row - half), min(stop, row + half + 1)
        rows = low + np.flatnonzero(np.isfinite(values[low:high]))
        basis = _basis_of_rows(len(rows), 2) if even else _orthonormal(time[rows], 2)
        fitted = basis @ (basis.T @ values[rows])
        # The ends of a parabola are loose: only its middle half counts, and an end of the whole stretch.
        reach = half // 2
        middle = (rows >= (low if low == start else row - reach)) & (rows < before)
        middle &= rows <= (high if high == stop else row + reach)
        if not middle.any():
            break
        top = int(np.where(middle, fitted, -math.inf).argmax())
        left = math.sqrt(float(np.sum((values[rows] - fitted) ** 2)) / max(len(rows) - 3, 1))
        weights = basis @ basis[top]
        error = _UNSEEN * max(noise.of(weights), left * math.sqrt(float(weights @ weights)))
        found = Extreme(int(rows[top]), float(fitted[top]), error)
        if abs(found.row - row) < max(reach, 1):
            break
        row = found.row
    return found, span


def _widest(
    noise: Scatter, time: FloatArray, values: FloatArray, row: int, start: int, stop: int, *, even: bool
) -> slice | None:
    """The widest stretch around a row in which terms of third and fourth degree do not show; None if there is none."""
    wide: slice | None = None
    half = _FEWEST // 2
    bent = 0
    while half <= _WIDEST and bent < 2:
        low, high = max(start, row - half), min(stop, row + half + 1)
        read = values[low:high]
        if not even:
            there = np.isfinite(read)
            read, when = read[there], time[low:high][there]
        half = math.ceil(_GROWTH * half)
        if len(read) >= _FEWEST:
            bends = _bends_of_rows(len(read)) if even else _orthonormal(when, 4)[:, 3:].T
            bend = bends @ read
            if float(np.sum((bend / _of_bends(noise, len(read))) ** 2)) > _BENT:
                bent += 1
            else:
                bent = 0
                wide = slice(low, high)
        if low == start and high == stop:
            break
    return wide


def _is_even(time: FloatArray) -> bool:
    gaps = time[1:] - time[:-1]
    return bool(len(gaps)) and float(gaps.max() - gaps.min()) <= _EQUAL * float(gaps.mean())


@lru_cache(maxsize=128)
def _basis_of_rows(count: int, degree: int) -> FloatArray:
    """Orthonormal polynomials over rows at equal distances, on which they hang by their number alone."""
    return _gram(count, degree)


@lru_cache(maxsize=256)
def _bends_of_rows(count: int) -> FloatArray:
    """Of these, the third and fourth degree, a row for each."""
    return np.ascontiguousarray(_gram(count, 4)[:, 3:].T)


@lru_cache(maxsize=256)
def _of_bends(noise: Scatter, count: int) -> FloatArray:
    """Standard deviations that noise gives them."""
    return np.array([noise.of(weights) for weights in _bends_of_rows(count)])


def _gram(count: int, degree: int) -> FloatArray:
    """Gram's polynomials up to the fourth degree, a column for each: what ``_orthonormal`` gives, in closed form."""
    x = np.arange(count) - 0.5 * (count - 1)
    square, n2 = x**2, float(count) ** 2
    monic = (
        np.ones(count),
        x,
        square - (n2 - 1.0) / 12.0,
        x * (square - (3.0 * n2 - 7.0) / 20.0),
        square**2 - square * (3.0 * n2 - 13.0) / 14.0 + 3.0 * (n2 - 1.0) * (n2 - 9.0) / 560.0,
    )
    chosen = monic[: min(degree + 1, count)]
    return np.column_stack([one / math.sqrt(float(one @ one)) for one in chosen])


def _orthonormal(time: FloatArray, degree: int) -> FloatArray:
    """Orthonormal polynomials over the given times, a column for each degree."""
    scaled = (time - time.mean()) / max(float(np.ptp(time)), np.finfo(float).tiny)
    basis: FloatArray = np.linalg.qr(np.vander(scaled, min(degree + 1, len(time)), increasing=True))[0]
    return basis
