"""Whether two responses to one voltage differ by more than their noise, however its values follow each other.

A strip whose state has changed answers the same voltage with another sum of what answers at once and of what relaxes:
so the difference is the voltage itself, the voltage behind lags of any length, and a constant. The noise is taken as an
autoregression of first order with white noise beside it: where neighbours are alike, a mean of many readings is hardly
better known than one of them. Its two numbers may be any that the restricted likelihood (Patterson and Thompson 1971)
does not exclude, as far as to a walk at random, and those count under which the difference says the least.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.run import FloatArray

_LAGS: Final = 6  # from two rows to half of them all (convention)
_OWN: Final = 1e-3  # of the largest: a direction that is smaller is none (convention)
_MOST: Final = 1000  # readings that are looked at; of more, means of several (a limit of time)
_NOISES: Final = tuple(
    (follows, -part * follows)
    for follows in (0.0, 0.4, 0.7, 0.85, 0.93, 0.97, 0.99, 0.997, 0.9995)
    for part in (0.0, 0.5, 0.8, 0.9, 0.95)
    if follows or not part
)
"""Of an autoregression, and of the moving average that white noise beside it makes of it (convention: so close that
their likelihoods differ little from one to the next). The last ones hardly end."""

_ALLOWED: Final = 5.99  # of minus twice the likelihood: 95 % of chi-square with two degrees of freedom (derived)
_TINY: Final = 1e-150  # of readings without noise: keeps a logarithm finite (a limit)


@dataclass(frozen=True, eq=False)
class Change:
    """What of a difference follows the voltage.

    Parameters
    ----------
    p_value : float
        How often noise alone follows the voltage as much (F test).
    course : float array, shape (n_mean,)
        What follows it: of more than a thousand readings, in means of several.
    """

    p_value: float
    course: FloatArray


def change_of(
    one: FloatArray,
    other: FloatArray,
    voltage: FloatArray,
    read: npt.NDArray[np.bool_],
    *,
    at_rest: Sequence[int],
) -> Change:
    """Ask what of the difference between two responses follows the voltage.

    Parameters
    ----------
    one, other : float array, shape (n_read,)
    voltage : float array, shape (n_time,) [V]
    read : bool array, shape (n_time,)
        At which rows the responses were read.
    at_rest : sequence of int
        How many readings at 0 V were taken off each response that has them: their mean has an error too.
    """
    rows = -(-len(one) // _MOST)
    # Edges that lie a part of a row apart are no change of the strip.
    aside = [np.gradient(0.5 * (one + other)), *([np.ones(len(one))] if at_rest else [])]
    shapes = _means(_shapes(voltage)[read], rows)
    basis, sizes, _ = np.linalg.svd(shapes / np.linalg.norm(shapes, axis=0), full_matrices=False)
    basis = basis[:, sizes > _OWN * sizes[0]]
    columns = np.column_stack([_means(np.column_stack(aside), rows), basis, _means(other - one, rows)])
    return _least_sure(columns, len(aside), [count / rows for count in at_rest])


def _least_sure(columns: FloatArray, aside: int, at_rest: Sequence[float]) -> Change:
    """Of columns aside, shapes and the difference, under the noise of those allowed that leaves it the least sure."""
    from scipy.special import fdtrc

    count, width = len(columns), columns.shape[1]
    of_rest = [sum(_variance_of_mean(*noise, one) for one in at_rest) for noise in _NOISES]
    white = np.zeros((len(_NOISES), count + 1, width))
    for place, noise in enumerate(_NOISES):
        white[place, :count] = _whitened(columns, *noise)
        if at_rest:
            white[place, count, aside - 1] = 1.0 / math.sqrt(of_rest[place])
    triangles: FloatArray = np.asarray(np.linalg.qr(white, mode="r"))
    diagonals = np.maximum(np.abs(np.diagonal(triangles, axis1=1, axis2=2)), _TINY)
    freedom = count - (width - 1) + bool(at_rest)
    logarithms = 2.0 * np.log(diagonals[:, :-1]).sum(axis=1) + [math.log(_variance(*noise)) for noise in _NOISES]
    twice = freedom * 2.0 * np.log(diagonals[:, -1]) + logarithms + (np.log(of_rest) if at_rest else 0.0)
    allowed = twice <= twice.min() + _ALLOWED
    follows = triangles[:, aside : width - 1, -1]
    ratios = np.mean(follows**2, axis=1) / (diagonals[:, -1] ** 2 / freedom)
    place = int(np.argmin(np.where(allowed, ratios, np.inf)))
    weights = np.linalg.solve(triangles[place, aside : width - 1, aside : width - 1], follows[place])
    p_value = float(fdtrc(follows.shape[1], freedom, ratios[place]))
    return Change(p_value, columns[:, aside:-1] @ weights)


def _shapes(voltage: FloatArray) -> FloatArray:
    """The voltage, the voltage behind lags, and a constant, shape (n_time, 2 + n_lag)."""
    from scipy.signal import lfilter

    kept = np.exp(-1.0 / np.geomspace(2.0, max(0.5 * len(voltage), 4.0), _LAGS))
    behind = [lfilter([1.0 - one], [1.0, -one], voltage) for one in kept]
    return np.column_stack([voltage, *behind, np.ones(len(voltage))])


def _means(values: FloatArray, rows: int) -> FloatArray:
    """Means of so many neighbours; those at the end that are fewer are left out."""
    count = len(values) // rows
    return np.asarray(values[: count * rows].reshape(count, rows, *values.shape[1:]).mean(axis=1))


def _whitened(columns: FloatArray, follows: float, moving: float) -> FloatArray:
    """What is new in each row of e[t] = follows e[t-1] + w[t] + moving w[t-1]."""
    from scipy.signal import lfilter

    variance = _variance(follows, moving)
    before = -(follows + moving / variance) * columns[:1]
    later, _ = lfilter([1.0, -follows], [1.0, moving], columns[1:], axis=0, zi=before)
    return np.concatenate([columns[:1] / math.sqrt(variance), later])


def _variance(follows: float, moving: float) -> float:
    return (1.0 + 2.0 * follows * moving + moving**2) / (1.0 - follows**2)


def _variance_of_mean(follows: float, moving: float, count: float) -> float:
    """Variance of the mean of so many readings, for w of variance 1."""
    size = max(count, 1.0)
    next_one = (1.0 + follows * moving) * (follows + moving) / (1.0 - follows**2)
    # The sum over k of (size - k) follows^(k-1), for k below size.
    pairs = (size * (1.0 - follows) - 1.0 + follows**size) / (1.0 - follows) ** 2
    return float((_variance(follows, moving) + 2.0 * next_one * pairs / size) / size)
