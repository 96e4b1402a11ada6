"""Sets of poles of a grid, all solved at once: where the searches for poles begin.

At given poles a reading is linear in everything else, so that the products of what each pole of the grid answers solve
every set without looking at a reading again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations, islice, product
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.search.searched_run import SearchedRun, side_by_side
from ipmclab.model.numerics.drive import complex_responses
from ipmclab.model.numerics.poles_loop import pole_values
from ipmclab.run import FloatArray

ComplexArray = npt.NDArray[np.complex128]
IndexArray = npt.NDArray[np.intp]

GRID_POLES: Final = 10  # from the fastest to the slowest that a record can show, at least
_GRID_STARTS: Final = 4  # no two of them neighbours
_PAIR_GRID: Final = 8  # real poles beside a complex pair, and as many distances of that from zero
_DAMPING: Final = (0.2, 0.5, 0.85)  # damping ratios that are tried with each
_MOST_SETS: Final = 10_000  # of grid poles that are all tried: up to six poles
_EXCHANGES: Final = 10  # of each of the poles, where these are more


def pole_grid(series: Sequence[SearchedRun], count: int = GRID_POLES) -> FloatArray:
    """Poles from a third of the slowest to the fastest that these records can show, fastest first [1/s]."""
    longest = max(float(run.time[-1] - run.time[0]) for run in series)
    shortest = min(run.step or float(run.drive.durations.max()) for run in series)
    return np.asarray(-np.exp(np.linspace(math.log(2.0 / shortest), math.log(0.3 / longest), count)))


@cache
def _choices(grid: int, count: int) -> IndexArray:
    """Every set of so many places in a grid, one a row."""
    choices = np.array(list(combinations(range(grid), count)), dtype=np.intp)
    choices.setflags(write=False)
    return choices


Gains = Callable[[IndexArray], FloatArray]
"""How much of the power of the readings each of some sets of places in a grid explains, one a row."""


def _exchanged(grid: int, count: int, gains: Gains) -> IndexArray:
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


@dataclass(frozen=True, eq=False)
class _Grid:
    """What poles of a grid answer, as products: sets of them are solved without looking at a reading again.

    Parameters
    ----------
    gram, right : float arrays, shapes (n, n), (n,)
        Products of the rows with each other and with the readings, all rows of length 1: the common columns, then the
        blocks of rows of each pole, of a complex one two.
    power : float
        That of the readings.
    first, width : int
        How many common columns, and how many rows a block has.
    """

    gram: FloatArray
    right: FloatArray
    power: float
    first: int
    width: int

    @classmethod
    def of(
        cls, series: Sequence[SearchedRun], common: FloatArray, real: FloatArray, above: ComplexArray | None = None
    ) -> _Grid:
        """Of real poles, and of complex ones behind them."""
        turning = np.empty(0, np.complex128) if above is None else above
        first, width = len(common), 1 + sum(run.free_start for run in series)
        rows = np.zeros((1 + first + (len(real) + 2 * len(turning)) * width, sum(len(run.time) for run in series)))
        rows[0] = np.concatenate([run.readings for run in series])
        rows[1 : 1 + first] = common
        blocks = rows[1 + first :].reshape(-1, width, rows.shape[1])
        places = slice(len(real)), slice(len(real), None, 2), slice(len(real) + 1, None, 2)
        for run, own, place in side_by_side(series):
            state = np.empty((len(real), len(run.drive.kind) + 1))
            pole_values(run.drive.durations, run.drive.kind, run.drive.start, run.drive.end, real, state)
            answers = [(0, state if run.drive.rows is None else state[:, run.drive.rows])]
            turned = [(0, complex_responses(run.drive, turning)[0])] if len(turning) else []
            if place:
                answers.append((place, np.exp(np.outer(real, run.time))))
                turned.append((place, np.exp(np.outer(turning, run.time))))
            for row, answer in answers:
                blocks[places[0], row, own] = answer
            for row, turning_answer in turned:
                blocks[places[1], row, own], blocks[places[2], row, own] = turning_answer.real, turning_answer.imag
        rows *= np.concatenate([run.weight for run in series])
        products = rows[1:] @ rows.T
        scale = np.sqrt(np.maximum(products[:, 1:].diagonal(), 1e-300))
        gram, right = products[:, 1:] / (scale[:, None] * scale), products[:, 0] / scale
        return cls(gram, right, float(rows[0] @ rows[0]), first, width)

    def gains(self, choices: IndexArray) -> FloatArray:
        """How much of the power of the readings each of some sets of blocks explains, one a row."""
        index = np.empty((len(choices), self.first + choices.shape[1] * self.width), dtype=np.intp)
        index[:, : self.first] = np.arange(self.first)
        blocks = self.first + self.width * choices[:, :, None] + np.arange(self.width)
        index[:, self.first :] = blocks.reshape(len(choices), choices.shape[1] * self.width)
        # A little of the identity keeps nearly parallel columns from spoiling a choice; the descent is exact.
        matrices = self.gram[index[:, :, None], index[:, None, :]] + 1e-10 * np.eye(index.shape[1])
        vectors = self.right[index]
        return np.asarray((vectors * np.linalg.solve(matrices, vectors[:, :, None])[:, :, 0]).sum(axis=1))


def grid_starts(series: Sequence[SearchedRun], count: int, common: FloatArray) -> Iterator[FloatArray]:
    """Positions of a few sets of grid poles, the best first, no two of them neighbours in every pole."""
    poles = pole_grid(series, max(GRID_POLES, 2 * count + 4))
    grid = _Grid.of(series, common, poles)
    few = math.comb(len(poles), count) <= _MOST_SETS
    choices = _choices(len(poles), count) if few else _exchanged(len(poles), count, grid.gains)
    return (np.log(-poles[one]) for one in islice(_spread(choices, grid.gains(choices)), _GRID_STARTS))


def grid_pairs(series: Sequence[SearchedRun], count: int, common: FloatArray, hopeless: float) -> Iterator[FloatArray]:
    """Positions of sets of grid poles with one complex pair each, as ``grid_starts``; none of a higher cost."""
    poles = pole_grid(series, _PAIR_GRID)
    pairs = list(product(range(_PAIR_GRID), range(len(_DAMPING))))
    angles = np.arccos(-np.array(_DAMPING))
    above = np.array([-poles[far] * np.exp(1j * angles[near]) for far, near in pairs])
    grid = _Grid.of(series, common, poles, above)
    own = list(combinations(range(_PAIR_GRID), count))
    places = np.array([[*real, *pair] for pair in pairs for real in own], dtype=np.intp).reshape(
        len(pairs) * len(own), count + 2
    )
    block = _PAIR_GRID + 2 * (len(_DAMPING) * places[:, count] + places[:, count + 1])
    gains = grid.gains(np.column_stack([places[:, :count], block, block + 1]))
    hopeful = grid.power - gains < hopeless
    for one in _spread(places[hopeful], gains[hopeful]):
        *real, far, near = one.tolist()
        yield np.array([*np.log(-poles[real]), math.log(-poles[far]), angles[near]])


def _spread(choices: IndexArray, gains: FloatArray) -> Iterator[IndexArray]:
    """The choices, the best first, none a neighbour in every place of one before."""
    left = choices[np.argsort(-gains, kind="stable")]
    while len(left):
        yield left[0]
        left = left[(np.abs(left - left[0]) > 1).any(axis=1)]
