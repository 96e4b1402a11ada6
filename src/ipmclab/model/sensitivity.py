"""Outputs at the rows of a record with their exact derivatives: what identification needs."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.actuator import Actuator
from ipmclab.model.assemble import System, one_by_one
from ipmclab.model.blocks import Matrix
from ipmclab.model.numerics.dense import check_solved, law_numbers, parts
from ipmclab.model.numerics.discretise import Transition, transitions
from ipmclab.model.numerics.reduce import reduced, seen_states
from ipmclab.model.numerics.tangents_modal import Modes, Slopes, modal_tangents
from ipmclab.model.numerics.timeline import Timeline, divided, timeline
from ipmclab.model.ports import OUTPUTS, choose_outputs
from ipmclab.model.request import check_hold, checked_record, state_vector
from ipmclab.model.stages.laser import Laser
from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]

_COMPLEX_STEP: Final = 1e-100
"""So small that its square vanishes beside any number here: Im f(p + ih)/h is then f'(p) to the last digit."""

_POINTS: Final = 8  # runs that differ in a parameter or in their outputs each have one
_LINES: Final = 16

_MOST_EXPONENTIALS: Final = 4096
"""Matrix exponentials taken at once: a record with an irregular clock has as many as rows for each parameter."""


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Outputs and their derivatives, in SI units.

    Every derivative of an output is a sum of the same few courses over time, each times a number. Who needs sums of
    derivatives adds those numbers first, and goes over the rows once.

    Parameters
    ----------
    values : float array, shape (n_outputs, n_time)
    courses : float array, shape (1 or n_outputs, n_courses, n_time)
        Those of all outputs, or of each its own.
    by_parameters : float array, shape (n_outputs, n_names, n_first)
        How much of the first courses, or of all, is in the derivative by each named parameter.
    by_states : float array, shape (n_outputs, n_states, n_first)
        In that by each initial state, in the order of ``actuator.state_names``.
    by_delay : float array, shape (n_outputs, n_courses)
        In that by the delay. Where an edge falls on a row, the jump of the reading itself has no derivative and is
        left out.
    """

    values: FloatArray
    courses: FloatArray
    by_parameters: FloatArray
    by_states: FloatArray
    by_delay: FloatArray

    @cached_property
    def parameters(self) -> FloatArray:
        """Derivatives by each named parameter, shape (n_outputs, n_time, n_names)."""
        return (self.by_parameters @ self.courses[:, : self.by_parameters.shape[2]]).transpose(0, 2, 1)

    @cached_property
    def states(self) -> FloatArray:
        """Derivatives by each initial state, shape (n_outputs, n_time, n_states)."""
        return (self.by_states @ self.courses[:, : self.by_states.shape[2]]).transpose(0, 2, 1)

    @cached_property
    def delay(self) -> FloatArray:
        """Derivatives by the delay, shape (n_outputs, n_time)."""
        return (self.by_delay[:, None] @ self.courses)[:, 0]

    def summed(self, weights: FloatArray, row: int, out: FloatArray) -> None:
        """Write sums of the first courses of an output, shape (n_sums, n_time), by how much of each is in each sum."""
        np.matmul(weights, self.courses[row if len(self.courses) > 1 else 0, : weights.shape[1]], out=out)


def sensitivities(
    actuator: Actuator,
    names: Sequence[str],
    time: npt.ArrayLike,
    voltage: npt.ArrayLike,
    hold: Hold,
    *,
    outputs: Sequence[str] | None = None,
    initial_state: Mapping[str, float] | npt.ArrayLike | None = None,
    delay: float = 0.0,
    asked: Collection[str] = ("states", "delay"),
    kept: Kept | None = None,
) -> Sensitivities:
    """Outputs at the rows of a record, with exact derivatives by parameters, initial states and delay.

    The derivatives of the discretised matrices are taken by a complex step through the stages and
    the matrix exponential; they are carried along with the state, and through the equations of the laws.
    No pole is computed, so that equal poles are no exception. At the threshold of a law, where it has a kink,
    the derivative is that above it.

    Parameters
    ----------
    names : sequence of str
        Dotted names of parameters.
    asked : collection of "states" and "delay"
        What is wanted beside the parameters; the derivatives that are not are zero.
    kept : Kept, optional
        What an earlier call worked out and this one can use.

    The other parameters are those of ``outputs.simulate_outputs``.

    Returns
    -------
    sensitivities : Sensitivities

    Raises
    ------
    InputError
        As ``simulate_outputs``, and for an unknown parameter.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> actuator = load_actuator("friend-2")
    >>> slope = sensitivities(actuator, ["coupling.gain"], [0, 0.02, 0.04], [1, 1, 1], "zero", outputs=["force"])
    >>> bool(abs(slope.parameters[0, 2, 0] * actuator["coupling.gain"] / slope.values[0, 2] - 1) < 1e-12)
    True
    """
    check_hold(hold)
    times, volts = checked_record(time, voltage)
    chosen = choose_outputs(outputs)
    kept = Kept() if kept is None else kept
    line = kept.line(times, volts, hold, delay, from_rest=initial_state is None)
    state = state_vector(actuator.state_names, initial_state)
    line = divided(line, kept.parts(actuator.system, line.durations, times))
    point = kept.point(actuator, tuple(names), tuple(chosen))
    seen = point.seen
    found = _by_modes(point, line, state[seen], asked)
    if found is None:
        solve = _linear if point.system.law_ports is None else _with_laws
        found = solve(
            point.system, point.stepped, point.moves_over(line.durations), line, state[seen], len(times), asked
        )
    if len(seen) < len(state):
        by_states = np.zeros((len(found.values), len(state), found.by_states.shape[2]))
        by_states[:, seen] = found.by_states
        found = replace(found, by_states=by_states)
    return _before_laser(found, actuator, names, [OUTPUTS[place] for place in chosen])


class Kept:
    """What calls of ``sensitivities`` have in common: runs share their parameters, and a run keeps its time line.

    It holds the latest of each only, and is for one thread.

    Parameters
    ----------
    by_rows : bool
        Divide no interval into more parts than the shortest between two rows: for records whose rows lie ever farther
        apart as they change ever less.
    """

    def __init__(self, *, by_rows: bool = False) -> None:
        self._by_rows = by_rows
        self._points: dict[tuple[object, ...], _Point] = {}
        self._lines: dict[tuple[object, ...], tuple[FloatArray, FloatArray, Timeline]] = {}

    def parts(self, system: System, durations: FloatArray, times: FloatArray) -> npt.NDArray[np.int64]:
        """Into how many parts the intervals of each kind are divided."""
        found = parts(system, durations)
        return np.minimum(found, parts(system, np.diff(times).min(keepdims=True))) if self._by_rows else found

    def line(self, times: FloatArray, volts: FloatArray, hold: Hold, delay: float, *, from_rest: bool) -> Timeline:
        """The time line of a record; while the arrays are the same objects, it is kept."""
        key = id(times), id(volts), hold, delay, from_rest
        if key not in self._lines:
            if len(self._lines) >= _LINES:
                self._lines.clear()
            # The arrays are held, so that nothing else can take their identity.
            self._lines[key] = times, volts, timeline(times, volts, hold, delay=delay, from_rest=from_rest)
        return self._lines[key][2]

    def point(self, actuator: Actuator, names: tuple[str, ...], chosen: tuple[int, ...]) -> _Point:
        """The systems of an actuator and of each parameter's derivative."""
        key = tuple(actuator.parameter_values.items()), names, chosen
        if key not in self._points:
            if len(self._points) >= _POINTS:
                self._points.clear()
            self._points[key] = _Point.of(actuator, names, chosen)
        return self._points[key]


