"""The least-squares problem of a fit: weighted residuals of every reading, with an exact Jacobian."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identify.observation import Record
from ipmclab.identify.response import Responder
from ipmclab.identify.unknowns import Unknown

FloatArray = npt.NDArray[np.float64]
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
        whole = np.column_stack([self.jacobian, self.residual])
        products = whole.T @ whole
        size = np.sqrt(np.maximum(np.diagonal(products), 1e-300))
        try:
            factor = np.linalg.cholesky(products / np.outer(size, size))
        except np.linalg.LinAlgError:
            factor = np.zeros_like(products)
        if np.min(np.diagonal(factor)) > _WELL_APART:
            return np.asarray(factor.T * size)
        return np.asarray(np.linalg.qr(whole, mode="r"))


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
        parts = [self._record(record, theta, ()) for record in self.records]
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
        parts = [self._record(record, theta, names)[2] for record in self.records]
        return np.concatenate([*parts, np.zeros((len(self._prior_places), len(names)))])

    def _record(
        self, record: Record, theta: FloatArray, fixed: Sequence[str]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        values = self.values(theta, record.place)
        names = tuple(
            dict.fromkeys(u.base for u in self.unknowns if u.base in self.base and u.place in (None, record.place))
        )
        response = self.responder.respond(
            record,
            values,
            (*names, *fixed),
            self.delay(theta, record),
            self.start(theta, record.place),
        )
        residuals, jacobians, fixed_jacobians = [], [], []
        for row, (output, reading) in enumerate(record.readings.items()):
            sigma = self.noise[record.place, output]
            residual = response.values[row] - reading.values
            chains = np.zeros((len(names), len(theta)))
            others: list[tuple[int, FloatArray | float]] = []
            amplitude = 0
            for column, unknown in enumerate(self.unknowns):
                if unknown.place not in (None, record.place):
                    continue
                if unknown.base in names:
                    chains[names.index(unknown.base), column] = unknown.chain(values[unknown.base])
                elif unknown.nuisance:
                    others.append((column, response.states[row, :, amplitude]))
                    amplitude += 1
                elif unknown.base == "observation.delay":
                    others.append((column, response.delay[row] * unknown.scale))
                elif unknown.base == f"observation.offset.{output}":
                    others.append((column, unknown.scale))
                    residual = residual + theta[column] * unknown.scale
                elif unknown.base == f"observation.drift.{output}":
                    ramp = (record.run.time - record.run.time[0]) * unknown.scale
                    others.append((column, ramp))
                    residual = residual + theta[column] * ramp
            columns = response.parameters[row, :, : len(names)] @ (chains / sigma)
            for column, values_there in others:
                columns[:, column] = values_there / sigma
            residual = residual / sigma
            by_fixed = response.parameters[row, :, len(names) :] / sigma
            if reading.has_bounds:
                # A reading at its range is a bound: it counts only while the model is on the wrong side.
                quiet = residual * reading.side > 0
                residual[quiet], columns[quiet], by_fixed[quiet] = 0.0, 0.0, 0.0
            if not reading.complete:
                residual, columns, by_fixed = residual[reading.used], columns[reading.used], by_fixed[reading.used]
            residuals.append(residual)
            jacobians.append(columns)
            fixed_jacobians.append(by_fixed)
        return np.concatenate(residuals), np.concatenate(jacobians), np.concatenate(fixed_jacobians)
