"""What an actuator answers to a run, with exact derivatives: the circuit alone, or the whole actuator."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from ipmclab.identification.problem.record import PreparedRun, drive, model_hold
from ipmclab.model import Actuator
from ipmclab.model.admittance import Admittance, Admittances, Elements, admittance, admittances, capacitor_voltages
from ipmclab.model.batch import Batch, Record
from ipmclab.model.batch_lanes import lanes_of
from ipmclab.model.numerics.drive import respond
from ipmclab.model.numerics.poles_loop import pole_values
from ipmclab.model.sensitivity import Kept, Sensitivities, sensitivities
from ipmclab.model.stages.circuit import CONTACT, Circuit
from ipmclab.run import FloatArray


class Responder(Protocol):
    """Computes a run's outputs and their derivatives."""

    @property
    def is_linear(self) -> bool:
        """Whether outputs are linear in the voltage and in where a run starts."""

    def for_means(self) -> Responder:
        """The same for means of the rows, with nothing kept of these."""

    def amplitudes(self, record: PreparedRun) -> int:
        """How many starting amplitudes a run with a free start has."""

    def start_columns(self, record: PreparedRun, values: Mapping[str, float], delay: float) -> FloatArray:
        """How the outputs of a run at rest would change with its start, shape (n_output, n_time, n_column)."""

    def initial_state(self, record: PreparedRun, values: Mapping[str, float], start: FloatArray) -> dict[str, float]:
        """The states of the actuator that starting amplitudes stand for [SI]."""

    def respond(
        self, record: PreparedRun, values: Mapping[str, float], names: Sequence[str], delay: float, start: FloatArray
    ) -> Sensitivities:
        """The outputs of one run, in the order of its readings; its states are the amplitudes of its start."""

    def respond_many(
        self, record: PreparedRun, values: Mapping[str, Any], count: int, delay: float
    ) -> FloatArray | None:
        """The outputs of a run that begins at rest, without derivatives, of many strips side by side.

        Parameters
        ----------
        record : PreparedRun
        values : mapping of name to float, or float array of shape (count,) [SI]
        count : int
        delay : float [s]

        Returns
        -------
        outputs : float array, shape (count, n_outputs, n_time) [SI]
            In the order of its readings. None where these strips go one by one.
        """


def lumped(branches: int, values: Mapping[str, float], series: float = 0.0) -> Elements:
    """The elements of a circuit in numbers, with a further series resistance."""
    parts = Circuit(branches).elements(values)
    return Elements(
        parts.series.real + series,
        parts.dc.real,
        np.array([resistance.real for resistance in parts.branch_resistances]),
        np.array([capacitance.real for capacitance in parts.branch_capacitances]),
    )


def circuits(branches: int, values: Mapping[str, Any], count: int, series: float) -> Admittances:
    """Poles and residues of many circuits, whose parameters are numbers or arrays, behind a series resistance."""
    parts = Circuit(branches).elements(values)
    first, leak, *others = (
        np.ascontiguousarray(np.broadcast_to(np.real(one), count))
        for one in (parts.series, parts.dc, *parts.branch_resistances, *parts.branch_capacitances)
    )
    resistances, capacitances = (np.stack(ones, axis=1) for ones in (others[:branches], others[branches:]))
    return admittances(first + series, leak, resistances, capacitances)


def lumped_derivatives(branches: int, values: Mapping[str, Any], names: Sequence[str]) -> FloatArray:
    """Derivatives of (series, log R_dc, log R_i, log C_i) with respect to parameters, by complex step.

    Shape (2 + 2 n_branch, n_name); of many circuits, whose parameters ``names`` are arrays, with that axis first.
    """
    if not names:
        return np.zeros((2 + 2 * branches, 0))
    given = np.stack([values[name] for name in names], axis=-1)
    steps = 1e-30 * np.maximum(np.abs(given), 1e-12)
    # All steps at once: each parameter is an array that has moved in its own column only.
    each = given[..., None] + 1j * np.eye(len(names)) * steps[..., None]
    moved = {**values, **{name: each[..., column, :] for column, name in enumerate(names)}}
    parts = Circuit(branches).elements(moved)
    elements = np.empty((*steps.shape[:-1], 2 + 2 * branches, len(names)), dtype=np.complex128)
    for row, element in enumerate([parts.series, parts.dc, *parts.branch_resistances, *parts.branch_capacitances]):
        elements[..., row, :] = element
    columns: FloatArray = elements.imag / steps[..., None, :]
    columns[..., 1:, :] /= elements.real[..., 1:, :]
    return columns


