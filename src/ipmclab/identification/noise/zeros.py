"""The zero and the drift of a sensor beside the parameters: what a fit may add to the readings of an output of a run.

A reading is model + N c + noise, where the columns of N are 1 and time, and c is the zero and the slope of the sensor.
For given parameters the best c is linear in the residual, so it is projected out. Rows at 0 V, before the strip is
driven, show the sensor alone: their slope, with its standard error, is known beforehand. With P the precision of what
is known, minus twice the log density of the best c is r' T^2 r with T^2 = I - N (N'N + P)^-1 N'. Least squares count
each row as one, which what is left of them is not: of a slope they say as many times less as its variance is larger
under the noise that was found, and P is multiplied by that. Else what a model lacks outweighs what was known.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.noise.at_rest import NO_SLOPE, SlopeAtRest, slope_at_rest, slope_inflation
from ipmclab.identification.noise.pieces import Key
from ipmclab.identification.noise.whitening import Changed
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Noise, Problem
from ipmclab.identification.problem.record import PreparedRun
from ipmclab.run import FloatArray
from ipmclab.statespace.columns import held_constants, origin
from ipmclab.statespace.shape import Shape
from ipmclab.statespace.terms import Terms

LARGEST_ZERO: Final = 0.01
"""Of the largest current: a larger zero is seen by who looks at the readings."""


@dataclass(frozen=True, eq=False)
class Zero:
    """What the sensor of one output of one run may add to its readings.

    Parameters
    ----------
    terms : Terms
        Whether there is a zero, and a slope.
    columns : float array, shape (n_measured, n_constants)
        What each adds to the readings.
    inside : bool array, shape (n_rows,)
        Rows that are measured; the others are bounds.
    origin, half : float [s]
        Where the slope adds nothing, and half the length of the readings: the unit of its column.
    rest : SlopeAtRest
        The slope that the rows at 0 V have.
    most : float [SI]
        Standard deviation of the zero, where something is known of it beforehand; else infinite.
    inflation : float
        By how many times less its rows say of the slope, beside what is known beforehand, than as many rows of white
        noise would.
    """

    terms: Terms
    columns: FloatArray
    inside: npt.NDArray[np.bool_]
    origin: float
    half: float
    rest: SlopeAtRest
    most: float = math.inf
    inflation: float = 1.0

    @classmethod
    def of(cls, record: PreparedRun, output: str, terms: Terms, noise: Shape, unit: float) -> Zero:
        """The constants that a noise calls for, which is in so many SI units."""
        inside = record.readings[output].exact_of_used
        time = record.times_of(output)
        half = 0.5 * float(time[-1] - time[0])
        rest = slope_at_rest(record, output, noise, unit) if terms.trend else NO_SLOPE
        most = math.inf
        if output == "current" and record.zero_is_unseen:
            # A zero that no row at 0 V shows looks like the dc path, and a drift like a slow branch.
            largest = float(np.abs(record.readings[output].measured).max())
            if largest > 0.0 and half > 0.0:  # readings that are all 0 bound nothing
                most = LARGEST_ZERO * largest
                rest = rest._replace(error=min(rest.error, most / half))
        inflation = slope_inflation(time, record.step, noise) if terms.trend else 1.0
        return cls(terms, held_constants(time, terms), inside, origin(time, terms), half, rest, most, inflation)

    def on(self, record: PreparedRun, output: str) -> Zero:
        """The same beside means of the rows."""
        reading = record.readings[output]
        away = (record.times_of(output) - self.origin) / self.half
        rows = np.array([np.ones(len(away)), away])[self.terms.held]
        weights = 1.0 if reading.weights is None else reading.weights[reading.exact]
        inside, rest = record.readings[output].exact_of_used, self.rest._replace(weights=np.zeros(0))
        return replace(self, columns=(rows * weights).T, inside=inside, rest=rest)

    def projection(self, sigma: float) -> Projection:
        """In units of the noise of the rows."""
        known = [(0.0, self.most)] if self.terms.offset else []
        known += [(self.rest.slope * self.half, self.rest.error * self.half)] if self.terms.trend else []
        precision = np.array([(sigma / error) ** 2 for _, error in known])
        errors = np.where(precision > 0.0, 1.0 / np.sqrt(np.where(precision > 0.0, precision, 1.0)), 0.0)
        if self.terms.trend:
            precision[-1] *= self.inflation
        centre = np.array([middle / sigma for middle, _ in known])
        by_rows = np.zeros_like(self.columns)
        if self.terms.trend:
            by_rows[: len(self.rest.weights), -1] = self.rest.weights * self.half
        inner = np.linalg.inv(self.columns.T @ self.columns + np.diag(precision))
        orthonormal, triangle = np.linalg.qr(self.columns)
        share, turn = np.linalg.eigh(triangle @ inner @ triangle.T)
        basis = orthonormal @ turn
        taken = basis * (1.0 - np.sqrt(np.clip(1.0 - share, 0.0, 1.0)))
        expected, answer = self.columns @ centre, inner @ self.columns.T
        return Projection(basis, share, taken, answer, centre, expected, self.columns, errors, by_rows)


@dataclass(frozen=True, eq=False)
class Projection:
    """The best zero and slope taken out of rows.

    Parameters
    ----------
    basis : float array, shape (n_measured, n_constants)
        Orthonormal columns Q.
    share : float array, shape (n_constants,)
        How much of the squares along each goes: all of what nothing is known of.
    taken : float array, shape (n_measured, n_constants)
        Q times the part of each that goes: T r is r less this times Q'r.
    answer : float array, shape (n_constants, n_measured)
        From a residual to the best constants about their centre.
    centre : float array, shape (n_constants,)
    expected : float array, shape (n_measured,)
        What the centre adds to the readings.
    columns : float array, shape (n_measured, n_constants)
        What each adds to the readings.
    known : float array, shape (n_constants,)
        The standard error of what is known of each; 0 where nothing is.
    by_rows : float array, shape (n_measured, n_constants)
        How much of what is known of each a reading gives: of a slope at 0 V those at 0 V do. These readings are fitted
        too, so that what is known has no error of its own but what is left beside theirs.
    """

    basis: FloatArray
    share: FloatArray
    taken: FloatArray
    answer: FloatArray
    centre: FloatArray
    expected: FloatArray
    columns: FloatArray
    known: FloatArray
    by_rows: FloatArray


class DriftingProblem(Changed):
    """The same problem with zeros and slopes of sensors beside it.

    Parameters
    ----------
    plain : Problem
    zeros : mapping of (place, output) to Zero
    """

    def __init__(self, plain: Problem, zeros: Mapping[Key, Zero]) -> None:
        super().__init__(plain, zeros)
        self.zeros = dict(zeros)
        self.projections = {key: zero.projection(self.noise[key]) for key, zero in self.zeros.items()}

    @cached_property
    def on_means(self) -> Problem | None:
        """The same zeros and slopes beside means of the rows, where these are much fewer."""
        plain = self.plain.on_means
        if plain is None:
            return None
        return DriftingProblem(
            plain, {key: zero.on(plain.record_at(key[0]), key[1]) for key, zero in self.zeros.items()}
        )

    def on(self, plain: Problem) -> Problem:
        """Another problem, of some of the same readings, beside the same zeros and slopes."""
        return DriftingProblem(plain, {key: zero for key, zero in self.zeros.items() if key in plain.pieces})

    def with_noise(self, noise: Noise) -> Problem:
        """The same problem with other weights."""
        return self.on(self.plain.with_noise(noise))

    def weighed(self, theta: FloatArray, here: Evaluation, noise: Noise) -> Evaluation:  # noqa: ARG002  # the protocol's signature
        """An evaluation as it is under other weights: what is known of a slope weighs anew too."""
        return self.with_noise(noise).evaluate(theta)

    def changed(self, here: Evaluation) -> Evaluation:
        """An evaluation of the plain problem, the best zeros and slopes taken out."""
        rows = here.rows.copy()
        for key, zero in self.zeros.items():
            own = rows[:, self.pieces[key]]
            # The residual is model less reading: what the sensor is expected to add is not the model's.
            own[-1, zero.inside] += self.projections[key].expected
            own[:] = self.whitened(key, own)
        return Evaluation(rows, here.beforehand)

    def whitened(self, key: Key, rows: FloatArray) -> FloatArray:
        """Rows of one output of one run, zero and slope taken out."""
        if key not in self.zeros:
            return rows
        found, inside = rows.copy(), self.zeros[key].inside
        projection, own = self.projections[key], found[:, inside].T
        found[:, inside] = (own - projection.taken @ (projection.basis.T @ own)).T
        return found

    def shift(self, key: Key, rows: FloatArray) -> FloatArray:
        """By how much the residuals change with the readings: the slope that those at 0 V show changes with them."""
        if key not in self.zeros:
            return rows
        found, inside, projection = rows.copy(), self.zeros[key].inside, self.projections[key]
        found[:, inside] -= found[:, inside] @ projection.by_rows @ projection.columns.T
        return self.whitened(key, found)

    def squares(self, key: Key, residual: FloatArray) -> float:
        """Those of the readings about the best zero and slope.

        Along a direction of which a share s goes, the squares of T r are those and what the constants differ from what
        is known of them, s of the whole: a slope that is known badly and counts much is no noise.
        """
        whole = super().squares(key, residual)
        if key not in self.zeros:
            return whole
        projection = self.projections[key]
        along = projection.basis.T @ residual[self.zeros[key].inside]
        return max(whole - float(projection.share @ (along * along)), 0.0)

    def constants(self, key: Key, plain: FloatArray) -> FloatArray:
        """The best zero, where the slope adds nothing, and slope over half of the readings, of a plain residual."""
        zero, projection = self.zeros[key], self.projections[key]
        return np.asarray(projection.centre - projection.answer @ (plain[zero.inside] + projection.expected))
