"""Variable projection: the poles of a response, found from the data alone.

Y(s) = D + sum_j r_j/(s - lambda_j) is linear in D and r for given poles. Only the poles are
searched, on a logarithmic scale: first over the sets of a grid, then by damped Gauss-Newton
steps. No starting values are needed. Two of the poles may be a complex pair.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.identification.search.pole_grid import grid_pairs, grid_starts, pole_grid
from ipmclab.identification.search.searched_run import SearchedRun, side_by_side
from ipmclab.model.numerics.drive import complex_responses, responses
from ipmclab.normal_equations import damped_step, pseudo_inverse
from ipmclab.progress import tick
from ipmclab.run import FloatArray

ComplexArray = npt.NDArray[np.complex128]

_BRIEFLY: Final = 3  # steps of each set with a pair: a start, of which the rest is the fit's own search
_FOLLOWED: Final = 3  # of these, to their minimum
_AT_LENGTH: Final = 60  # steps of each set of real poles (a limit)
_LEAST_DAMPING, _MOST_DAMPING = 0.02, 0.999  # between which a complex pair is sought: beyond, it is two real poles
_LONGEST_STEP: Final = 1.5  # of a logarithm in one iteration
_SETTLED: Final = 1e-10  # relative decrease of the cost at which a descent ends
_UNSEEN: Final = 1e-4  # of the rounding of a cost: a decrease that could not be told from it
_IMITATED: Final = 1e-12  # of its square: what is left of the move of a pole that the linear part follows to rounding
_BEYOND: Final = math.log(10.0)  # outside of a grid, from which on a pole is a jump, or a straight line
_EQUAL: Final = 0.05  # of a logarithm: poles nearer than that have met


class Pair(NamedTuple):
    """A complex pair of poles, by the one above the real axis [1/s]: the real part of ``residue/(s - pole)``."""

    pole: complex
    residue: complex


@dataclass(frozen=True, eq=False)
class PoleFit:
    """What the search found.

    ``common`` holds the weights of the common columns, ``cost`` is the weighted sum of squares; ``pair`` stands beside
    the real poles where one was asked for.
    """

    poles: FloatArray
    residues: FloatArray
    common: FloatArray
    cost: float
    pair: Pair | None = None


class _Table:
    """Everything that enters linearly at given poles, weighted, one row each, all runs side by side.

    Rows: the readings, the common columns, then for each pole its response and the decays of the free starts, of a
    complex one first the real parts of these and then the imaginary ones; and last, in the same order, the derivatives
    of those by the pole.
    """

    def __init__(self, series: Sequence[SearchedRun], count: int, common: FloatArray, *, pair: bool = False) -> None:
        self._series = series
        self.count, self.pairs = count, int(pair)
        self.width = 1 + sum(run.free_start for run in series)
        self.common = len(common)
        self._weight = np.concatenate([run.weight for run in series])
        self._fixed = 1 + self.common
        self._blocks = count + 2 * self.pairs
        self.span = self._blocks * self.width
        self.rows = np.zeros((self._fixed + 2 * self.span, len(self._weight)))
        self.rows[0] = np.concatenate([run.readings for run in series]) * self._weight
        self.rows[1 : self._fixed] = common * self._weight
        self._products = np.empty((len(self.rows), len(self.rows)))
        self._products[: self._fixed, : self._fixed] = self.rows[: self._fixed] @ self.rows[: self._fixed].T

    def gram(self, poles: FloatArray, above: ComplexArray) -> FloatArray:
        """Products of all rows with each other, for real poles and that of a pair above the real axis."""
        tick()
        moving = self.rows[self._fixed :]
        values = moving[: self.span].reshape(self._blocks, self.width, -1)
        slopes = moving[self.span :].reshape(self._blocks, self.width, -1)
        for run, own, place in side_by_side(self._series):
            if self.count:
                values[: self.count, 0, own], slopes[: self.count, 0, own] = responses(run.drive, poles)
            if self.pairs:
                self._write(values, slopes, 0, own, *complex_responses(run.drive, above))
            if place:
                # Other runs' readings do not know this start.
                values[:, place], slopes[:, place] = 0.0, 0.0
                decay = np.exp(np.outer(poles, run.time))
                values[: self.count, place, own], slopes[: self.count, place, own] = decay, decay * run.time
                if self.pairs:
                    turning = np.exp(np.outer(above, run.time))
                    self._write(values, slopes, place, own, turning, turning * run.time)
        moving *= self._weight
        products = self._products.copy()
        products[self._fixed :] = moving @ self.rows.T
        products[: self._fixed, self._fixed :] = products[self._fixed :, : self._fixed].T
        return products

    def _write(
        self, values: FloatArray, slopes: FloatArray, place: int, own: slice, answer: ComplexArray, slope: ComplexArray
    ) -> None:
        """The parts of what a complex pole answers, behind the real poles."""
        values[self.count :, place, own] = answer.real[0], answer.imag[0]
        slopes[self.count :, place, own] = slope.real[0], slope.imag[0]

    def poles(self, position: FloatArray) -> tuple[FloatArray, ComplexArray]:
        """The real poles at a position of the search, and the complex one above the real axis.

        Real ones stand in it by the logarithm of their distance from zero, the complex one by that and its angle.
        """
        distance, angle = position[self.count :: 2], position[self.count + 1 :: 2]
        return -np.exp(position[: self.count]), np.exp(distance + 1j * angle)

    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Between which positions a search goes: far outside of what the records can show numbers end."""
        fastest = 1000.0 / min(float(run.drive.durations.min()) for run in self._series)
        slowest = 1e-3 / max(float(run.time[-1] - run.time[0]) for run in self._series)
        angles = np.arccos([-_LEAST_DAMPING, -_MOST_DAMPING])
        lower = np.append(np.full(self.count, math.log(slowest)), self.pairs * [math.log(slowest), angles[0]])
        upper = np.append(np.full(self.count, math.log(fastest)), self.pairs * [math.log(fastest), angles[1]])
        return lower, upper

    def moved(self, linear: FloatArray, poles: FloatArray, above: ComplexArray) -> FloatArray:
        """How the model moves along each entry of a position: a mix of the slope rows, shape (span, n_entry)."""
        weights = linear[self.common :].reshape(self._blocks, self.width)
        chosen = np.zeros((self._blocks, self.width, self._blocks))
        real = np.arange(self.count)
        chosen[real, :, real] = weights[: self.count] * poles[:, None]
        for pole in above:
            at, below = weights[self.count], weights[self.count + 1]
            for entry, way in enumerate((pole, 1j * pole), start=self.count):
                chosen[self.count, :, entry] = at * way.real + below * way.imag
                chosen[self.count + 1, :, entry] = below * way.real - at * way.imag
        return chosen.reshape(self.span, self._blocks)

    def fit(self, position: FloatArray, linear: FloatArray, cost: float) -> PoleFit:
        """A position of the search and its weights as poles and residues, the fastest first."""
        poles, above = self.poles(position)
        order = np.argsort(poles)
        residues = linear[self.common :: self.width]
        pair = None
        if self.pairs:
            pair = Pair(complex(above[0]), complex(residues[self.count], -residues[self.count + 1]))
        return PoleFit(poles[order], residues[: self.count][order], linear[: self.common], cost, pair)


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
        How many of the best grid points are followed to their minimum, where the first ends in equal poles, or in one
        that these records cannot show.

    Returns
    -------
    fit : PoleFit
        Poles fastest first.
    """
    found: list[PoleFit] = []
    table = _Table(series, count, common)
    shown = np.log(-pole_grid(series))
    fastest, slowest = shown[0] + _BEYOND, shown[-1] - _BEYOND
    for start in islice(grid_starts(series, count, common), tries):
        found.append(_descend(table, start))
        ended = np.log(-found[-1].poles)
        if ended[0] <= fastest and ended[-1] >= slowest and not (np.diff(ended) > -_EQUAL).any():
            break
    return min(found, key=lambda fit: fit.cost)


def all_minima(series: Sequence[SearchedRun], count: int, common: FloatArray) -> list[PoleFit]:
    """Every different minimum that the best grid points lead to, the lowest first; arguments as ``search_poles``."""
    table = _Table(series, count, common)
    return _different(_descend(table, start) for start in grid_starts(series, count, common))


def near_pairs(series: Sequence[SearchedRun], count: int, common: FloatArray, hopeless: float) -> list[PoleFit]:
    """So many real poles and a complex pair beside them: a few steps from every region of a grid, the lowest first.

    Beside real poles a pair has many minima, and where the grid leaves most a valley may lead lowest.

    Parameters
    ----------
    series, count, common
        As of ``search_poles``.
    hopeless : float
        Cost above which a grid point is not followed.
    """
    table = _Table(series, count, common, pair=True)
    return _different(_descend(table, start, _BRIEFLY) for start in grid_pairs(series, count, common, hopeless))


def pair_minima(series: Sequence[SearchedRun], count: int, common: FloatArray) -> list[PoleFit]:
    """The minima that the best of these lead to, the lowest first; arguments as ``search_poles``."""
    table = _Table(series, count, common, pair=True)
    near = near_pairs(series, count, common, math.inf)[:_FOLLOWED]
    return _different(_descend(table, _position(fit)) for fit in near)


def _position(fit: PoleFit) -> FloatArray:
    """The poles of a fit as a position of the search."""
    pair = [] if fit.pair is None else [math.log(abs(fit.pair.pole)), cmath.phase(fit.pair.pole)]
    return np.append(np.log(-fit.poles), pair)


def _different(fits: Iterable[PoleFit]) -> list[PoleFit]:
    """The lowest first, none with the poles of one before."""
    kept: list[PoleFit] = []
    for fit in sorted(fits, key=lambda fit: fit.cost):
        if all(np.abs(_position(fit) - _position(other)).max() > _EQUAL for other in kept):
            kept.append(fit)
    return kept


def _descend(table: _Table, position: FloatArray, steps: int = _AT_LENGTH) -> PoleFit:
    """Damped Gauss-Newton steps of a position, the linear part solved exactly at each."""
    first, span = table.common, table.span
    linear_rows, slope_rows = slice(1, 1 + first + span), slice(1 + first + span, 1 + first + 2 * span)
    lower, upper = table.limits()

    def measure(position: FloatArray) -> tuple[float, FloatArray, FloatArray, FloatArray, FloatArray]:
        poles = table.poles(position)
        products = table.gram(*poles)
        gram, right = products[linear_rows, linear_rows], products[linear_rows, 0]
        # Poles that have met share a column, and a response that no reading sees is a column of zeros.
        inverse = pseudo_inverse(gram)
        linear = inverse @ right
        # The readings are many times what is left: products with these would lose as many digits of the slope, and
        # where poles meet, on which side they part again hangs on it.
        linear += inverse @ (table.rows[linear_rows] @ (table.rows[0] - linear @ table.rows[linear_rows]))
        left = table.rows[0] - linear @ table.rows[linear_rows]
        chosen = table.moved(linear, *poles)
        mixed = products[linear_rows, slope_rows] @ chosen
        moved = chosen.T @ products[slope_rows, slope_rows] @ chosen
        curvature = moved - mixed.T @ inverse @ mixed
        gradient = chosen.T @ (table.rows[slope_rows] @ left)
        sizes = np.maximum(curvature.diagonal(), _IMITATED * moved.diagonal())
        # Not y'y less what is explained: where large residues cancel, rounding would leave less than nothing.
        return float(left @ left), linear, curvature, gradient, sizes

    cost, linear, curvature, gradient, sizes = measure(position)
    # Below this part of the readings' power a cost is rounding.
    rounding = 1e-13 * float(table.rows[0] @ table.rows[0])
    damping = 1e-3
    for _ in range(steps):
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
    return table.fit(position, linear, cost)
