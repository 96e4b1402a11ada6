"""How likely parameters are, given the readings of a fit and what was known beforehand."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.noise.pieces import Key
from ipmclab.identification.noise.whitening import CorrelatedProblem
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.unknowns import Unknown, actuator_unknown, known_together
from ipmclab.identification.solved import Estimate
from ipmclab.model.order import Order
from ipmclab.model.parameters import Parameter
from ipmclab.posterior.coordinates import WIDEST, Straight, coordinates
from ipmclab.posterior.many import in_reference, residuals
from ipmclab.statespace.columns import held_constants, steps_between, whitened
from ipmclab.statespace.terms import Terms, state_space

FloatArray = npt.NDArray[np.float64]

AT_FLOOR: Final = 1.01
"""Times the rounding of the model: noise that small is none."""

_MATTERS: Final = 0.1  # of what noise moves all readings together: a fixed value that moves them less is taken as exact
_NOISE_WIDTH: Final = 0.2  # the same of the numbers that shape the noise
_RECTANGLE: Final = 3.0**0.5  # half width of a rectangular distribution, in its standard deviations (derived)
_MOST_READINGS: Final = 1_000_000  # of vectors that are worked on at once: 8 MB for each output


@dataclass(frozen=True, eq=False)
class _Noise:
    """The noise of one output of one run: its scale, offset and trend integrated over, its shape in the vector.

    Parameters
    ----------
    terms : Terms
    place : slice
        Of its shape in the vector.
    held : float array, shape (n_measured, n_constants)
    steps : int array, shape (n_measured,)
    inside : bool array, shape (n_rows,)
        Rows that are measured; the others are bounds.
    known : bool
        Whether its scale is that of the rows: readings that are as exact as the model itself.
    """

    terms: Terms
    place: slice
    held: FloatArray
    steps: npt.NDArray[np.int64]
    inside: npt.NDArray[np.bool_]
    known: bool

    def log_densities(self, residuals: FloatArray, entries: FloatArray) -> FloatArray:
        """Of residuals of shape (n, n_readings) under shapes of shape (n, n_shapes); shape (n,)."""
        if self.inside.all():
            measured, found = residuals, np.zeros(len(residuals))
        else:
            measured, found = residuals[:, self.inside], -0.5 * _squares(residuals[:, ~self.inside])
        if self.known:
            return found - 0.5 * _squares(measured)
        logarithms = np.zeros(len(residuals))
        if self.terms.shapes or self.held.shape[1]:
            measured, logarithms = self._whitened(measured, entries)
        powers = _squares(measured)
        fine = np.isfinite(powers) & (powers > 0.0) & np.isfinite(logarithms)
        # Every logarithm of the scale, every offset and every trend is as likely as another beforehand.
        count = measured.shape[1] - self.held.shape[1]
        found -= 0.5 * (logarithms + count * np.log(np.where(fine, powers, 1.0)))
        # Every partial autocorrelation in (-1, 1) is, and every size of a walk or of white noise.
        order = self.terms.order
        found += entries[:, order:].sum(axis=1) - 2.0 * np.log(np.cosh(entries[:, :order])).sum(axis=1)
        return np.where(fine, found, -np.inf)

    def _whitened(self, measured: FloatArray, entries: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals whitened, offset and trend taken out, and the logarithms of the determinants that go with it."""
        each = [
            whitened(state_space(self.terms, shape), np.column_stack([self.held, one]), self.steps)
            for one, shape in zip(measured, entries, strict=True)
        ]
        white, logarithms = np.array([one for one, _ in each]), np.array([one for _, one in each])
        held, left = white[..., :-1], white[..., -1]
        if not held.shape[-1]:
            return left, logarithms
        basis, triangles = np.linalg.qr(held)
        left -= (basis @ (basis.mT @ left[..., None]))[..., 0]
        return left, logarithms + 2.0 * np.log(np.abs(np.diagonal(triangles, axis1=1, axis2=2))).sum(axis=1)


