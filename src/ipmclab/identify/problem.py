"""The least-squares problem of a fit: weighted residuals of every reading, with an exact Jacobian."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identify.observation import Record
from ipmclab.identify.response import Responder, Response
from ipmclab.identify.unknowns import Unknown

FloatArray = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Noise = Mapping[tuple[int, str], float]

_RECTANGLE: Final = 3.0**0.5  # half width of a rectangular distribution, in its standard deviations
_WELL_APART: Final = 1e-3  # part of a scaled column that the ones before it do not imitate

ROUNDING: Final = 1e-10
"""Part of the largest reading below which noise is not believed."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Weighted residuals (model minus reading, over noise) and their derivatives at one vector."""

    residual: FloatArray
    jacobian: FloatArray

    @cached_property
    def cost(self) -> float:
        """Weighted sum of squares."""
        return float(self.residual @ self.residual)

    @cached_property
    def triangle(self) -> FloatArray:
        """R of the QR decomposition of the Jacobian with the residual as its last column.

        It holds all that a step, a rank or a covariance needs. Where the columns are well apart the Cholesky
        factor of their products is the same in a tenth of the time.
        """
        columns = self.jacobian.shape[1]
        products = np.empty((columns + 1, columns + 1))
        products[:-1, :-1] = self.jacobian.T @ self.jacobian
        products[:-1, -1] = products[-1, :-1] = self.jacobian.T @ self.residual
        products[-1, -1] = self.cost
        size = np.sqrt(np.maximum(np.diagonal(products), 1e-300))
        try:
            factor = np.linalg.cholesky(products / np.outer(size, size))
        except np.linalg.LinAlgError:
            factor = np.zeros_like(products)
        if np.min(np.diagonal(factor)) > _WELL_APART:
            return np.asarray(factor.T * size)
        return np.asarray(np.linalg.qr(np.column_stack([self.jacobian, self.residual]), mode="r"))


