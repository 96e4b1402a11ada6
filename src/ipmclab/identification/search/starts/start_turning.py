"""Slow modes whose poles are complex, found from one output and the node voltage without starting values.

At given poles the reading is linear in everything else, as in ``varpro``, which knows real poles only. Here two real
poles of d(s) stand beside one complex pair of slow modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.search.starts.complex_pairs import best_pairs, is_regular, pair_columns, real_column
from ipmclab.identification.search.varpro import SearchedRun, pole_grid

FloatArray = npt.NDArray[np.float64]

_LEAST, _MOST = 0.02, 0.999  # damping ratios between which a pair is sought
_FOLLOWED: Final = 3  # of the best, to their minimum
_BEYOND: Final = 30.0  # times the fastest pole of the grid, and the slowest over it
_FLAT: Final = 20.0  # of the entry of the damping ratio, where it no longer changes


@dataclass(frozen=True, eq=False)
class TurningFit:
    """Two real poles with their residues, one complex pair (r + lead s)/(1 + 2 zeta tau s + tau^2 s^2) times a level.

    Parameters
    ----------
    poles, residues : float array, shape (2,)
        Fastest first.
    constant, lead : float
        The numerator of the pair, in the unit of the readings per volt, and that times s.
    time_constant, damping_ratio : float
    cost : float
        The weighted sum of squares, as that of a ``PoleFit`` of the same series.
    """

    poles: FloatArray
    residues: FloatArray
    constant: float
    lead: float
    time_constant: float
    damping_ratio: float
    cost: float


def search_turning(series: Sequence[SearchedRun], common: FloatArray) -> TurningFit | None:
    """The best complex pair beside two real poles; None for a clock that is not regular.

    Parameters
    ----------
    series : sequence of SearchedRun
        Runs that share poles and residues.
    common : float array, shape (n_common, n_total)
        Further columns that enter linearly, over all runs side by side.
    """
    from scipy.optimize import least_squares

    if not all(is_regular(run.drive) for run in series):
        return None
    tried = list(islice(best_pairs(series, common, 2), _FOLLOWED))
    weight = np.concatenate([run.weight for run in series])
    readings = np.concatenate([run.readings for run in series]) * weight
    fixed = (common * weight).T

    def left(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What the columns leave of the readings, and their weights."""
        size = np.linalg.norm(columns, axis=0)
        size[size == 0.0] = 1.0
        weights = np.linalg.lstsq(columns / size, readings, rcond=1e-12)[0]
        return readings - columns / size @ weights, weights / size

    grid = pole_grid(series)
    # What lies far outside of what these records can show is not tried: there numbers end.
    fastest, slowest = np.log(-grid[0] * _BEYOND), np.log(-grid[-1] / _BEYOND)

    def inside(theta: FloatArray) -> FloatArray:
        return np.clip(theta, [slowest, slowest, -fastest, -_FLAT], [fastest, fastest, -slowest, _FLAT])

    def columns_at(entries: FloatArray) -> FloatArray:
        theta = inside(entries)
        fast, tau, damping = -np.exp(theta[:2]), float(np.exp(theta[2])), _damping(theta[3])
        own = [real_column(series, float(pole)) * weight for pole in fast]
        return np.column_stack([*own, *(pair_columns(series, tau, damping) * weight), fixed])

    best = None
    for one in tried:
        odds = one.damping_ratio / (1.0 - one.damping_ratio)
        start = np.array([*np.log(-one.poles), np.log(one.time_constant), np.log(odds)])
        found = least_squares(lambda theta: left(columns_at(theta))[0], start, x_scale="jac", max_nfev=40)
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    theta = inside(best.x)
    _, weights = left(columns_at(theta))
    tau = float(np.exp(theta[2]))
    order = np.argsort(-theta[:2])
    return TurningFit(
        poles=-np.exp(theta[:2])[order],
        residues=weights[:2][order],
        constant=float(weights[2]),
        lead=float(weights[3]) * tau,
        time_constant=tau,
        damping_ratio=_damping(theta[3]),
        cost=2.0 * float(best.cost),
    )


def _damping(entry: float) -> float:
    return float(np.clip(1.0 / (1.0 + np.exp(-entry)), _LEAST, _MOST))
