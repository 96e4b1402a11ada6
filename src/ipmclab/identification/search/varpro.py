"""Variable projection: the poles of a response, found from the data alone.

Y(s) = D + sum_j r_j/(s - lambda_j) is linear in D and r for given poles. Only the poles are
searched, on a logarithmic scale: first over the sets of a grid, then by damped Gauss-Newton
steps. No starting values are needed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations, islice
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.drive import Drive, responses
from ipmclab.model.numerics.poles_loop import pole_values
from ipmclab.normal_equations import damped_step, pseudo_inverse
from ipmclab.progress import tick

FloatArray = npt.NDArray[np.float64]

GRID_POLES: Final = 10  # from the fastest to the slowest that a record can show, at least
_GRID_STARTS: Final = 4  # no two of them neighbours
_MOST_SETS: Final = 10_000  # of grid poles that are all tried: up to six poles
_EXCHANGES: Final = 10  # of each of the poles, where these are more
_LONGEST_STEP: Final = 1.5  # of a logarithm in one iteration
_SETTLED: Final = 1e-10  # relative decrease of the cost at which a descent ends
_UNSEEN: Final = 1e-4  # of the rounding of a cost: a decrease that could not be told from it
_IMITATED: Final = 1e-12  # of its square: what is left of the move of a pole that the linear part follows to rounding
_EQUAL: Final = 0.05  # of a logarithm: poles nearer than that have met


@dataclass(frozen=True, eq=False)
class SearchedRun:
    """One run as the search sees it.

    Parameters
    ----------
    drive : Drive
    time : float array, shape (n_time,) [s]
        Since the start of the drive.
    readings : float array, shape (n_time,)
        Zero where ``weight`` is.
    weight : float array, shape (n_time,)
        One over the noise; zero for a reading to be left out.
    free_start : bool
        Whether the state at the start is unknown.
    step : float [s], optional
        Between two rows, where readings are means of several.
    """

    drive: Drive
    time: FloatArray
    readings: FloatArray
    weight: FloatArray
    free_start: bool = False
    step: float | None = None


@dataclass(frozen=True, eq=False)
class PoleFit:
    """What the search found.

    ``common`` holds the weights of the common columns, ``cost`` is the weighted sum of squares.
    """

    poles: FloatArray
    residues: FloatArray
    common: FloatArray
    cost: float


class _Table:
    """Everything that enters linearly at given poles, weighted, one row each, all runs side by side.

    Rows: the readings, the common columns, then for each pole its response and the decays of the free starts,
    and last, in the same order, the derivatives of those by the pole.
    """

    def __init__(self, series: Sequence[SearchedRun], count: int, common: FloatArray) -> None:
        self._series = series
        self.width = 1 + sum(run.free_start for run in series)
        self.common = len(common)
        self._weight = np.concatenate([run.weight for run in series])
        self._fixed = 1 + self.common
        self.rows = np.zeros((self._fixed + 2 * count * self.width, len(self._weight)))
        self.rows[0] = np.concatenate([run.readings for run in series]) * self._weight
        self.rows[1 : self._fixed] = common * self._weight
        self._products = np.empty((len(self.rows), len(self.rows)))
        self._products[: self._fixed, : self._fixed] = self.rows[: self._fixed] @ self.rows[: self._fixed].T

    def gram(self, poles: FloatArray) -> FloatArray:
        """Products of all rows with each other."""
        tick()
        span = len(poles) * self.width
        moving = self.rows[self._fixed :]
        values = moving[:span].reshape(len(poles), self.width, -1)
        slopes = moving[span:].reshape(len(poles), self.width, -1)
        place, begin = 1, 0
        for run in self._series:
            end = begin + len(run.time)
            values[:, 0, begin:end], slopes[:, 0, begin:end] = responses(run.drive, poles)
            if run.free_start:
                decay = np.exp(np.outer(poles, run.time))
                # Other runs' readings do not know this start.
                values[:, place], slopes[:, place] = 0.0, 0.0
                values[:, place, begin:end], slopes[:, place, begin:end] = decay, decay * run.time
                place += 1
            begin = end
        moving *= self._weight
        products = self._products.copy()
        products[self._fixed :] = moving @ self.rows.T
        products[: self._fixed, self._fixed :] = products[self._fixed :, : self._fixed].T
        return products


def pole_grid(series: Sequence[SearchedRun], count: int = GRID_POLES) -> FloatArray:
    """Poles from a third of the slowest to the fastest that these records can show, fastest first [1/s]."""
    longest = max(float(run.time[-1] - run.time[0]) for run in series)
    shortest = min(run.step or float(run.drive.durations.max()) for run in series)
    grid: FloatArray = -np.exp(np.linspace(math.log(2.0 / shortest), math.log(0.3 / longest), count))
    return grid


def search_poles(series: Sequence[SearchedRun], count: int, common: FloatArray, *, tries: int = 3) -> PoleFit:
    """Find real poles without starting values.

    Parameters
    ----------
    series : sequence of SearchedRun
        Runs that share the poles and residues.
    count : int
        Number of poles.
    common : float array, shape (n_common, n_total)
        Further columns that enter linearly, over all runs side by side: a direct term, offsets.
    tries : int
        How many of the best grid points are followed to their minimum, where the first ends in equal poles.

    Returns
    -------
    fit : PoleFit
        Poles fastest first.
    """
    found: list[PoleFit] = []
    table = _Table(series, count, common)
    for start in islice(_grid_starts(series, count, common), tries):
        found.append(_descend(table, series, start))
        if not (np.diff(np.log(-found[-1].poles)) > -_EQUAL).any():
            break
    return min(found, key=lambda fit: fit.cost)


def all_minima(series: Sequence[SearchedRun], count: int, common: FloatArray) -> list[PoleFit]:
    """Every different minimum that the best grid points lead to, the lowest first; arguments as ``search_poles``."""
    table = _Table(series, count, common)
    kept: list[PoleFit] = []
    for fit in sorted(
        (_descend(table, series, start) for start in _grid_starts(series, count, common)), key=lambda fit: fit.cost
    ):
        if all(np.max(np.abs(np.log(fit.poles / other.poles))) > _EQUAL for other in kept):
            kept.append(fit)
    return kept


@cache
def _choices(grid: int, count: int) -> npt.NDArray[np.intp]:
    """Every set of so many places in a grid, one a row."""
    choices = np.array(list(combinations(range(grid), count)), dtype=np.intp)
    choices.setflags(write=False)
    return choices


Gains = Callable[[npt.NDArray[np.intp]], FloatArray]
"""How much of the power of the readings each of some sets of places in a grid explains, one a row."""


def _exchanged(grid: int, count: int, gains: Gains) -> npt.NDArray[np.intp]:
    """Sets of so many places by exchange, where there are too many to try each (Miller, Subset Selection, 2002, 3.5).

    The place that explains most is added until there are enough; then each is exchanged for the one that explains most
    in its stead, until none is. All sets on the way are returned.
    """
    every = np.arange(grid)
    own: list[int] = []
    tried: list[list[int]] = []

    def best_beside(others: list[int]) -> tuple[int, float]:
        free = np.setdiff1d(every, others)
        sets = np.column_stack([np.tile(np.array(others, dtype=np.intp), (len(free), 1)), free])
        found = gains(sets)
        if len(others) == count - 1:
            tried.extend(np.sort(sets, axis=1).tolist())
        return int(free[np.argmax(found)]), float(found.max())

    while len(own) < count:
        own.append(best_beside(own)[0])
    best = -math.inf
    for _ in range(_EXCHANGES):
        before = best
        for _ in range(count):
            # The first goes and comes back as the last, so that after a round each had its turn.
            place, best = best_beside(own[1:])
            own = [*own[1:], place]
        if not best > before:
            break
    return np.unique(np.array(tried, dtype=np.intp), axis=0)


def _grid_starts(series: Sequence[SearchedRun], count: int, common: FloatArray) -> Iterator[FloatArray]:
    """A few sets of grid poles, the best first, no two of them neighbours in every pole."""
    grid = pole_grid(series, max(GRID_POLES, 2 * count + 4))
    first, width = len(common), 1 + sum(run.free_start for run in series)
    rows = np.zeros((1 + first + len(grid) * width, sum(len(run.time) for run in series)))
    rows[0] = np.concatenate([run.readings for run in series])
    rows[1 : 1 + first] = common
    blocks = rows[1 + first :].reshape(len(grid), width, -1)
    place, begin = 1, 0
    for run in series:
        end = begin + len(run.time)
        state = np.empty((len(grid), len(run.drive.kind) + 1))
        pole_values(run.drive.durations, run.drive.kind, run.drive.start, run.drive.end, grid, state)
        blocks[:, 0, begin:end] = state if run.drive.rows is None else state[:, run.drive.rows]
        if run.free_start:
            blocks[:, place, begin:end] = np.exp(np.outer(grid, run.time))
            place += 1
        begin = end
    rows *= np.concatenate([run.weight for run in series])
    products = rows[1:] @ rows.T
    scale = np.sqrt(np.maximum(products[:, 1:].diagonal(), 1e-300))
    gram, right = products[:, 1:] / (scale[:, None] * scale), products[:, 0] / scale

    def gains(choices: npt.NDArray[np.intp]) -> FloatArray:
        index = np.empty((len(choices), first + choices.shape[1] * width), dtype=np.intp)
        index[:, :first] = np.arange(first)
        index[:, first:] = (first + width * choices[:, :, None] + np.arange(width)).reshape(len(choices), -1)
        # A little of the identity keeps nearly parallel columns from spoiling a choice; the descent is exact.
        matrices = gram[index[:, :, None], index[:, None, :]] + 1e-10 * np.eye(index.shape[1])
        vectors = right[index]
        return np.asarray((vectors * np.linalg.solve(matrices, vectors[:, :, None])[:, :, 0]).sum(axis=1))

    few = math.comb(len(grid), count) <= _MOST_SETS
    choices = _choices(len(grid), count) if few else _exchanged(len(grid), count, gains)
    left = choices[np.argsort(-gains(choices))]
    for _ in range(_GRID_STARTS):
        if not len(left):
            break
        yield grid[left[0]]
        left = left[(np.abs(left - left[0]) > 1).any(axis=1)]


def _descend(table: _Table, series: Sequence[SearchedRun], poles: FloatArray) -> PoleFit:
    """Damped Gauss-Newton steps in log(-pole), the linear part solved exactly at each."""
    count, first, width = len(poles), table.common, table.width
    span = count * width
    linear_rows, slope_rows = slice(1, 1 + first + span), slice(1 + first + span, 1 + first + 2 * span)
    fastest = 1000.0 / min(float(run.drive.durations.min()) for run in series)
    slowest = 1e-3 / max(float(run.time[-1] - run.time[0]) for run in series)
    lower, upper = math.log(slowest), math.log(fastest)
    pole, place = np.arange(count)[:, None], np.arange(span).reshape(count, width)

    def measure(position: FloatArray) -> tuple[float, FloatArray, FloatArray, FloatArray, FloatArray]:
        found = -np.exp(position)
        products = table.gram(found)
        gram, right = products[linear_rows, linear_rows], products[linear_rows, 0]
        # Poles that have met share a column, and a response that no reading sees is a column of zeros.
        inverse = pseudo_inverse(gram)
        linear = inverse @ right
        # The readings are many times what is left: products with these would lose as many digits of the slope, and
        # where poles meet, on which side they part again hangs on it.
        linear += inverse @ (table.rows[linear_rows] @ (table.rows[0] - linear @ table.rows[linear_rows]))
        left = table.rows[0] - linear @ table.rows[linear_rows]
        # How the model moves with the logarithm of each pole: a mix of the slope rows.
        chosen = np.zeros((span, count))
        chosen[place, pole] = linear[first:].reshape(count, width) * found[:, None]
        mixed = products[linear_rows, slope_rows] @ chosen
        moved = chosen.T @ products[slope_rows, slope_rows] @ chosen
        curvature = moved - mixed.T @ inverse @ mixed
        gradient = chosen.T @ (table.rows[slope_rows] @ left)
        sizes = np.maximum(curvature.diagonal(), _IMITATED * moved.diagonal())
        # Not y'y less what is explained: where large residues cancel, rounding would leave less than nothing.
        return float(left @ left), linear, curvature, gradient, sizes

    position = np.log(-poles)
    cost, linear, curvature, gradient, sizes = measure(position)
    # Below this part of the readings' power a cost is rounding.
    rounding = 1e-13 * float(table.rows[0] @ table.rows[0])
    damping = 1e-3
    for _ in range(60):
        step = damped_step(curvature, gradient, damping, sizes)
        if abs(float(step @ (2.0 * gradient - curvature @ step))) < _UNSEEN * rounding:
            break
        step *= min(1.0, _LONGEST_STEP / (float(np.abs(step).max()) + 1e-300))
        trial = (position + step).clip(lower, upper)
        new_cost, new_linear, new_curvature, new_gradient, new_sizes = measure(trial)
        gain = cost - new_cost
        if gain > 0:
            position, cost, linear = trial, new_cost, new_linear
            curvature, gradient, sizes = new_curvature, new_gradient, new_sizes
            damping = max(damping * 0.1, 1e-9)
            if gain < _SETTLED * cost + rounding:
                break
        else:
            if -gain <= _SETTLED * cost + rounding or damping > 1e8:
                break
            damping = max(damping * 10.0, 1e-4)
    order = np.argsort(-position)
    return PoleFit(-np.exp(position[order]), linear[first::width][order], linear[:first], cost)
