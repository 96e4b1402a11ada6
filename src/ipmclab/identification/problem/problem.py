"""The least-squares problem of a fit: weighted residuals of every reading, with an exact Jacobian."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.means import in_means
from ipmclab.identification.problem.place import Place
from ipmclab.identification.problem.record import LEAST_NOISE, PreparedRun, Reading
from ipmclab.identification.problem.response import CircuitResponder, Responder
from ipmclab.identification.problem.unknowns import WATER, Unknown
from ipmclab.model.declared import is_proportional
from ipmclab.model.environment import sorption
from ipmclab.model.sensitivity import Sensitivities, widened
from ipmclab.progress import tick
from ipmclab.run import FloatArray
from ipmclab.strip_state.in_state import InState, in_state

Mask = npt.NDArray[np.bool_]
Noise = Mapping[tuple[int, str], float]

_RECTANGLE: Final = 3.0**0.5  # half width of a rectangular distribution, in its standard deviations

ROUNDING: Final = 1e-10
"""Part of the largest reading below which noise is not believed."""


class Problem:
    """Residuals of all used readings of all runs.

    Parameters
    ----------
    values : mapping of name to float [SI]
        Every actuator parameter, free or not; the values of free ones are not used.
    records : sequence of PreparedRun
    unknowns : sequence of Unknown
    responder : Responder
    noise : mapping of (place, output) to float [SI]
    """

    def __init__(
        self,
        values: Mapping[str, float],
        records: Sequence[PreparedRun],
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
        self._prior_is_range = np.array([self.unknowns[place].beforehand is None for place, _, _ in priors], dtype=bool)
        self._prior_jacobian = np.zeros((len(priors), len(self.unknowns)))
        places = {unknown.base: place for place, unknown in enumerate(self.unknowns)}
        for row, (place, _, deviation) in enumerate(priors):
            self._prior_jacobian[row, place] = 1.0 / deviation
            for other, (slope, _) in self.unknowns[place].follows.items():
                if other in places:  # else it is held
                    self._prior_jacobian[row, places[other]] = -slope / deviation
        limits = np.array([unknown.limits for unknown in self.unknowns]).reshape(-1, 2)
        self.lower, self.upper = limits[:, 0], limits[:, 1]

    def with_noise(self, noise: Noise) -> Problem:
        """The same problem with other weights."""
        other = copy.copy(self)
        other.noise = dict(noise)  # nothing else depends on it but what was made of it
        other.__dict__.pop("on_means", None)
        return other

    @cached_property
    def on_means(self) -> Problem | None:
        """The same problem on means of the rows, where that is much shorter: a guide for searches, no more."""
        shorter = [in_means(record) for record in self.records]
        if not any(shorter):
            return None
        records = [short or whole for short, whole in zip(shorter, self.records, strict=True)]
        return Problem(self.base, records, self.unknowns, self.responder.for_means(), self.noise)

    @property
    def is_circuit(self) -> bool:
        """Whether it is of a circuit alone, whose runs cost next to nothing."""
        return isinstance(self.responder, CircuitResponder)

    @property
    def plain(self) -> Problem:
        """The problem as its readings are, nothing projected out of them and nothing whitened."""
        return self

    def on(self, plain: Problem) -> Problem:
        """Another problem, of some of the same readings, with what this one does to its rows."""
        return plain

    def without(self, columns: Sequence[int], values: Mapping[str, float]) -> Problem:
        """The problem with fewer unknowns, and other values of what is no longer free."""
        kept = [unknown for column, unknown in enumerate(self.unknowns) if column not in set(columns)]
        return Problem({**self.base, **values}, self.records, kept, self.responder, self.noise)

    def weighed(self, theta: FloatArray, here: Evaluation, noise: Noise) -> Evaluation:  # noqa: ARG002  # what projects rows needs the point
        """An evaluation of this problem as it is under other weights."""
        rows = here.rows.copy()
        for key, piece in self.pieces.items():
            rows[:, piece] *= self.noise[key] / noise[key]
        return Evaluation(rows, here.beforehand)

    @cached_property
    def linear(self) -> Mask:
        """Which unknowns move the residuals in proportion, whatever the others are, and have no bounds.

        What sensors add does, and of a strip whose model is linear its start, and what its stages declare of runs from
        rest: that multiplies a start. Nothing does in a run with a reading that is only a bound, which hangs on where
        the model is.
        """
        bounded = [r.place for r in self.records if any(reading.has_bounds for reading in r.readings.values())]
        moving = [r.place for r in self.records if r.start == "free"]

        def is_linear(one: Unknown) -> bool:
            if any(one.belongs_to(place) for place in bounded):
                return False
            if one.is_of_sensor or not self.responder.is_linear:
                return one.is_of_sensor
            return one.is_start or (is_proportional(one.base) and not any(one.belongs_to(place) for place in moving))

        kinds = np.array([is_linear(one) for one in self.unknowns], dtype=bool)
        return np.asarray(kinds & ~np.isfinite(self.upper - self.lower))

    @cached_property
    def added(self) -> Mask:
        """Which of these add the same wherever the others are: what sensors add."""
        return np.asarray(self.linear & np.array([one.is_of_sensor for one in self.unknowns], dtype=bool))

    @cached_property
    def readings(self) -> dict[tuple[int, str], Reading]:
        """Of each run and output."""
        return {(record.place, output): one for record in self.records for output, one in record.readings.items()}

    @cached_property
    def floors(self) -> dict[tuple[int, str], float]:
        """Noise below which readings cannot be distinguished from the rounding of the model [SI]."""
        return {
            key: max(ROUNDING * float(np.abs(reading.values).max(initial=0.0)), LEAST_NOISE)
            for key, reading in self.readings.items()
        }

    @cached_property
    def pieces(self) -> dict[tuple[int, str], slice]:
        """Where the readings of each run and output stand in the residual vector."""
        counts = [int(np.count_nonzero(reading.used)) for reading in self.readings.values()]
        ends = np.cumsum(counts, dtype=int).tolist()
        return {key: slice(end - count, end) for key, end, count in zip(self.readings, ends, counts, strict=True)}

    @cached_property
    def beforehand(self) -> slice:
        """Where what is known beforehand stands in the residual vector: after all readings."""
        readings = max((piece.stop for piece in self.pieces.values()), default=0)
        return slice(readings, readings + len(self._prior_places))

    @cached_property
    def asked(self) -> tuple[tuple[int, Unknown], ...]:
        """The unknowns that are asked for, and where each stands in the vector: all but starting states and water."""
        return tuple((place, unknown) for place, unknown in enumerate(self.unknowns) if not unknown.nuisance)

    @cached_property
    def places(self) -> dict[int, Place]:
        """Which entries of the vector each run has."""
        return {record.place: Place.of(record, self.unknowns, self.base) for record in self.records}

    def record_at(self, place: int) -> PreparedRun:
        """The run of a place."""
        return next(record for record in self.records if record.place == place)

    def whitened(self, key: tuple[int, str], rows: FloatArray) -> FloatArray:  # noqa: ARG002 - white noise is left alone
        """Rows of one output of one run, shape (n, n_readings), as the noise of this problem weighs them."""
        return rows

    def shift(self, key: tuple[int, str], rows: FloatArray) -> FloatArray:
        """By how much residuals change where readings do: ``rows`` are old less new readings over their noise."""
        return self.whitened(key, rows)

    def squares(self, key: tuple[int, str], residual: FloatArray) -> float:  # noqa: ARG002 - no sensor is known here
        """Sum of the squares that a residual of one output of one run leaves, what is known of its sensor aside."""
        return float(residual @ residual)

    def values(self, theta: FloatArray, place: int) -> dict[str, float]:
        """The actuator's parameters as one run has them, in the state in which its strip was."""
        return self._there(theta, place, ()).values

    def in_reference(self, theta: FloatArray, place: int) -> dict[str, float]:
        """The actuator's parameters for one run as they are in the reference state of its laws."""
        found = dict(self.base)
        for column, unknown in self.places[place].columns:
            found[unknown.base] = unknown.value(float(theta[column]))
        return found

    def _there(self, theta: FloatArray, place: int, names: Sequence[str]) -> InState:
        """The parameters of one run in its state, with derivatives by some of those of the reference state."""
        own, reference = self.places[place], self.in_reference(theta, place)
        if own.state is None:
            return InState(reference, tuple(names), np.eye(len(names)), np.zeros(len(names)), {})
        rates = {unknown.base: unknown.value(float(theta[column])) for column, unknown in own.ages}
        return in_state(reference, own.state, names, water=self.water(theta, place), rates=rates)

    def water(self, theta: FloatArray, place: int) -> float | None:
        """The water content at which a run has its readings; None where it is exact."""
        for column, unknown in self.places[place].waters:
            value = unknown.value(float(theta[column]))
            return value if unknown.base == WATER else float(sorption.water_content(self.base, value / 100.0))
        return None

    def _moved(self, theta: FloatArray, place: int) -> tuple[dict[str, float], Sequence[str], FloatArray]:
        """The parameters of one run [SI], those that move, and their derivatives by the entries of the vector."""
        own, reference = self.places[place], self.in_reference(theta, place)
        if own.state is None:
            chains = np.zeros((len(theta), len(own.names)))
            for number, (column, unknown) in enumerate(own.columns):
                chains[column, number] = unknown.chain(reference[unknown.base])
            return reference, own.names, chains
        there = self._there(theta, place, own.names)
        chains = np.zeros((len(theta), len(there.names)))
        for number, (column, unknown) in enumerate(own.columns):
            chains[column] = unknown.chain(reference[unknown.base]) * there.by[number]
        for column, unknown in own.waters:
            humidity = unknown.value(float(theta[column]))
            steep = 1.0 if unknown.base == WATER else float(sorption.slope(self.base, humidity / 100.0)) / 100.0
            chains[column] = unknown.scale * steep * there.by_water
        for column, unknown in own.ages:
            chains[column] = unknown.scale * there.by_rate[unknown.base]
        return there.values, there.names, chains

    def delay(self, theta: FloatArray, record: PreparedRun) -> float:
        """By how much the edges of a run lie after its rows [s]: found here, or by an earlier fit."""
        if not record.delay_is_free:
            return record.known_delay or 0.0
        return sum(unknown.value(float(theta[column])) for column, unknown in self.places[record.place].delays)

    def start(self, theta: FloatArray, place: int) -> FloatArray:
        """Starting amplitudes of one run; empty for rest."""
        return theta[self.places[place].starts]

    def evaluate(self, theta: FloatArray) -> Evaluation:
        """Residuals and Jacobian: the readings of all records, then what is known beforehand."""
        tick()
        rows = np.empty((len(theta) + 1, self.beforehand.stop))
        # A search may try values at which the model overflows: it steps back from what is not finite.
        with np.errstate(over="ignore", invalid="ignore"):
            for record in self.records:
                self._fill(rows, record, theta)
        rows[:-1, self.beforehand] = self._prior_jacobian.T
        rows[-1, self.beforehand] = self._from_beforehand(theta)
        return Evaluation(rows, len(self._prior_places))

    def outputs(self, theta: FloatArray, record: PreparedRun) -> FloatArray:
        """The outputs of one run in the order of its readings, without derivatives, shape (n_outputs, n_time) [SI]."""
        return self._response(record, self.values(theta, record.place), theta, ()).values

    def spared(self, theta: FloatArray) -> float:
        """The part of the cost with which delays and sensors are drawn to the middle of where rows confine them.

        There every value is as likely as another (a rectangular distribution of the same deviation), so within it
        that part is no evidence.
        """
        away = np.abs(self._from_beforehand(theta)[self._prior_is_range])
        beyond = np.maximum(away - _RECTANGLE, 0.0)
        return float(away @ away - beyond @ beyond)

    def from_priors(self, theta: FloatArray) -> FloatArray:
        """How far each unknown is from what was known beforehand, in its standard deviations; without ranges.

        Of one vector, or of many with that axis first.
        """
        return np.asarray(self._from_beforehand(theta)[..., ~self._prior_is_range])

    def _from_beforehand(self, theta: FloatArray) -> FloatArray:
        away = np.zeros(theta.shape)
        away[..., self._prior_places] = theta[..., self._prior_places] - self._prior_centres
        return np.asarray(away @ self._prior_jacobian.T)

    def fixed_jacobian(self, theta: FloatArray, names: Sequence[str]) -> FloatArray:
        """Derivatives of the residuals with respect to fixed parameters [per SI unit]."""
        parts = []
        for record in self.records:
            there = self._there(theta, record.place, names)
            response = self._response(record, there.values, theta, there.names)
            for row, (output, reading) in enumerate(record.readings.items()):
                moved = response.parameters[row] if record.state is None else response.parameters[row] @ there.by.T
                columns = moved / self.noise[record.place, output]
                if reading.has_bounds:
                    columns[self._quiet(record, output, theta, response.values[row])] = 0.0
                parts.append(columns if reading.complete else columns[reading.used])
        return np.concatenate([*parts, np.zeros((len(self._prior_places), len(names)))])

    def _response(
        self, record: PreparedRun, values: Mapping[str, float], theta: FloatArray, names: Sequence[str]
    ) -> Sensitivities:
        delay, start = self.delay(theta, record), self.start(theta, record.place)
        return self.responder.respond(record, values, names, delay, start)

    def away(self, record: PreparedRun, output: str, theta: FloatArray, values: FloatArray) -> FloatArray:
        """Model minus reading, the sensor's own part included [SI]; of many vectors with that axis first."""
        return self.with_sensor(record.place, output, theta, values - record.readings[output].values)

    def with_sensor(self, place: int, output: str, theta: FloatArray, values: FloatArray) -> FloatArray:
        """Values [SI] to which what the zero and the slope of a sensor add to its readings in one run is added."""
        for column, added in self.places[place].sensors[output]:
            values += theta[..., column, None] * added
        return values

    def _quiet(self, record: PreparedRun, output: str, theta: FloatArray, values: FloatArray) -> Mask:
        """Readings that are bounds to which the model keeps: they say nothing."""
        return np.asarray(self.away(record, output, theta, values) * record.readings[output].side > 0)

    def _fill(self, rows: FloatArray, record: PreparedRun, theta: FloatArray) -> None:
        """Write the weighted residuals of one run, and their derivatives, into the rows of an evaluation."""
        own = self.places[record.place]
        values, names, chains = self._moved(theta, record.place)
        response = self._response(record, values, theta, names)
        for row, (output, reading) in enumerate(record.readings.items()):
            sigma = self.noise[record.place, output]
            place = rows[:, self.pieces[record.place, output]]
            found = place if reading.complete else np.empty((len(rows), len(reading.values)))
            weights = chains @ response.by_parameters[row]
            if own.starts or own.delays:
                weights = widened(weights, response.courses.shape[1])
                by_states = response.by_states[row]
                weights[own.starts, : by_states.shape[1]] = by_states
                for column, unknown in own.delays:
                    weights[column] = response.by_delay[row] * unknown.scale
            response.summed(weights / sigma, row, found[:-1])
            for column, added in own.sensors[output]:
                found[column] = added / sigma
            found[-1] = self.away(record, output, theta, response.values[row]) / sigma
            if reading.has_bounds:
                found[:, self._quiet(record, output, theta, response.values[row])] = 0.0
            if reading.weights is not None:
                found *= reading.weights
            if not reading.complete:
                place[:] = found[:, reading.used]