@dataclass(frozen=True, eq=False)
class _Point:
    """The system at some parameters, those of the derivatives, and the transitions worked out so far.

    Parameters
    ----------
    system : System
    others : tuple of System
        Each parameter's complex step: one system with an axis of parameters first, or one for each.
    count : int
        How many parameters.
    seen : int array
        The states that are left.
    moves : dict
        By the durations of intervals.
    """

    system: System
    others: tuple[System, ...]
    count: int
    seen: npt.NDArray[np.int64]
    moves: dict[bytes, _Moves]

    @classmethod
    def of(cls, actuator: Actuator, names: Sequence[str], chosen: Sequence[int]) -> _Point:
        system = actuator.system
        values: dict[str, Any] = dict(actuator.parameter_values)
        if actuator.structure.takes_arrays:
            for place, name in enumerate(names):
                values[name] = np.full(len(names), complex(actuator[name]))
                values[name][place] = complex(actuator[name], _COMPLEX_STEP)
            others = [actuator.assembled(values)]
        else:
            others = [actuator.assembled({**values, name: complex(actuator[name], _COMPLEX_STEP)}) for name in names]
        seen = seen_states([system, *others], chosen)
        own, *rest = (reduced(each, chosen, seen) for each in (system, *others))
        return cls(own, tuple(rest), len(names), seen, {})

    @cached_property
    def stepped(self) -> tuple[System, ...]:
        """The system of each parameter's complex step."""
        return one_by_one(self.others[0], self.count) if len(self.others) == 1 else self.others

    @cached_property
    def modes(self) -> Modes | None:
        """The modes; None with laws at ports, and where poles lie too close together."""
        if self.system.law_ports is not None:
            return None
        at = self.system
        a, b, c, d = (self._slopes(name) for name in ("a", "b", "c", "d"))
        return Modes.of(Slopes(at.a, at.b[:, 0], at.c, at.d[:, 0], a, b[..., 0], c, d[..., 0]))

    def _slopes(self, name: str) -> FloatArray:
        """The derivatives of a matrix, one parameter after another."""
        matrices = [getattr(one, name) for one in self.others]
        joined = np.stack(matrices) if len(matrices) > 1 else matrices[0] if matrices else getattr(self.system, name)
        return np.imag(np.broadcast_to(joined, (self.count, *joined.shape[-2:]))) / _COMPLEX_STEP

    def moves_over(self, durations: FloatArray) -> _Moves:
        key = durations.tobytes()
        if key not in self.moves:
            self.moves.clear()
            self.moves[key] = _Moves(self, durations)
        return self.moves[key]


