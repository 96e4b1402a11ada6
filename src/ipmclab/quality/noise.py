"""How noisy a channel is, from its readings alone."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.run import FloatArray

_NORMS: Final = {order: math.sqrt(math.comb(2 * order, order)) for order in (2, 4, 6, 8)}
"""Norm of the coefficients of a difference of that order (derived)."""

STALE_EXCESS: Final = 0.03
"""Repeats beyond those that rounding explains, as a fraction of the rows, that count as stale readings (convention)."""

_FEWEST: Final = 50  # differences from which a noise is read (convention)
_MUCH: Final = 0.3  # part of the differences that are zero: then readings were repeated (convention)


def noise_level(values: npt.ArrayLike) -> float:
    """Standard deviation of the noise on a smooth signal, in the unit of the values.

    It is read from differences of even order: of the lowest order beyond which the estimate
    no longer falls, so that a fast smooth signal does not count as noise. Jumps and spikes
    are left out, rows that repeat a stale reading do not count, and the rounding of the
    converter is included.

    Parameters
    ----------
    values : float array, shape (n_time,)
        Readings of one channel; NaN where there is none.

    Returns
    -------
    noise : float
        0.0 where nothing varies. Of a signal that changes at random at every row, the
        changes count as noise.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(2000) / 50.0
    >>> noise = np.random.default_rng(20261121).normal(0.0, 1e-4, 2000)
    >>> abs(noise_level(0.035 * np.sin(2 * np.pi * 0.1 * time) + noise) / 1e-4 - 1) < 0.05
    True
    """
    readings = np.asarray(values, dtype=np.float64)
    return noise_of_readings(readings[np.isfinite(readings)])


def noise_of_readings(readings: FloatArray) -> float:
    """``noise_level`` of readings that are all finite."""
    if len(readings) < 5:
        return 0.0
    first = readings[1:] - readings[:-1]
    quantum = quantum_of(first)
    if quantum == 0.0:
        return 0.0
    equal = first == 0.0
    if np.count_nonzero(equal) > _MUCH * len(first) and _typical(np.abs(first[~equal])) >= 4.0 * quantum:
        still = _in_runs(equal, longer_than=4)
        if np.count_nonzero(still) > _MUCH * len(first) and np.count_nonzero(~still) >= _FEWEST:
            readings = readings[1:][~still]  # the rest is cut off, stuck or at rest, and says nothing
            first = readings[1:] - readings[:-1]
    if stale_fraction(first, quantum) > STALE_EXCESS:
        return max(_noise_of_fresh(readings, first, quantum), quantum / math.sqrt(12.0))
    differences = first[1:] - first[:-1]
    noise = _spread(differences, quantum) / _NORMS[2]
    for order in (4, 6, 8):
        if len(differences) < 8:
            break
        differences = differences[2:] - 2.0 * differences[1:-1] + differences[:-2]
        finer = _spread(differences, quantum) / _NORMS[order]
        if finer > 0.97 * noise:
            break
        noise = finer
    return max(noise, quantum / math.sqrt(12.0))


def quantum_of(first: FloatArray) -> float:
    """The smallest change from row to row: the step of the converter, where noise does not bury it.

    Changes a trillion times smaller than the largest are the arithmetic of the computer.
    """
    size = np.abs(first)
    size = size[size > 1e-12 * size.max(initial=0.0)]
    return float(size.min()) if len(size) else 0.0


def stale_fraction(first: FloatArray, quantum: float) -> float:
    """Fraction of rows that repeat the reading before, beyond what the rounding of noise explains.

    Of rounded normal noise the counts of equal readings, of one and of two quanta of
    difference are tied: ``n0 = n1 (n1 / n2)**(1/3)`` with the mean of both signs. Long runs of
    one value are no stale repeats and do not count. Where the readings do not turn back and
    forth as noise does, only repeats between two steps of four quanta and more count.

    Parameters
    ----------
    first : float array, shape (n_time - 1,)
        First differences of the readings.
    quantum : float
        The smallest difference between two unequal readings.
    """
    zero = first == 0.0
    repeats = int(np.count_nonzero(zero))
    if repeats <= STALE_EXCESS * len(first) or quantum == 0.0:
        return 0.0
    in_quanta = np.rint(np.abs(first) / quantum)
    changes = first[~zero]
    turns = np.count_nonzero(changes[1:] * changes[:-1] < 0.0)
    if turns < 0.4 * len(changes):
        # A slow signal climbs the steps of the converter one by one: repeats are its nature,
        # but not between two large steps.
        large = in_quanta >= 4.0
        between = large[2:] & large[:-2]
        repeats = int(np.count_nonzero(zero[1:-1] & between))
        expected = float(np.count_nonzero((in_quanta[1:-1] == 1.0) & between)) / 2
    else:
        repeats -= int(np.count_nonzero(_in_runs(zero, longer_than=4)))
        ones = int(np.count_nonzero(in_quanta == 1.0)) / 2
        twos = int(np.count_nonzero(in_quanta == 2.0)) / 2
        expected = ones * (ones / max(twos, 0.5)) ** (1.0 / 3.0)
    return max(0.0, float(repeats - expected) / len(first))


def variance_for_means(residuals: FloatArray, fitted: int) -> float:
    """Variance of residuals, as large as it counts for their mean: neighbours that are alike have less information.

    Parameters
    ----------
    residuals : float array, shape (n,)
    fitted : int
        How many values were fitted to what they are left of.
    """
    power = float(residuals.dot(residuals))
    if power == 0.0:
        return 0.0
    follow = min(max(float(residuals[1:].dot(residuals[:-1])) / power, 0.0), 0.99)
    return power / (len(residuals) - fitted) * (1.0 + follow) / (1.0 - follow)


def runs_of_true(mask: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Starts and stops (half-open) of the stretches where the mask is true."""
    padded = np.zeros(len(mask) + 2, dtype=np.int8)
    padded[1:-1] = mask
    change = padded[1:] - padded[:-1]
    return np.flatnonzero(change == 1), np.flatnonzero(change == -1)