class CircuitResponder:
    """Current alone, from poles and residues. A start that is not rest is an amplitude of each mode [A]."""

    is_linear = True

    def __init__(self, branches: int) -> None:
        self.branches = branches
        # The latest answers are kept: runs share their circuit, and a point is often asked again for other names.
        self._admittances: dict[object, tuple[Admittance, FloatArray]] = {}
        self._chains: dict[object, FloatArray] = {}
        self._moved: dict[int, tuple[object, FloatArray]] = {}

    def _circuit(
        self, record: PreparedRun, values: Mapping[str, float], names: Sequence[str]
    ) -> tuple[Admittance, FloatArray]:
        """Poles and residues, and the derivatives of (direct, residues, poles) with respect to the parameters."""
        point = tuple(values.values())
        behind, asked = (record.series_resistance, point), (tuple(names), point)
        if len(self._admittances) + len(self._chains) > 16:
            self._admittances.clear()
            self._chains.clear()
        if behind not in self._admittances:
            self._admittances[behind] = admittance(lumped(self.branches, values, record.series_resistance))
        if asked not in self._chains:
            self._chains[asked] = lumped_derivatives(self.branches, values, names)
        fractions, derivatives = self._admittances[behind]
        return fractions, derivatives @ self._chains[asked]

    def _courses(self, record: PreparedRun, poles: FloatArray, delay: float) -> FloatArray:
        """The voltage as it is read, what each pole answers to it, and the slopes of that by the pole."""
        key = (poles.tobytes(), delay, record.start)
        kept = self._moved.get(record.place)
        if kept is None or kept[0] != key:
            given = drive(record, delay)
            courses = np.empty((1 + 2 * len(poles), len(given.present)))
            courses[0] = given.present
            respond(given, poles, courses[1 : 1 + len(poles)], courses[1 + len(poles) :])
            kept = self._moved[record.place] = key, courses
        return kept[1]

    def for_means(self) -> CircuitResponder:
        """One that has seen no rows."""
        return CircuitResponder(self.branches)

    def amplitudes(self, record: PreparedRun) -> int:  # noqa: ARG002  # the protocol's signature
        """One for each pole."""
        return self.branches

    def start_columns(self, record: PreparedRun, values: Mapping[str, float], delay: float) -> FloatArray:  # noqa: ARG002
        """The decay of each mode."""
        poles = admittance(lumped(self.branches, values, record.series_resistance))[0].poles
        return np.exp(np.outer(record.run.time - record.run.time[0], poles))[None]

    def initial_state(self, record: PreparedRun, values: Mapping[str, float], start: FloatArray) -> dict[str, float]:
        """Capacitor voltages [V]."""
        voltages = capacitor_voltages(lumped(self.branches, values, record.series_resistance), start)
        return dict(zip(Circuit(self.branches).state_names, map(float, voltages), strict=True))

    def respond(
        self, record: PreparedRun, values: Mapping[str, float], names: Sequence[str], delay: float, start: FloatArray
    ) -> Sensitivities:
        """Current and its derivatives."""
        fractions, derivatives = self._circuit(record, values, names)
        courses, count = self._courses(record, fractions.poles, delay), self.branches
        current = fractions.direct * courses[0] + fractions.residues @ courses[1 : 1 + count]
        by_names = derivatives.T.copy()
        by_names[:, 1 + count :] *= fractions.residues
        # A response shifts with its edges, dx/dd = -dx/dt, but not with the start of a record that was not at rest.
        by_delay = np.concatenate([[-fractions.residues.sum()], -fractions.residues * fractions.poles, np.zeros(count)])
        by_start = np.zeros((0, 1 + 2 * count))
        if record.start == "free":
            free = start if len(start) else np.zeros(count)
            since = record.run.time - record.run.time[0]
            decay = np.exp(np.outer(fractions.poles, since))
            current += free @ decay
            courses = np.concatenate([courses, decay, since * decay])
            by_names = np.hstack([by_names, np.zeros((len(names), count)), derivatives[1 + count :].T * free])
            by_delay = np.concatenate([by_delay, record.run.voltage[0] * fractions.residues, np.zeros(count)])
            by_start = np.eye(len(courses))[1 + 2 * count : 1 + 3 * count]
        return Sensitivities(current[None], courses[None], by_names[None], by_start[None], by_delay[None])

    def respond_many(self, record: PreparedRun, values: Mapping[str, Any], count: int, delay: float) -> FloatArray:
        """Currents: the poles of all circuits go through one loop."""
        fractions = circuits(self.branches, values, count, record.series_resistance)
        given = drive(record, delay)
        answers = np.empty((fractions.poles.size, len(given.kind) + 1))
        pole_values(given.durations, given.kind, given.start, given.end, fractions.poles.ravel(), answers)
        if given.rows is not None:
            answers = answers[:, given.rows]
        currents = fractions.residues[:, None, :] @ answers.reshape(count, self.branches, -1)
        currents += fractions.direct[:, None, None] * given.present
        return currents