class Problem:
    """Residuals of all used readings of all runs.

    Parameters
    ----------
    values : mapping of name to float [SI]
        Every actuator parameter, free or not; the values of free ones are not used.
    records : sequence of Record
    unknowns : sequence of Unknown
    responder : Responder
    noise : mapping of (place, output) to float [SI]
    """

    def __init__(
        self,
        values: Mapping[str, float],
        records: Sequence[Record],
        unknowns: Sequence[Unknown],
        responder: Responder,
        noise: Noise,
    ) -> None:
        self.base = dict(values)
        self.records = tuple(records)
        self.unknowns = tuple(unknowns)
        self.responder = responder
        self.noise = dict(noise)
        priors = [(place, *unknown.prior) for place, unknown in enumerate(self.unknowns) if unknown.prior is not None]
        self._prior_places = np.array([place for place, _, _ in priors], dtype=np.intp)
        self._prior_centres = np.array([centre for _, centre, _ in priors])
        self._prior_jacobian = np.zeros((len(priors), len(self.unknowns)))
        for row, (place, _, deviation) in enumerate(priors):
            self._prior_jacobian[row, place] = 1.0 / deviation
        limits = np.array([unknown.limits for unknown in self.unknowns]).reshape(-1, 2)
        self.lower, self.upper = limits[:, 0], limits[:, 1]

    def with_noise(self, noise: Noise) -> Problem:
        """The same problem with other weights."""
        return Problem(self.base, self.records, self.unknowns, self.responder, noise)

    def weighed(self, here: Evaluation, noise: Noise) -> Evaluation:
        """An evaluation of this problem as it is under other weights."""
        factor = np.ones(len(here.residual))
        for key, piece in self.pieces.items():
            factor[piece] = self.noise[key] / noise[key]
        return Evaluation(here.residual * factor, here.jacobian * factor[:, None])

    @cached_property
    def floors(self) -> dict[tuple[int, str], float]:
        """Noise below which readings cannot be told from the rounding of the model [SI]."""
        return {
            (record.place, output): max(ROUNDING * float(np.max(np.abs(reading.values), initial=0.0)), 1e-300)
            for record in self.records
            for output, reading in record.readings.items()
        }

    @cached_property
    def pieces(self) -> dict[tuple[int, str], slice]:
        """Where the readings of each run and output stand in the residual vector."""
        found: dict[tuple[int, str], slice] = {}
        begin = 0
        for record in self.records:
            for output, reading in record.readings.items():
                end = begin + int(np.count_nonzero(reading.used))
                found[record.place, output] = slice(begin, end)
                begin = end
        return found

    def values(self, theta: FloatArray, place: int) -> dict[str, float]:
        """The actuator's parameters as one run has them."""
        found = dict(self.base)
        for unknown, entry in zip(self.unknowns, theta, strict=True):
            if unknown.base in found and unknown.place in (None, place):
                found[unknown.base] = unknown.value(float(entry))
        return found

    def own(self, theta: FloatArray, base: str, place: int) -> float:
        """An observation's value for one run; 0 where it is not free."""
        for unknown, entry in zip(self.unknowns, theta, strict=True):
            if unknown.base == base and unknown.place == place:
                return unknown.value(float(entry))
        return 0.0

    def delay(self, theta: FloatArray, record: Record) -> float:
        """By how much the edges of a run lie after its rows [s]: found here, or by an earlier fit."""
        return self.own(theta, "observation.delay", record.place) if record.delay_is_free else record.known_delay or 0.0

    def start(self, theta: FloatArray, place: int) -> FloatArray:
        """Starting amplitudes of one run; empty for rest."""
        return np.array(
            [
                entry
                for unknown, entry in zip(self.unknowns, theta, strict=True)
                if unknown.nuisance and unknown.place == place
            ]
        )

    def evaluate(self, theta: FloatArray) -> Evaluation:
        """Residuals and Jacobian: the readings of all records, then what is known beforehand."""
        parts = [self._record(record, theta) for record in self.records]
        away = theta - self._centred(theta)
        return Evaluation(
            np.concatenate([*(part[0] for part in parts), self._prior_jacobian @ away]),
            np.concatenate([*(part[1] for part in parts), self._prior_jacobian]),
        )

    def spared(self, theta: FloatArray) -> float:
        """The part of the cost with which delays are drawn to the middle of where their rows confine them.

        There every delay is as likely as another (a rectangular distribution of the same deviation), so within it
        that part is no evidence.
        """
        away = np.abs(self._prior_jacobian @ (theta - self._centred(theta)))
        beyond = np.maximum(away - _RECTANGLE, 0.0)
        return float(away @ away - beyond @ beyond)

    def _centred(self, theta: FloatArray) -> FloatArray:
        centred = theta.copy()
        centred[self._prior_places] = self._prior_centres
        return centred

    def fixed_jacobian(self, theta: FloatArray, names: Sequence[str]) -> FloatArray:
        """Derivatives of the residuals with respect to fixed parameters [per SI unit]."""
        parts = []
        for record in self.records:
            response = self._response(record, theta, names)
            for row, (output, reading) in enumerate(record.readings.items()):
                columns = response.parameters[row] / self.noise[record.place, output]
                if reading.has_bounds:
                    columns[self._quiet(record, output, theta, response.values[row])] = 0.0
                parts.append(columns if reading.complete else columns[reading.used])
        return np.concatenate([*parts, np.zeros((len(self._prior_places), len(names)))])

    def _response(self, record: Record, theta: FloatArray, names: Sequence[str]) -> Response:
        place = record.place
        values, start = self.values(theta, place), self.start(theta, place)
        return self.responder.respond(record, values, names, self.delay(theta, record), start)

    def _sensor(self, record: Record, output: str) -> list[tuple[int, FloatArray | float]]:
        """What the zero and the slope of a sensor add to its readings, for each unit of their entries."""
        found: list[tuple[int, FloatArray | float]] = []
        for column, unknown in enumerate(self.unknowns):
            if unknown.place == record.place and unknown.base == f"observation.offset.{output}":
                found.append((column, unknown.scale))
            elif unknown.place == record.place and unknown.base == f"observation.drift.{output}":
                found.append((column, (record.run.time - record.run.time[0]) * unknown.scale))
        return found

    def _away(self, record: Record, output: str, theta: FloatArray, values: FloatArray) -> FloatArray:
        """Model minus reading, the sensor's own part included [SI]."""
        away = values - record.readings[output].values
        for column, added in self._sensor(record, output):
            away += theta[column] * added
        return away

    def _quiet(self, record: Record, output: str, theta: FloatArray, values: FloatArray) -> Mask:
        """Readings at their range that say nothing here.

        Such a reading is a bound: it counts only while the model is on the wrong side.
        """
        return np.asarray(self._away(record, output, theta, values) * record.readings[output].side > 0)

    def _record(self, record: Record, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Weighted residuals of one run, and their derivatives."""
        own = [(column, u) for column, u in enumerate(self.unknowns) if u.place in (None, record.place)]
        names = list(dict.fromkeys(unknown.base for _, unknown in own if unknown.base in self.base))
        response = self._response(record, theta, names)
        values = self.values(theta, record.place)
        chains = np.zeros((len(names), len(theta)))
        for column, unknown in own:
            if unknown.base in names:
                chains[names.index(unknown.base), column] = unknown.chain(values[unknown.base])
        starts = [column for column, unknown in own if unknown.nuisance]
        delays = [(column, unknown.scale) for column, unknown in own if unknown.base == "observation.delay"]
        residuals, jacobians = [], []
        for row, (output, reading) in enumerate(record.readings.items()):
            sigma = self.noise[record.place, output]
            residual = self._away(record, output, theta, response.values[row]) / sigma
            columns = response.parameters[row] @ (chains / sigma)
            if starts:
                columns[:, starts] = response.states[row] / sigma
            for column, scale in delays:
                columns[:, column] = response.delay[row] * (scale / sigma)
            for column, added in self._sensor(record, output):
                columns[:, column] = added / sigma
            if reading.has_bounds:
                quiet = self._quiet(record, output, theta, response.values[row])
                residual[quiet], columns[quiet] = 0.0, 0.0
            if not reading.complete:
                residual, columns = residual[reading.used], columns[reading.used]
            residuals.append(residual)
            jacobians.append(columns)
        return np.concatenate(residuals), np.concatenate(jacobians)