def _in_runs(mask: npt.NDArray[np.bool_], *, longer_than: int) -> npt.NDArray[np.bool_]:
    """The rows of the mask that are true in runs of more than so many rows."""
    starts, stops = runs_of_true(mask)
    long = stops - starts > longer_than
    marks = np.zeros(len(mask) + 1, dtype=np.int8)
    marks[starts[long]] = 1
    marks[stops[long]] = -1
    return np.cumsum(marks[:-1]).astype(bool)


def _noise_of_fresh(readings: FloatArray, first: FloatArray, quantum: float) -> float:
    """Noise about the straight line between the neighbours, over rows that are no repeats."""
    rows = np.flatnonzero(np.concatenate(([True], first != 0.0)))
    if len(rows) < 5:
        return 0.0
    fresh = readings[rows]
    before, after = rows[1:-1] - rows[:-2], rows[2:] - rows[1:-1]
    share = after / (before + after)
    deviations = fresh[1:-1] - share * fresh[:-2] - (1.0 - share) * fresh[2:]
    return _spread(deviations / np.sqrt(1.0 + share**2 + (1.0 - share) ** 2), quantum)


def _spread(differences: FloatArray, quantum: float) -> float:
    """Root mean square of the differences without the outliers that jumps and spikes leave in them."""
    size = np.abs(differences)
    largest = size.max()
    level = _typical(size) / 0.6745  # a first guess that the loop refines
    for _ in range(3):
        limit = 4.0 * level + 2.0 * quantum
        if largest <= limit:
            return math.sqrt(float(differences.dot(differences)) / len(differences))
        kept = differences[size <= limit]
        found = math.sqrt(float(kept.dot(kept)) / len(kept)) if len(kept) else 0.0
        if found >= 0.98 * level:
            return found
        level = found
    return float(level)


def _typical(sizes: FloatArray) -> float:
    """The median of some of the sizes; all of them take too long."""
    some = sizes[:: max(1, len(sizes) // 700)]
    middle = len(some) // 2
    return float(np.partition(some, middle)[middle])