class Density:
    """The logarithm of the posterior density, up to a constant, over vectors.

    A vector holds the unknowns of the fit, then fixed parameters with a stated uncertainty that matters, then
    what shapes the noise of each output. An entry without a prior is as likely anywhere between its bounds: a
    logarithm uniformly in the logarithm.

    Parameters
    ----------
    estimate : Estimate
    stated : mapping of name to Parameter
        Fixed parameters whose uncertainty is stated.
    together : mapping of name to mapping of name to float [SI]
        Their covariance: an earlier fit found some of them together.
    """

    def __init__(
        self, estimate: Estimate, stated: Mapping[str, Parameter], together: Mapping[str, Mapping[str, float]]
    ) -> None:
        correlated = estimate.correlated
        solved, theta = correlated.problem, correlated.solution.theta
        moved = known_together(_that_matter(solved, theta, stated), together)
        self.unknowns: tuple[Unknown, ...] = (*solved.unknowns, *moved)
        self.problem = Problem(solved.base, solved.records, self.unknowns, solved.responder, solved.noise)
        whole = CorrelatedProblem(self.problem, correlated.whitenings)
        here = np.append(theta, [unknown.prior[0] for unknown in moved if unknown.prior is not None])
        self._noise: dict[Key, _Noise] = {}
        shapes: list[FloatArray] = []
        limits = list(zip(self.problem.lower, self.problem.upper, strict=True))
        for record in solved.records:
            for output in record.readings:
                key = record.place, output
                shape = correlated.shapes.get(key)
                terms = Terms() if shape is None else shape.terms
                time = record.times_of(output)
                self._noise[key] = _Noise(
                    terms,
                    slice(len(limits), len(limits) + terms.shapes),
                    held_constants(time, terms),
                    steps_between(time, record.step),
                    record.readings[output].exact_of_used,
                    solved.noise[key] <= AT_FLOOR * solved.floors[key],
                )
                limits += terms.bounds
                shapes.append(np.zeros(0) if shape is None else shape.entries)
        self.lower, self.upper = np.array(limits).T
        middle = np.concatenate([here, *shapes])
        straight = Straight(middle, _root(whole.evaluate(here).triangle[:, :-1], len(middle)))
        self.coordinates = coordinates(whole, here, straight, width=_NOISE_WIDTH)
        self._range_middles, self._range_widths = _ranges(self.unknowns)
        self._together = max(1, _MOST_READINGS // sum(len(record.run.time) for record in solved.records))
        self._order = Order(self.problem.in_reference(here, self.problem.records[0].place))

    def __call__(self, vectors: FloatArray) -> FloatArray:
        """The logarithm of the density at vectors, shape (n, n_entry) to (n,); minus infinity outside the bounds."""
        found = np.full(len(vectors), -np.inf)
        possible = np.flatnonzero(self._possible(vectors))
        for begin in range(0, len(possible), self._together):
            some = possible[begin : begin + self._together]
            found[some] = self._of_possible(vectors[some])
        return found

    def _of_possible(self, vectors: FloatArray) -> FloatArray:
        thetas = vectors[:, : len(self.unknowns)]
        found = -0.5 * _squares(self.problem.from_priors(thetas))
        for key, away in residuals(self.problem, thetas).items():
            noise = self._noise[key]
            found += noise.log_densities(away, vectors[:, noise.place])
        return np.where(np.isfinite(found), found, -np.inf)

    def _possible(self, vectors: FloatArray) -> npt.NDArray[np.bool_]:
        """Which vectors lie within all bounds and ranges."""
        thetas = vectors[:, : len(self.unknowns)]
        inside = ((vectors > self.lower) & (vectors < self.upper)).all(axis=1)
        inside &= (np.abs(thetas - self._range_middles) <= _RECTANGLE * self._range_widths).all(axis=1)
        # Branches and modes keep their names: the fastest is the fastest in every sample.
        inside[inside] = self._order.holds(in_reference(self.problem, thetas[inside], self.problem.records[0].place))
        return np.asarray(inside)


def _squares(rows: FloatArray) -> FloatArray:
    """The sum of squares of each row."""
    return np.asarray(np.einsum("ij,ij->i", rows, rows))


def _that_matter(problem: Problem, theta: FloatArray, stated: Mapping[str, Parameter]) -> list[Unknown]:
    """Fixed parameters whose uncertainty moves the readings, as unknowns with a prior."""
    if not stated:
        return []
    moves = np.linalg.norm(problem.fixed_jacobian(theta, list(stated)), axis=0)
    return [
        actuator_unknown(parameter, None).known(parameter.value, parameter.standard_uncertainty)
        for parameter, size in zip(stated.values(), moves, strict=True)
        if size * parameter.standard_uncertainty > _MATTERS
    ]


def _root(triangle: FloatArray, size: int) -> FloatArray:
    """A matrix whose product with normal numbers scatters as the curvature at the fit says, shape (size, size)."""
    _, singular, directions = np.linalg.svd(triangle)
    count = triangle.shape[1]
    singular = np.concatenate([singular, np.zeros(count - len(singular))])
    found = _NOISE_WIDTH * np.eye(size)
    found[:count, :count] = directions.T / np.maximum(singular, 1.0 / WIDEST)
    return found


def _ranges(unknowns: Sequence[Unknown]) -> tuple[FloatArray, FloatArray]:
    """Centres and widths of the priors that are ranges; a width without end for others."""
    of = [u.prior if u.prior is not None and u.beforehand is None else (0.0, math.inf) for u in unknowns]
    return np.array([centre for centre, _ in of]), np.array([width for _, width in of])
