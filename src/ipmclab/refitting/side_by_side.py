"""Gauss-Newton steps of many fits to the same runs, side by side.

The fits share runs, unknowns and weights, and differ in their readings: draws of the noise, or other strips under the
same voltage. Each goes the way that ``solve.polish`` goes with one, and ends where that ends. A circuit that is read by
its current needs no rows for that, only products of what its poles answer, with each other and with the residuals: they
are made for all fits in one compiled loop, and the small equations of all fits are solved in one operation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.identification.problem.evaluation import INDEPENDENT
from ipmclab.identification.problem.place import Place
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import PreparedRun, drive
from ipmclab.identification.problem.response import CircuitResponder, circuits, lumped_derivatives
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.identification.search.solve import FARTHEST_STEP, HARDLY, MOST_STEPS, NEGLIGIBLE, NOTHING
from ipmclab.identification.search.tangent import STRUCTURAL
from ipmclab.model.numerics.drive import Drive
from ipmclab.refitting.kernels import pole_products

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]


class Polished(NamedTuple):
    """Where many fits have ended.

    Parameters
    ----------
    thetas : float array, shape (n_fit, n_unknown)
    costs : float array, shape (n_fit,)
    ended : bool array, shape (n_fit,)
        False where Gauss-Newton steps led to no minimum: another search has to.
    """

    thetas: FloatArray
    costs: FloatArray
    ended: Mask


@dataclass(frozen=True, eq=False)
class _Part:
    """One run: how it is driven and read, and the entries of the vector that move its circuit."""

    drive: Drive
    piece: slice
    weight: float
    readings: FloatArray
    series_resistance: float
    columns: list[tuple[int, Unknown]]


class SideBySide:
    """A problem whose fits go side by side.

    Parameters
    ----------
    problem : Problem
    parts : sequence of _Part
    branches : int
    """

    def __init__(self, problem: Problem, parts: Sequence[_Part], branches: int) -> None:
        self._problem, self._parts, self._branches = problem, tuple(parts), branches

    @classmethod
    def of(cls, problem: Problem) -> SideBySide | None:
        """The same problem for many fits; None where something else than a circuit at rest is read by its current."""
        responder = problem.responder
        if type(problem) is not Problem or not isinstance(responder, CircuitResponder):
            return None
        if any(u.base not in problem.base or u.prior is not None for u in problem.unknowns) or not problem.unknowns:
            return None
        parts = [_part(problem, record) for record in problem.records]
        found = [part for part in parts if part is not None]
        return cls(problem, found, responder.branches) if len(found) == len(parts) else None

    def polished(self, theta: FloatArray, shifts: FloatArray) -> Polished:
        """Gauss-Newton steps of all fits from one point.

        Parameters
        ----------
        theta : float array, shape (n_unknown,)
        shifts : float array, shape (n_fit, n_residual)
            What the residuals of each have in addition to those of the problem.
        """
        thetas = np.tile(theta, (len(shifts), 1))
        costs = np.full(len(shifts), np.inf)
        ended = np.zeros(len(shifts), dtype=bool)
        if not self._inside(thetas[:1])[0]:
            return Polished(thetas, costs, ended)
        going = np.arange(len(shifts))
        readings = [part.readings - shifts[:, part.piece] for part in self._parts]
        products = self._first_products(theta, shifts)
        costs[:] = products[:, -1, -1]
        for _ in range(MOST_STEPS):
            steps, expected = _steps(products)
            there = expected <= np.maximum(NEGLIGIBLE, NOTHING * costs[going])
            ended[going[there]] = True
            trials = thetas[going] + steps
            on = ~there & self._inside(trials) & (np.abs(steps).max(axis=1) <= FARTHEST_STEP)
            going, trials, expected = going[on], trials[on], expected[on]
            if not len(going):
                break
            products = self._products(trials, readings, going)
            falls = products[:, -1, -1] < costs[going]
            ended[going[~falls & (expected <= HARDLY * costs[going])]] = True
            going, products = going[falls], products[falls]
            thetas[going], costs[going] = trials[falls], products[:, -1, -1]
        return Polished(thetas, costs, ended)

    def _inside(self, thetas: FloatArray) -> Mask:
        return np.asarray(((self._problem.lower < thetas) & (thetas < self._problem.upper)).all(axis=1))

    def _first_products(self, theta: FloatArray, shifts: FloatArray) -> FloatArray:
        """The same at a point that is that of all fits: they have its Jacobian in common."""
        rows = self._problem.evaluate(theta).rows
        residuals = rows[-1] + shifts
        found = np.empty((len(shifts), len(rows), len(rows)))
        found[:, :-1, :-1] = rows[:-1] @ rows[:-1].T
        found[:, :-1, -1] = found[:, -1, :-1] = residuals @ rows[:-1].T
        found[:, -1, -1] = np.einsum("ij,ij->i", residuals, residuals)
        return found

    def _products(self, thetas: FloatArray, readings: Sequence[FloatArray], chosen: IndexArray) -> FloatArray:
        """Products of the columns of the Jacobian and the residual, shape (n_fit, n_unknown + 1, n_unknown + 1)."""
        fits, unknowns = thetas.shape
        found = np.zeros((fits, unknowns + 1, unknowns + 1))
        for part, read in zip(self._parts, readings, strict=True):
            values: dict[str, Any] = dict(self._problem.base)
            for column, unknown in part.columns:
                values[unknown.base] = unknown.values(thetas[:, column])
            found_circuits = circuits(self._branches, values, fits, part.series_resistance)
            size = 2 + 2 * self._branches
            products = np.empty((fits, size, size))
            given = part.drive
            pole_products(
                given.durations,
                given.kind,
                given.start,
                given.end,
                given.present,
                found_circuits.poles,
                found_circuits.direct,
                found_circuits.residues,
                part.weight,
                read,
                chosen,
                products,
            )
            turn = np.zeros((fits, size, unknowns + 1))
            turn[:, -1, -1] = 1.0
            names = [unknown.base for _, unknown in part.columns]
            slopes = found_circuits.derivatives @ lumped_derivatives(self._branches, values, names)
            for number, (column, unknown) in enumerate(part.columns):
                chain = values[unknown.base] if unknown.log else unknown.scale
                turn[:, :-1, column] = slopes[:, :, number] * (np.asarray(chain * part.weight)[..., None])
            found += turn.transpose(0, 2, 1) @ products @ turn
        return found


def _part(problem: Problem, record: PreparedRun) -> _Part | None:
    """One run as all fits see it; None where more is asked of it than a current that begins at rest."""
    reading = record.readings.get("current")
    if reading is None or len(record.readings) > 1 or record.start == "free" or record.delay_is_free:
        return None
    if record.state is not None or reading.has_bounds or not reading.complete or reading.weights is not None:
        return None
    given = drive(record, record.known_delay or 0.0)
    if given.rows is not None:
        return None
    key = record.place, "current"
    weight = 1.0 / problem.noise[key]
    columns = Place.of(record, problem.unknowns, problem.base).columns
    return _Part(given, problem.pieces[key], weight, reading.values * weight, record.series_resistance, columns)


def _steps(products: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gauss-Newton steps, and the decrease of the cost that each promises; NaN where columns are nearly dependent."""
    fits, columns = len(products), products.shape[1] - 1
    steps, expected = np.full((fits, columns), np.nan), np.full(fits, np.nan)
    sizes = np.sqrt(np.maximum(np.diagonal(products, axis1=1, axis2=2), 1e-300))
    factors = _factors(products / (sizes[:, :, None] * sizes[:, None, :]))
    independent = np.diagonal(factors, axis1=1, axis2=2).min(axis=1) > INDEPENDENT
    triangles = factors[independent].transpose(0, 2, 1)[:, :columns]
    left, singular, directions = np.linalg.svd(triangles[:, :, :columns])
    right = triangles[:, :, columns] * sizes[independent, -1:]
    turned = (left.transpose(0, 2, 1) @ right[:, :, None])[:, :, 0]
    kept = singular > STRUCTURAL * singular[:, :1]
    turned = np.where(kept, turned, 0.0)
    moved = (directions.transpose(0, 2, 1) @ (turned / singular)[:, :, None])[:, :, 0]
    steps[independent], expected[independent] = -moved / sizes[independent, :columns], (turned * turned).sum(axis=1)
    return steps, expected


def _factors(matrices: FloatArray) -> FloatArray:
    """Their Cholesky factors; zeros of those that have none."""
    try:
        return np.asarray(np.linalg.cholesky(matrices))
    except np.linalg.LinAlgError:
        found = np.zeros_like(matrices)
        for place, matrix in enumerate(matrices):
            try:
                found[place] = np.linalg.cholesky(matrix)
            except np.linalg.LinAlgError:
                continue
        return found
