"""Slow modes whose poles are complex, found from one output and the node voltage without starting values.

At given poles the reading is linear in everything else, as in ``varpro``, which knows real poles only. Here two real
poles of d(s) stand beside one complex pair of slow modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.search.varpro import SearchedRun, pole_grid
from ipmclab.model.numerics.drive import Drive

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

_GRID: Final = 8  # poles, all pairs of which are tried
_DAMPING: Final = (0.2, 0.5, 0.85)  # ratios that are tried with each
_LEAST, _MOST = 0.02, 0.999  # damping ratios between which a pair is sought
_FOLLOWED: Final = 3  # of the best, to their minimum
_BEYOND: Final = 30.0  # times the fastest pole of the grid, and the slowest over it
_FLAT: Final = 20.0  # of the entry of the damping ratio, where it no longer changes
_STEADY: Final = 1e-3
"""Relative spread of the rows' distances up to which a clock counts as regular."""


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

    if not all(_is_regular(run.drive) for run in series):
        return None
    weight = np.concatenate([run.weight for run in series])
    readings = np.concatenate([run.readings for run in series]) * weight
    fixed = (common * weight).T
    grid = pole_grid(series, _GRID)
    real = np.array([_column(series, complex(pole)).real for pole in grid]) * weight
    turning = {
        (float(-1.0 / pole), damping): _pair(series, float(-1.0 / pole), damping) * weight
        for pole in grid
        for damping in _DAMPING
    }

    def left(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What the columns leave of the readings, and their weights."""
        size = np.linalg.norm(columns, axis=0)
        size[size == 0.0] = 1.0
        weights = np.linalg.lstsq(columns / size, readings, rcond=1e-12)[0]
        return readings - columns / size @ weights, weights / size

    tried = []
    for first, second in combinations(range(len(grid)), 2):
        for (tau, damping), pair in turning.items():
            columns = np.column_stack([real[first], real[second], *pair, fixed])
            tried.append((float(np.sum(left(columns)[0] ** 2)), (grid[first], grid[second], tau, damping)))
    tried.sort(key=lambda one: one[0])

    # What lies far outside of what these records can show is not tried: there numbers end.
    fastest, slowest = np.log(-grid[0] * _BEYOND), np.log(-grid[-1] / _BEYOND)

    def inside(theta: FloatArray) -> FloatArray:
        return np.clip(theta, [slowest, slowest, -fastest, -_FLAT], [fastest, fastest, -slowest, _FLAT])

    def columns_at(entries: FloatArray) -> FloatArray:
        theta = inside(entries)
        fast, tau, damping = -np.exp(theta[:2]), float(np.exp(theta[2])), _damping(theta[3])
        own = [_column(series, complex(pole)).real * weight for pole in fast]
        return np.column_stack([*own, *(_pair(series, tau, damping) * weight), fixed])

    best = None
    for _, (one, other, tau, damping) in tried[:_FOLLOWED]:
        start = np.array([np.log(-one), np.log(-other), np.log(tau), np.log(damping / (1.0 - damping))])
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


def _is_regular(drive: Drive) -> bool:
    mean = float(np.mean(drive.durations[drive.kind]))
    return bool(np.ptp(drive.durations) <= _STEADY * mean)


def _pair(series: Sequence[SearchedRun], tau: float, damping: float) -> FloatArray:
    """The voltage filtered by 1/(1 + 2 zeta tau s + tau^2 s^2), and tau s times that, shape (2, n_total)."""
    pole = complex(-damping, np.sqrt(1.0 - damping**2)) / tau
    moved = _column(series, pole)
    scale = tau**2 * pole.imag
    return np.array([moved.imag / scale, tau * (pole * moved).imag / scale])


def _column(series: Sequence[SearchedRun], pole: complex) -> ComplexArray:
    """Response of 1/(s - pole) to the drives of all runs, side by side, from rest."""
    return np.concatenate([_response(run.drive, pole) for run in series])


def _response(drive: Drive, pole: complex) -> ComplexArray:
    from scipy.signal import lfilter

    period = float(np.mean(drive.durations[drive.kind]))
    z = pole * period
    first = np.expm1(z) / z if abs(z) > 1e-3 else 1.0 + z / 2.0 + z * z / 6.0
    second = (first - 1.0) / z if abs(z) > 1e-3 else 0.5 + z / 6.0 + z * z / 24.0
    moved = period * ((first - second) * drive.start + second * drive.end)
    state = np.concatenate([[0j], lfilter([1.0], [1.0, -np.exp(z)], moved)])
    return state if drive.rows is None else state[drive.rows]
