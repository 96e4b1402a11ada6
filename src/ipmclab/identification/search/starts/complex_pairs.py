"""Complex pairs of poles on a grid, which the poles of ``varpro`` are not.

At given poles a reading is linear in everything else. All sets of real poles of a grid with one complex pair of
another are solved at once, from the products of all columns with each other.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations, product
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.identification.search.varpro import SearchedRun, pole_grid
from ipmclab.model.numerics.drive import Drive

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

_GRID: Final = 8  # poles, and as many time constants of the pair
_DAMPING: Final = (0.2, 0.5, 0.85)  # ratios that are tried with each
_MOST: Final = 3  # real poles of which all sets are tried; of more a complex pair is none that shows (a limit)
_STEADY: Final = 1e-3
"""Relative spread of the rows' distances up to which a clock counts as regular."""


class OnGrid(NamedTuple):
    """Real poles and the pair (constant + lead s)/(1 + 2 zeta tau s + tau^2 s^2) at their best."""

    poles: FloatArray
    residues: FloatArray
    time_constant: float
    damping_ratio: float
    constant: float
    lead: float


def best_pairs(series: Sequence[SearchedRun], common: FloatArray, count: int) -> Iterator[OnGrid]:
    """The sets of so many real poles and one complex pair, the best first, none a neighbour of one before.

    Parameters
    ----------
    series : sequence of SearchedRun
        Runs that share poles and residues.
    common : float array, shape (n_common, n_total)
        Further columns that enter linearly, over all runs side by side.
    count : int
        Of the real poles.
    """
    if count > _MOST:
        return
    grid = pole_grid(series, _GRID)
    pairs = list(product(range(_GRID), range(len(_DAMPING))))
    readings = np.concatenate([run.readings for run in series])
    turning = [_pole(-1.0 / float(grid[tau]), _DAMPING[zeta]) for tau, zeta in pairs]
    answers = _answers(series, np.array([*grid, *turning]))
    moved = [row for one, pole in zip(answers[_GRID:], turning, strict=True) for row in _pair_of(one, pole)]
    weight = np.concatenate([run.weight for run in series])
    columns = np.vstack([readings, common, answers[:_GRID].real, *moved]) * weight
    first = len(common)
    sets = np.array(list(combinations(range(_GRID), count)), dtype=np.intp).reshape(math.comb(_GRID, count), count)
    own = np.broadcast_to(np.arange(first), (len(sets), first))
    place = np.concatenate(
        [
            np.hstack([own, first + sets, np.full((len(sets), 1), start), np.full((len(sets), 1), start + 1)])
            for start in first + _GRID + 2 * np.arange(len(pairs))
        ]
    )
    products = columns[1:] @ columns.T
    scale = np.sqrt(np.maximum(products[:, 1:].diagonal(), 1e-300))
    gram, right = products[:, 1:] / (scale[:, None] * scale), products[:, 0] / scale
    # A little of the identity keeps nearly parallel columns from spoiling a set: it is one to start from.
    matrices = gram[place[:, :, None], place[:, None, :]] + 1e-10 * np.eye(place.shape[1])
    weights = np.linalg.solve(matrices, right[place][:, :, None])[:, :, 0]
    order = np.argsort(-np.sum(weights * right[place], axis=1), kind="stable")
    where = np.array([[*chosen, *pair] for pair in pairs for chosen in sets])[order]
    weights = (weights / scale[place])[order]
    left = np.arange(len(order))
    while len(left):
        best = left[0]
        *chosen, tau, zeta = where[best].tolist()
        seconds = -1.0 / float(grid[tau])
        *residues, constant, lead = weights[best, first:].tolist()
        yield OnGrid(grid[chosen], np.array(residues), seconds, _DAMPING[zeta], constant, lead * seconds)
        left = left[(np.abs(where[left] - where[best]) > 1).any(axis=1)]


def real_column(series: Sequence[SearchedRun], pole: float) -> FloatArray:
    """Response of 1/(s - pole) to the drives of all runs, side by side, from rest."""
    return np.asarray(_answers(series, np.array([complex(pole)]))[0].real)


def pair_columns(series: Sequence[SearchedRun], tau: float, damping: float) -> FloatArray:
    """The voltage filtered by 1/(1 + 2 zeta tau s + tau^2 s^2), and tau s times that, shape (2, n_total)."""
    pole = _pole(tau, damping)
    return _pair_of(_answers(series, np.array([pole]))[0], pole)


def is_regular(drive: Drive) -> bool:
    """Whether all rows lie as far from each other."""
    mean = float(np.mean(drive.durations[drive.kind]))
    return bool(np.ptp(drive.durations) <= _STEADY * mean)


def _pole(tau: float, damping: float) -> complex:
    """Of a pair the one with a positive imaginary part."""
    return complex(-damping, np.sqrt(1.0 - damping**2)) / tau


def _pair_of(answer: ComplexArray, pole: complex) -> FloatArray:
    """What the pair of a pole answers, and that with a lead, from what the pole answers."""
    tau = 1.0 / abs(pole)
    scale = tau**2 * pole.imag
    return np.array([answer.imag / scale, tau * (pole * answer).imag / scale])


def _answers(series: Sequence[SearchedRun], poles: ComplexArray) -> ComplexArray:
    """Responses of 1/(s - pole) to the drives of all runs, side by side, from rest, one pole a row."""
    return np.concatenate([_of_drive(run.drive, poles) for run in series], axis=1)


def _of_drive(drive: Drive, poles: ComplexArray) -> ComplexArray:
    from scipy.signal import lfilter

    z = np.outer(poles, drive.durations)
    near = np.abs(z) <= 1e-3
    safe = np.where(near, 1.0, z)
    first = np.where(near, 1.0 + z / 2.0 + z * z / 6.0, np.expm1(safe) / safe)
    second = np.where(near, 0.5 + z / 6.0 + z * z / 24.0, (first - 1.0) / safe)
    start = (drive.durations * (first - second))[:, drive.kind] * drive.start
    moved = start + (drive.durations * second)[:, drive.kind] * drive.end
    decay = np.exp(z)
    state = np.zeros((len(poles), moved.shape[1] + 1), dtype=np.complex128)
    if is_regular(drive):
        for row, one, kept in zip(state, moved, decay, strict=True):
            row[1:] = lfilter([1.0], [1.0, -kept[drive.kind[0]]], one)
    else:
        for step, kind in enumerate(drive.kind):
            state[:, step + 1] = decay[:, kind] * state[:, step] + moved[:, step]
    return state if drive.rows is None else state[:, drive.rows]
