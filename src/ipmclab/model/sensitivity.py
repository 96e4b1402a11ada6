"""Outputs at the rows of a record with their exact derivatives: what identification needs."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.actuator import Actuator
from ipmclab.model.joined import Joined
from ipmclab.model.numerics.dense import law_parts
from ipmclab.model.numerics.tangents import Scratch, Shape, moves, outputs_along, tangents
from ipmclab.model.numerics.tangents_modal import Modes, Slopes, modal_tangents
from ipmclab.model.numerics.timeline import Timeline, divided, period_of, timeline
from ipmclab.model.ports import OUTPUTS, choose_outputs
from ipmclab.model.request import check_hold, checked_record, state_vector
from ipmclab.model.stages.laser import Laser
from ipmclab.run import Hold

if TYPE_CHECKING:
    from ipmclab.model.numerics.moved_loop import Matrices

FloatArray = npt.NDArray[np.float64]

_POINTS: Final = 8  # runs that differ in a parameter or in their outputs each have one
_LINES: Final = 16
_LOST: Final = 1e-8  # of the sum of what its modes answer: how far an output by modes lies from that by steps


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

    The stages, the exponential of the joined system and the recursion over the rows are differentiated operation by
    operation, the equations of the laws by the implicit function theorem. Where poles lie apart, a linear system goes
    by them; no pole is needed, so that equal poles are no exception. At the threshold of a law, where it has a kink,
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
    chosen = choose_outputs(outputs)
    kept = Kept() if kept is None else kept
    line = kept.line(time, voltage, hold, delay, from_rest=initial_state is None, leaks=bool(actuator.structure.leak))
    point = kept.point(actuator, tuple(names), tuple(chosen), asked)
    state = state_vector(point.joined.states, initial_state)[point.joined.seen]
    found = _by_modes(point, line, state, asked)
    if found is None:
        found = _by_matrices(point, line, state, kept)
    if len(state) < len(point.joined.states):
        by_states = np.zeros((len(found.values), len(point.joined.states), found.by_states.shape[2]))
        by_states[:, point.joined.seen] = found.by_states
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
        self._scratch: tuple[Shape, Scratch] | None = None
        self._records: dict[tuple[int, int], tuple[object, object, FloatArray, FloatArray, float]] = {}
        self._lines: dict[tuple[object, ...], Timeline] = {}
        self._middles: dict[tuple[object, ...], Timeline] = {}

    def line(
        self,
        time: npt.ArrayLike,
        voltage: npt.ArrayLike,
        hold: Hold,
        delay: float,
        *,
        from_rest: bool,
        leaks: bool,
    ) -> Timeline:
        """The time line of a record, divided where something leaks; while the arrays are the same objects, it is kept.

        Raises
        ------
        InputError
            Time that does not increase, unequal lengths, a voltage that is not finite.
        """
        key = id(time), id(voltage), hold, delay, from_rest, leaks
        if key not in self._lines:
            line = self._laid(time, voltage, hold, delay, from_rest)
            if leaks:
                count = law_parts(line.durations)
                if self._by_rows:
                    rows = self._record(time, voltage)[0]
                    count = np.minimum(count, law_parts(np.diff(rows).min(keepdims=True)))
                line = divided(line, count)
            if len(self._lines) >= _LINES:
                self._lines.clear()
            self._lines[key] = line
        return self._lines[key]

    def _laid(self, time: npt.ArrayLike, voltage: npt.ArrayLike, hold: Hold, delay: float, from_rest: bool) -> Timeline:
        """The time line of a record, from that of edges in the middle between rows, where these come to no row."""
        times, volts, period = self._record(time, voltage)

        def laid(later: float) -> Timeline:
            return timeline(times, volts, hold, delay=later, from_rest=from_rest, period=period)

        if delay == 0.0 or hold == "first" or not math.isfinite(delay):
            return laid(delay)
        middle = (math.floor(delay / period) + 0.5) * period
        key = id(time), id(voltage), hold, middle, from_rest
        if key not in self._middles:
            if len(self._middles) >= _LINES:
                self._middles.clear()
            self._middles[key] = laid(middle)
        return self._middles[key].delayed(delay - middle) or laid(delay)

    def _record(self, time: npt.ArrayLike, voltage: npt.ArrayLike) -> tuple[FloatArray, FloatArray, float]:
        """The times [s] of a record, its voltage [V] and its period [s]: a search moves its edges again and again."""
        key = id(time), id(voltage)
        if key not in self._records:
            times, volts = checked_record(time, voltage)
            if len(self._records) >= _LINES:
                self._records.clear()
                self._lines.clear()
                self._middles.clear()
            # The arrays are held, so that nothing else can take their identity.
            self._records[key] = time, voltage, times, volts, period_of(times)
        return self._records[key][2:]

    def point(
        self, actuator: Actuator, names: tuple[str, ...], chosen: tuple[int, ...], asked: Collection[str]
    ) -> _Point:
        """The system of an actuator and its derivatives."""
        key = tuple(actuator.parameter_values.items()), names, chosen, *sorted(asked)
        if key not in self._points:
            if len(self._points) >= _POINTS:
                self._points.clear()
            self._points[key] = _Point(Joined.of(actuator, names, chosen, asked))
        return self._points[key]

    def scratch(self, shape: Shape) -> Scratch:
        """What the loops write on; the latest is kept."""
        if self._scratch is None or self._scratch[0] != shape:
            self._scratch = shape, Scratch.of(shape)
        return self._scratch[1]


class _Point:
    """The system at some parameters with its derivatives, and what was worked out of it so far."""

    def __init__(self, joined: Joined) -> None:
        self.joined = joined
        self._moves: tuple[object, tuple[Matrices, Matrices]] | None = None

    @cached_property
    def modes(self) -> Modes | None:
        """The modes; None with laws at ports, and where poles lie too close together."""
        if len(self.joined.forms):
            return None
        at, by = self.joined.at, self.joined.by
        d_a, d_drive, d_read, *_ = (np.moveaxis(one[..., : self.joined.count], -1, 0) for one in by)
        given = (at.a, at.drive[:, 0], at.outputs[:, 1:], at.outputs[:, 0])
        return Modes.of(Slopes(*given, d_a, d_drive[..., 0], d_read[..., 1:], d_read[..., 0]))

    def moves(self, durations: FloatArray, *, moved: bool) -> tuple[Matrices, Matrices]:
        """``tangents.moves``"""
        key = durations.tobytes(), moved
        if self._moves is None or self._moves[0] != key:
            self._moves = key, moves(self.joined, durations, moved=moved)
        return self._moves[1]


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


def _by_modes(point: _Point, line: Timeline, state: FloatArray, asked: Collection[str]) -> Sensitivities | None:
    if point.modes is None:
        return None
    at, _ = point.moves(line.durations, moved=False)
    wanted = {"by_states": "states" in asked, "by_delay": "delay" in asked}
    found = modal_tangents(point.modes, line, state, **wanted)
    # The outputs themselves are those of every other way; for them alone it is as fast.
    values = outputs_along(at, line, state)
    # These must be the modes of this very matrix: where one small entry is all that drives a force, it may be rounding.
    lost = np.abs(found.values - values).max(axis=1, initial=0.0)
    if not np.all(lost <= _LOST * found.sizes):
        return None
    courses, by_delay = found.courses, found.by_delay
    if by_delay is None:
        by_delay = np.zeros((len(values), len(courses)))
        if "delay" in asked:
            courses = np.concatenate([courses, _delay(point, at, line)])
            by_delay = np.hstack([by_delay, np.eye(len(values))])
    return Sensitivities(values, courses[None], found.by_parameters, found.by_initial, by_delay)


def _delay(point: _Point, at: Matrices, line: Timeline) -> FloatArray:
    """The derivative of the outputs by the delay."""
    from ipmclab.model.numerics import kernels

    moving: list[Any] = [line.interval, line.rate, line.jump, line.read_before_jump, line.row, line.reading_rate]
    move = at.step[:, :, 2:], at.step[:, :, 0]
    read = point.joined.at.drive[:, 0], at.outputs[:, 1:], at.outputs[:, 0]
    before, behind = ([np.ascontiguousarray(one) for one in some] for some in (move, read))
    by_delay = np.zeros((len(at.outputs), len(line.reading)))
    kernels.dense_delay(*[*before, *moving, *behind, by_delay])
    return by_delay


def _by_matrices(point: _Point, line: Timeline, state: FloatArray, kept: Kept) -> Sensitivities:
    joined = point.joined
    sizes = len(line.durations), len(state), len(joined.at.outputs), len(joined.forms), joined.width
    scratch = kept.scratch((*sizes, len(line.reading), len(line.interval)))
    values, derivatives = tangents(joined, point.moves(line.durations, moved=True), line, state, scratch)
    alone, count = _alone(len(values), joined.columns), joined.count
    by_states = (
        alone[:, count : count + joined.by_states] if joined.by_states else np.zeros((len(values), len(state), 0))
    )
    by_delay = alone[:, -1] if joined.by_delay else np.zeros((len(values), joined.columns))
    return Sensitivities(values, derivatives.transpose(0, 2, 1), alone[:, :count, :count], by_states, by_delay)


@lru_cache(maxsize=64)
def _alone(outputs: int, columns: int) -> FloatArray:
    """How much of each column is in each, for every output."""
    return np.broadcast_to(np.eye(columns), (outputs, columns, columns))


def widened(by: FloatArray, columns: int) -> FloatArray:
    """The same with a longer last axis, 0 behind what is there."""
    wide = np.zeros((*by.shape[:-1], columns))
    wide[..., : by.shape[-1]] = by
    return wide