def _before_laser(
    found: Sensitivities, actuator: Actuator, names: Sequence[str], outputs: Sequence[str]
) -> Sensitivities:
    """With what a laser reads in place of the displacement, where the strip stands before one, and its derivatives."""
    if not actuator.structure.laser or "displacement" not in outputs:
        return found
    row = outputs.index("displacement")
    reading = Laser().reading(found.values[row], actuator.parameter_values)
    found.values[row] = reading.values
    courses = np.zeros((len(outputs), 1 + found.courses.shape[1], found.values.shape[1]))
    courses[:, 1:] = found.courses
    courses[row, 1:] *= reading.by_displacement
    courses[row, 0] = reading.by_sensing_length
    by_parameters, by_states, by_delay = (
        np.concatenate([np.zeros_like(by[..., :1]), by], axis=-1)
        for by in (found.by_parameters, widened(found.by_states, found.courses.shape[1]), found.by_delay)
    )
    for place in (place for place, name in enumerate(names) if name == "geometry.sensing_length"):
        by_parameters[row, place, 0] = 1.0
    return Sensitivities(found.values, courses, by_parameters, by_states, by_delay)


@dataclass(frozen=True, eq=False)
class _Moves:
    """What intervals of some durations do, and its derivatives."""

    point: _Point
    durations: FloatArray

    @cached_property
    def at(self) -> tuple[FloatArray, ...]:
        """The matrices of the transitions, one kind of interval after another."""
        return tuple(
            np.ascontiguousarray(matrix[0]) for matrix in _parts(transitions([self.point.system], self.durations))
        )

    @cached_property
    def by(self) -> tuple[FloatArray, ...]:
        """Their derivatives by each parameter, along a last axis."""
        by = tuple(np.empty((*matrix.shape, len(self.point.stepped))) for matrix in self.at)
        at_once = max(1, _MOST_EXPONENTIALS // len(self.durations))
        for first in range(0, len(self.point.stepped), at_once):
            some = slice(first, first + at_once)
            moves = _parts(transitions(self.point.stepped[some], self.durations))
            for target, matrix in zip(by, moves, strict=True):
                target[..., some] = np.moveaxis(matrix.imag, 0, -1) / _COMPLEX_STEP
        return by


def _parts(move: Transition) -> tuple[Matrix, ...]:
    return move.state, move.constant[..., 0], move.slope[..., 0], move.law_begin, move.law_end


def _slopes(matrices: Sequence[Matrix], shape: tuple[int, ...]) -> FloatArray:
    """Derivatives of a matrix, one parameter each, along a last axis."""
    if not matrices:
        return np.zeros((*shape, 0))
    return np.ascontiguousarray(np.stack([np.imag(matrix) for matrix in matrices], axis=-1) / _COMPLEX_STEP)


def _by_modes(point: _Point, line: Timeline, state: FloatArray, asked: Collection[str]) -> Sensitivities | None:
    from ipmclab.model.numerics import kernels

    if point.modes is None:
        return None
    system, at = point.system, point.moves_over(line.durations).at
    courses, by_parameters, by_states = modal_tangents(point.modes, line, state, by_states="states" in asked)
    # The outputs themselves are those of every other way, to the last digit; for them alone it is as fast.
    values = np.empty((len(system.c), len(line.reading)))
    step = np.concatenate([at[1][..., None], at[2][..., None], at[0]], axis=-1)
    kernels.dense(step, np.hstack([system.d, system.c]), line.course, state.copy(), values)
    by_delay = np.zeros((len(values), len(courses)))
    if "delay" in asked:
        courses = np.concatenate([courses, _delay(system, at[:2], line)])
        by_delay = np.hstack([by_delay, np.eye(len(values))])
    return Sensitivities(values, courses[None], by_parameters, by_states, by_delay)


def _delay(system: System, move: Sequence[FloatArray], line: Timeline) -> FloatArray:
    """The derivative of the outputs by the delay; of the move, what it does to a state and to a constant voltage."""
    from ipmclab.model.numerics import kernels

    moving: list[Any] = [line.interval, line.rate, line.jump, line.read_before_jump, line.row, line.reading_rate]
    matrices: list[Any] = [np.ascontiguousarray(one) for one in (*move, system.b[:, 0], system.c, system.d[:, 0])]
    by_delay = np.zeros((len(system.c), len(line.reading)))
    kernels.dense_delay(*[*matrices[:2], *moving, *matrices[2:], by_delay])
    return by_delay


def _linear(
    system: System,
    stepped: Sequence[System],
    moves: _Moves,
    line: Timeline,
    state: FloatArray,
    rows: int,
    asked: Collection[str],
) -> Sensitivities:
    from ipmclab.model.numerics import kernels

    n, count = len(state), len(stepped)
    c, d = np.ascontiguousarray(system.c), np.ascontiguousarray(system.d[:, 0])
    d_c = _slopes([at.c for at in stepped], c.shape)
    d_d = _slopes([at.d[:, 0] for at in stepped], d.shape)
    by_states = n if "states" in asked else 0
    tangents = np.hstack([np.zeros((n, count)), np.eye(n)[:, :by_states]])
    values = np.empty((len(c), rows))
    derivatives = np.empty((len(c), rows, count + by_states))
    along: list[Any] = [*moves.at[:3], *moves.by[:3], line.interval, line.start, line.end, line.row, line.reading]
    kernels.dense_tangents(*[*along, c, d, d_c, d_d, state, tangents, values, derivatives])
    by_delay = _delay(system, moves.at[:2], line) if "delay" in asked else np.zeros_like(values)
    return _each(values, np.concatenate([derivatives, by_delay[..., None]], axis=2), count, n, asked)


def _each(
    values: FloatArray, derivatives: FloatArray, count: int, states: int, asked: Collection[str]
) -> Sensitivities:
    """Of derivatives by parameters, initial states where asked, and delay, shape (n_outputs, n_time, n_columns)."""
    alone = np.broadcast_to(np.eye(derivatives.shape[2]), (len(values), *[derivatives.shape[2]] * 2))
    by_states = alone[:, count:-1] if "states" in asked else np.zeros((len(values), states, 0))
    by_delay = alone[:, -1] if "delay" in asked else np.zeros_like(alone[:, -1])
    return Sensitivities(values, derivatives.transpose(0, 2, 1), alone[:, :count, :count], by_states, by_delay)


def _with_laws(
    system: System,
    stepped: Sequence[System],
    moves: _Moves,
    line: Timeline,
    state: FloatArray,
    rows: int,
    asked: Collection[str],
) -> Sensitivities:
    from ipmclab.model.numerics.dense_laws_loop import LawTable
    from ipmclab.model.numerics.tangents_loop import Later, Readings, Slopes, Steps, dense_laws_tangents

    n, count = len(state), len(stepped)
    by_states = n if "states" in asked else 0
    columns = count + by_states + 1
    laws = law_numbers(system, moves.at[4])
    ports = [at.law_ports for at in (system, *stepped) if at.law_ports is not None]
    coefficients = [np.array([law.coefficients for law in at.laws]) for at in ports]
    read = [np.hstack([at.d, at.c, port.reach]) for at, port in zip((system, *stepped), ports, strict=True)]
    seen = [np.hstack([port.d, port.c, port.loop]) for port in ports]
    by_step = np.concatenate([moves.by[1][:, :, None], moves.by[2][:, :, None], moves.by[0], moves.by[3]], axis=2)
    by = Slopes(
        step=_side_by_side(by_step, columns),
        law_end=_side_by_side(moves.by[4], columns),
        outputs=_side_by_side(_slopes(read[1:], read[0].shape), columns),
        ports=_side_by_side(_slopes(seen[1:], seen[0].shape), columns),
        coefficients=widened(_slopes(coefficients[1:], laws.coefficients.shape), columns),
    )
    constant, slope = moves.at[1][..., None], moves.at[2][..., None]
    steps = Steps(np.concatenate([constant, slope, moves.at[0], moves.at[3]], axis=-1), moves.at[4], laws.drop)
    readings = Readings(np.ascontiguousarray(read[0]), np.hstack(laws.ports[::-1]))
    flow = np.hstack([system.b, system.a, ports[0].drive])
    later = Later(line.durations, line.rate, line.reading_rate, line.arrives, line.leaves, flow)
    tangents = np.hstack([np.zeros((n, count)), np.eye(n)[:, :by_states], np.zeros((n, 1))])
    values, derivatives = np.empty((len(system.c), rows)), np.empty((len(system.c), rows, columns))
    table = LawTable(laws.forms, laws.coefficients)
    check_solved(
        dense_laws_tangents(
            steps, readings, table, by, line.course, later, np.ascontiguousarray(state), tangents, values, derivatives
        )
    )
    return _each(values, derivatives, count, n, asked)


def widened(by: FloatArray, columns: int) -> FloatArray:
    """The same with a longer last axis, 0 behind what is there."""
    wide = np.zeros((*by.shape[:-1], columns))
    wide[..., : by.shape[-1]] = by
    return wide


def _side_by_side(by: FloatArray, columns: int) -> FloatArray:
    """Derivatives of a matrix, shape (..., rows, entries, n_parameters), as (..., entries, rows * columns)."""
    wide = np.moveaxis(widened(by, columns), -3, -2)
    return np.ascontiguousarray(wide).reshape(*wide.shape[:-2], -1)
