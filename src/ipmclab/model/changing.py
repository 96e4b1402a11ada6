"""What outputs read while the environment changes: parameters that drift, and a state that goes on.

Parameters are constant in pieces, and renewed long before any has moved by 0.2 %: half of that would be seen in a
reading. What goes on where they are renewed is the charge of each capacitor, not its voltage.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.actuator import Actuator
from ipmclab.model.assemble import System
from ipmclab.model.environment.history import EnvironmentHistory
from ipmclab.model.environment.laws import moved_values
from ipmclab.model.environment.path import Grid, apart, path_of, pieces_along, stations_of
from ipmclab.model.environment.transport import WaterCourse, curl_displacement, water_course
from ipmclab.model.numerics.course import Course, voltage_course
from ipmclab.model.numerics.dense import check_solved, law_numbers, parts
from ipmclab.model.numerics.discretise import transitions
from ipmclab.model.numerics.reduce import reduced, seen_states
from ipmclab.model.numerics.timeline import divided, is_regular, side_by_side, timeline
from ipmclab.model.ports import INPUTS, OUTPUTS
from ipmclab.model.request import checked_force, checked_record, state_vector
from ipmclab.model.stages.laser import read_far
from ipmclab.model.stages.leak import Leak
from ipmclab.run import Hold

if TYPE_CHECKING:
    from ipmclab.model.numerics.dense_laws_loop import LawTable
    from ipmclab.model.numerics.drifting_loop import Knots, Way
    from ipmclab.model.numerics.drifting_modal_loop import Pieces

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

_SAME_WATER: Final = 2e-5
"""Part by which a parameter may move when what leaks is known better, without another pass."""

_MOST_PASSES: Final = 8
_QUIET: Final = 0.99
"""Part of the onset of a leak up to which rows show that nothing leaks between them either."""
_LEAK_PARTS: Final = 64

_BRANCH: Final = re.compile(r"(?:^|\.)branches\.(\d+)\.voltage$")


class Changing(NamedTuple):
    """What a changing environment does to the outputs.

    Parameters
    ----------
    values : float array, shape (n_outputs, n_time) [SI]
    water : WaterCourse
    """

    values: FloatArray
    water: WaterCourse


class Asked(NamedTuple):
    """A record that is asked for.

    Parameters
    ----------
    durations : float array, shape (n_kinds,) [s]
    course : Course
        Of all inputs.
    ends : float array, shape (n_intervals,) [s]
        When each interval ends.
    begin, end : float [s]
        Of the rows.
    """

    durations: FloatArray
    course: Course
    ends: FloatArray
    begin: float
    end: float


def changing_outputs(
    actuator: Actuator,
    time: npt.ArrayLike,
    voltage: npt.ArrayLike,
    hold: Hold,
    history: EnvironmentHistory,
    *,
    initial_state: Mapping[str, float] | npt.ArrayLike | None = None,
    external_force: npt.ArrayLike | None = None,
) -> Changing:
    """What the outputs read at the rows of a record while the environment changes.

    What leaks splits water, which changes what leaks: such a record is gone through until both agree.

    Parameters
    ----------
    actuator : Actuator
        With a table ``[hydration]``.
    history : EnvironmentHistory
        Its time 0 is that of the record.

    The other parameters are those of ``outputs.simulate_outputs``.
    """
    times, volts = checked_record(time, voltage)
    values = np.empty((len(OUTPUTS), len(times)))
    simple = initial_state is None and external_force is None and is_regular(times)
    water = _fast(actuator, times, volts, hold, history, values) if simple else None
    if water is None:
        force = None if external_force is None else checked_force(external_force, len(times))
        inputs = INPUTS[: 1 if force is None else 2]
        asked = _asked(actuator.driven_by(inputs), times, volts, hold, force, from_rest=initial_state is None)
        state = state_vector(actuator.state_names, initial_state)
        water = _go_through(actuator, inputs, asked, state, history, values)
    stated = actuator.parameter_values
    if stated["hydration.linear_swelling"]:
        values[OUTPUTS.index("displacement")] += curl_displacement(stated, water.gradients(times))
    read_far(values, OUTPUTS, stated)
    return Changing(values, water)


def _fast(
    actuator: Actuator,
    times: FloatArray,
    volts: FloatArray,
    hold: Hold,
    history: EnvironmentHistory,
    values: FloatArray,
) -> WaterCourse | None:
    """Write the outputs by modes; None where another way must answer: another structure, or a strip that leaks."""
    from ipmclab.model.numerics.drifting_modal_loop import drifting_modal

    onset = _onset(actuator)
    if onset == 0.0:
        return None
    strip = actuator if onset is None else actuator.keep("without leak", lambda: _without_leak(actuator))
    kept = _kept_pieces(strip, times, hold, history)
    if kept is None:
        return None
    pieces, water = kept
    drifting_modal(volts, pieces, values)
    # A law that gives nothing at the voltages that come is none; a record may end between two rows.
    quiet = onset is None or np.abs(values[OUTPUTS.index("applied_voltage")]).max() < _QUIET * onset
    return water if quiet else None


def _onset(actuator: Actuator) -> float | None:
    """The voltage [V] behind the electrodes from which on something leaks; None of a strip without a leak."""
    structure = actuator.structure
    if not structure.leak:
        return None
    return Leak(structure.leak, slow=structure.slow_leak).onset(actuator.parameter_values)


def _without_leak(actuator: Actuator) -> Actuator:
    kept = {name: value for name, value in actuator.parameter_values.items() if not name.startswith("leak.")}
    return replace(actuator, parameter_values=kept, standard_uncertainties={}, fit_table=None)


def _kept_pieces(
    actuator: Actuator, times: FloatArray, hold: Hold, history: EnvironmentHistory
) -> tuple[Pieces, WaterCourse] | None:
    """The modes of a linear strip over a record, kept with the actuator; None where another way must answer."""
    begin, end = float(times[0]), float(times[-1])
    period = (end - begin) / (len(times) - 1)

    def made() -> tuple[Pieces, WaterCourse] | None:
        from ipmclab.model.numerics.drifting_modal import numbers_at, pieces_between

        water = _water(actuator, history, begin, end, None)
        path = path_of(actuator.parameter_values, water, begin, end)
        grid, found = path.grid(actuator.parameter_values), []
        for values in _values_at(actuator, grid):
            blocks = actuator.blocks(values)
            scale = _scale(actuator, [name for block in blocks for name in block.states], values)
            own = numbers_at(blocks, scale, period, hold)
            if own is None:
                return None
            found.append(own)
        _, first, weights = pieces_along(path, water, grid, times + 0.5 * period)
        pieces = pieces_between(np.array(found), weights, np.append(first, len(times)))
        return None if pieces is None else (pieces, water)

    return actuator.keep(("changing", begin, len(times), period, hold, history.key), made)


def _asked(
    system: System, times: FloatArray, volts: FloatArray, hold: Hold, force: FloatArray | None, *, from_rest: bool
) -> Asked:
    period = float(times[-1] - times[0]) / (len(times) - 1)
    if force is None and from_rest and is_regular(times) and parts(system, np.array([period]))[0] == 1:
        before, after = volts[:-1], volts[1:]
        start, end = (after if hold == "zero-before" else before), (before if hold == "zero" else after)
        kind, row = np.zeros(len(before), dtype=np.int64), np.arange(len(volts), dtype=np.int64)
        course, durations = voltage_course(kind, start, end, row, volts), np.array([period])
    else:
        each = [volts] if force is None else [volts, force]
        lines = [timeline(times, one, hold, delay=0.0, from_rest=from_rest) for one in each]
        lines = [divided(line, parts(system, line.durations)) for line in lines]
        course, durations = side_by_side(lines), lines[0].durations
    ends = times[0] + np.cumsum(durations[course.interval])
    return Asked(durations, course, ends, float(times[0]), float(times[-1]))


def _go_through(
    actuator: Actuator,
    inputs: Sequence[str],
    asked: Asked,
    state: FloatArray,
    history: EnvironmentHistory,
    values: FloatArray,
) -> WaterCourse:
    """Write the outputs; return the course of the water."""
    begin, end = asked.begin, asked.end
    water = _water(actuator, history, begin, end, None)
    for _ in range(_MOST_PASSES):
        leaked = _pass(actuator, inputs, asked, state, water, values)
        if not actuator.structure.leak:
            break
        flowing = _density(actuator, asked, leaked)
        water, before = _water(actuator, history, begin, end, flowing), water
        if apart(actuator.parameter_values, water, before, begin, end) <= _SAME_WATER:
            break
    return water


def _pass(
    actuator: Actuator,
    inputs: Sequence[str],
    asked: Asked,
    state: FloatArray,
    water: WaterCourse,
    values: FloatArray,
) -> FloatArray:
    """Write the outputs; return what leaks at the end of each interval [A]."""
    from ipmclab.model.numerics.drifting_loop import drifting

    knots, way, table, seen, scale = _worked_out(actuator, inputs, asked, water)
    leaked, x = np.zeros(len(way.piece)), (state * scale)[seen]
    check_solved(drifting(knots, way, table, asked.course, x, values, leaked))
    return leaked


def _worked_out(
    actuator: Actuator, inputs: Sequence[str], asked: Asked, water: WaterCourse
) -> tuple[Knots, Way, LawTable, IndexArray, FloatArray]:
    """Systems, the way between them, laws, the states that are seen, and how much charge each state is at first."""
    from ipmclab.model.numerics.drifting_loop import Knots, Way

    def made() -> tuple[Knots, Way, LawTable, IndexArray, FloatArray]:
        path = path_of(actuator.parameter_values, water, asked.begin, asked.end)
        grid = path.grid(actuator.parameter_values)
        systems, scales = [], []
        for there in _values_at(actuator, grid):
            system = actuator.assembled(there, inputs=inputs)
            scales.append(_scale(actuator, system.states, there))
            systems.append(_charged(system, scales[-1]))
        every = range(len(OUTPUTS))
        seen = seen_states(systems, every)
        middles = asked.ends - 0.5 * asked.durations[asked.course.interval]
        piece, _, weights = pieces_along(path, water, grid, middles)
        stations, share = stations_of(actuator.parameter_values, grid, weights)
        found, table = _knots([reduced(system, every, seen) for system in systems], asked.durations)
        knots = Knots(*(np.tensordot(weights[stations], one, 1) for one in found))
        at_first = grid.weights(path.contents[:1], path.temperatures[:1])[0]
        knot = np.searchsorted(stations, np.arange(len(weights)), side="right") - 1
        return knots, Way(piece, knot, share), table, seen, at_first @ np.array(scales)

    course = water.water_content.tobytes(), water.temperature.tobytes(), water.time.tobytes()
    when = asked.ends.tobytes(), asked.course.interval.tobytes(), asked.begin
    return actuator.keep(("drifting", *inputs, *(hash(one) for one in (*course, *when))), made)


def _knots(systems: Sequence[System], durations: FloatArray) -> tuple[Knots, LawTable]:
    from ipmclab.model.numerics.dense_laws_loop import LawTable
    from ipmclab.model.numerics.drifting_loop import Knots

    count, kinds = len(systems), len(durations)
    move = transitions(systems, durations)
    read = np.array([np.hstack([one.d, one.c]) for one in systems])
    laws = [law_numbers(one, move.law_end[k]) for k, one in enumerate(systems) if one.law_ports is not None]
    if laws:
        table = LawTable(laws[0].forms, laws[0].coefficients)
        drop = np.array([one.drop for one in laws])
        ports = np.array([np.hstack([one.ports[1], one.ports[0]]) for one in laws])
        read = np.concatenate([read, np.array([one.reach for one in laws])], axis=2)
    else:
        table = LawTable(np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
        drop, ports = np.zeros((count, kinds + 1, 0, 0)), np.zeros((count, 0, read.shape[2]))
    step = np.concatenate([move.constant, move.slope, move.state, move.law_begin], axis=-1)
    return Knots(np.ascontiguousarray(step), np.ascontiguousarray(move.law_end), drop, read, ports), table


def _water(
    actuator: Actuator, history: EnvironmentHistory, begin: float, end: float, leak: FloatArray | None
) -> WaterCourse:
    """From time 0 of the history, or the begin of the record where that is before it, to its end."""
    zero, start = min(0.0, begin), history.start

    def made() -> WaterCourse:
        return water_course(actuator.parameter_values, history, end - zero, start=start, begin=zero, leak=leak)

    return made() if leak is not None else actuator.keep(("water", begin, end, history.key), made)


def _values_at(actuator: Actuator, grid: Grid) -> list[dict[str, float]]:
    """The parameters at the points of a grid, all worked out at once."""
    contents, temperatures = grid.states
    moved = moved_values(actuator.parameter_values, contents, temperatures)
    every = {name: np.broadcast_to(np.asarray(value, dtype=np.float64), len(contents)) for name, value in moved.items()}
    return [{name: float(value[k]) for name, value in every.items()} for k in range(len(contents))]


def _charged(system: System, scale: FloatArray) -> System:
    """The system with charges as its states."""
    ports = system.law_ports
    return replace(
        system,
        a=system.a * scale[:, None] / scale,
        b=system.b * scale[:, None],
        c=system.c / scale,
        law_ports=None if ports is None else replace(ports, drive=ports.drive * scale[:, None], c=ports.c / scale),
    )


def _scale(actuator: Actuator, states: Sequence[str], values: Mapping[str, float]) -> FloatArray:
    """How many times each state is the charge that it was in the state of reference."""
    return charges(states, values) / charges(states, actuator.parameter_values)


def charges(states: Sequence[str], values: Mapping[str, float]) -> FloatArray:
    """What a state is multiplied by to be a charge of its capacitor, up to an area; 1 for other states.

    Examples
    --------
    >>> names = ("circuit.branches.0.voltage", "beam.displacement")
    >>> charges(names, {"circuit.branches.0.permittivity": 0.3, "geometry.thickness": 0.001}).tolist()
    [300.0, 1.0]
    """
    found = np.ones(len(states))
    for place, name in enumerate(states):
        match = _BRANCH.search(name)
        if match:
            permittivity = values[f"circuit.branches.{match[1]}.permittivity"]
            found[place] = permittivity / values["geometry.thickness"]
    return found


def _density(actuator: Actuator, asked: Asked, leaked: FloatArray) -> FloatArray:
    """Times, and the current density that leaks from each on [A/m^2]: means over parts of the record."""
    ends, begin = asked.ends, asked.begin
    edges = np.unique(np.linspace(0, len(ends), min(len(ends), _LEAK_PARTS) + 1).astype(np.int64))
    lengths = np.diff(ends, prepend=begin)
    area = sum(abs(part) for _, _, part in actuator.structure.law_ports(actuator.parameter_values))
    spans = np.add.reduceat(lengths, edges[:-1])
    means = np.add.reduceat(leaked * lengths, edges[:-1]) / spans / area
    times = np.concatenate([[begin], ends[edges[1:-1] - 1]])
    if begin > 0.0:  # nothing leaks before the record
        times, means = np.insert(times, 0, 0.0), np.insert(means, 0, 0.0)
    return np.vstack([times, means])