class ActuatorResponder:
    """Any outputs, through the assembled actuator. A start that is not rest is a set of states.

    Parameters
    ----------
    actuator : Actuator
    of_means : bool
        For means of rows, whose lengths follow how fast the strip still changes.
    """

    def __init__(self, actuator: Actuator, *, of_means: bool = False) -> None:
        self._actuator = actuator
        # Directions of the starting state that the readings can see, shape (n_states, n_amplitude), by the place.
        self._bases: dict[int, FloatArray] = {}
        self._latest: tuple[object, Actuator] | None = None
        self._kept = Kept(by_rows=of_means)

    @property
    def is_linear(self) -> bool:
        """Without a leak, and without a laser that a strip far bent leaves."""
        return self._actuator.structure.is_linear

    def for_means(self) -> ActuatorResponder:
        """One that has seen no rows; starts are told in the same directions."""
        other = ActuatorResponder(self._actuator, of_means=True)
        other._bases = self._bases
        return other

    def amplitudes(self, record: PreparedRun) -> int:
        """As many as the readings of this run can tell apart."""
        return int(self._bases[record.place].shape[1])

    def prepare(self, record: PreparedRun, values: Mapping[str, float]) -> None:
        """Choose the basis of a run with a free start, for parameters near the final ones."""
        states = self.start_columns(record, values, 0.0)
        readings = zip(states, record.readings.values(), strict=True)
        weighted = np.concatenate([own[reading.exact] / max(reading.noise, 1e-300) for own, reading in readings])
        _, singular, directions = np.linalg.svd(weighted, full_matrices=False)
        kept = singular > 1e-6 * singular[0]
        self._bases[record.place] = directions[kept].T / singular[kept] * np.sqrt(len(weighted))

    def start_columns(self, record: PreparedRun, values: Mapping[str, float], delay: float) -> FloatArray:
        """The response to each state."""
        rest = np.zeros(len(self._actuator.state_names))
        return self._sensitivities(record, values, (), delay, rest, asked=("states",)).states

    def initial_state(self, record: PreparedRun, values: Mapping[str, float], start: FloatArray) -> dict[str, float]:  # noqa: ARG002
        """The states that the readings can see; the others as small as they can be."""
        state = self._bases[record.place] @ start
        return dict(zip(self._actuator.state_names, map(float, state), strict=True))

    def respond(
        self, record: PreparedRun, values: Mapping[str, float], names: Sequence[str], delay: float, start: FloatArray
    ) -> Sensitivities:
        """Outputs and their derivatives."""
        basis = self._bases.get(record.place) if record.start == "free" else None
        state = None if basis is None else basis @ start if len(start) else np.zeros(len(basis))
        asked = [*(["states"] if basis is not None else []), *(["delay"] if record.delay_is_free else [])]
        found = self._sensitivities(record, values, names, delay, state, asked=asked)
        return replace(found, by_states=found.by_states[:, :0] if basis is None else basis.T @ found.by_states)

    def respond_many(
        self, record: PreparedRun, values: Mapping[str, Any], count: int, delay: float
    ) -> FloatArray | None:
        """Outputs through the lanes of ``simulate_many``, where it has some and the rows are regular."""
        if delay or not record.run.is_uniform:
            return None
        other = {name: value for name, value in values.items() if np.ndim(value) or value != self._actuator[name]}
        if record.series_resistance:
            other[CONTACT] = values[CONTACT] + record.series_resistance
        changes = {name: np.full(count, value) for name, value in other.items()}
        time = record.run.time
        rows = Record(time, time[-1] - time[0], (len(time) - 1) / (time[-1] - time[0]), model_hold(record))
        batch = Batch(self._actuator, count, changes, rows, record.run.voltage[None], tuple(record.readings))
        lanes = lanes_of(batch)
        if lanes is None:
            return None
        found = np.empty((count, len(record.readings), len(time)))
        lanes.outputs(batch.voltage, found)
        return found

    def _sensitivities(
        self,
        record: PreparedRun,
        values: Mapping[str, float],
        names: Sequence[str],
        delay: float,
        state: FloatArray | None,
        *,
        asked: Collection[str],
    ) -> Sensitivities:
        return sensitivities(
            self._at(values, record.series_resistance),
            tuple(names),
            record.run.time,
            record.run.voltage,
            model_hold(record),
            outputs=tuple(record.readings),
            initial_state=state,
            delay=delay,
            asked=asked,
            kept=self._kept,
        )

    def _at(self, values: Mapping[str, float], series_resistance: float) -> Actuator:
        """The actuator with some parameters; the latest is kept, which runs share."""
        key = tuple(values.values()), series_resistance
        if self._latest is None or self._latest[0] != key:
            changes = {name: value for name, value in values.items() if value != self._actuator[name]}
            if series_resistance:
                changes[CONTACT] = values[CONTACT] + series_resistance
            self._latest = key, self._actuator.replace(**changes)
        return self._latest[1]
