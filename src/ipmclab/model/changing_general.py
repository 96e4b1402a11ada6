"""A strip of any structure while its environment changes, by matrices: see ``numerics.drifting_loop``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.actuator import Actuator
from ipmclab.model.assemble import System
from ipmclab.model.environment.charge import charged
from ipmclab.model.environment.history import EnvironmentHistory
from ipmclab.model.environment.moved import values_in
from ipmclab.model.environment.panels import Panels
from ipmclab.model.environment.transport import WaterCourse
from ipmclab.model.environment.walk import Way, way_of
from ipmclab.model.numerics.course import Course
from ipmclab.model.numerics.dense import check_solved
from ipmclab.model.numerics.discretise import transitions
from ipmclab.model.numerics.reduce import reduced, seen_states

if TYPE_CHECKING:
    from ipmclab.model.numerics.dense_loop import LawTable
    from ipmclab.model.numerics.drifting_loop import Knots

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

Assembled = Callable[[Mapping[str, float]], System]
"""A function that makes the joined system of a strip of its parameters."""


class Asked(NamedTuple):
    """A record that is asked for.

    Parameters
    ----------
    durations : float array, shape (n_kinds,) [s]
    course : Course
        Of all inputs.
    """

    durations: FloatArray
    course: Course


def way_along(actuator: Actuator, times: FloatArray, history: EnvironmentHistory) -> Way:
    """The way of the water over a record, kept with the actuator."""
    begin, end, leaks = float(times[0]), float(times[-1]), bool(actuator.structure.leak)
    return actuator.keep(
        ("way", begin, end, history.key), lambda: way_of(actuator.parameter_values, history, begin, end, leaks=leaks)
    )


def go_through(
    actuator: Actuator,
    assembled: Assembled,
    asked: Asked,
    state: npt.ArrayLike,
    way: Way,
    values: FloatArray,
) -> WaterCourse:
    """Write the outputs.

    Parameters
    ----------
    assembled : function of a mapping of dotted name to float
        The same whenever there are as many inputs and outputs.
    state : float array, shape (n_states,)
        At the begin.
    values : float array, shape (n_outputs, n_time)
        Written.

    Raises
    ------
    IpmclabError
        The equation of a law has no solution in floating point.
    InputError
        The membrane does not conduct somewhere.
    """
    from ipmclab.model.environment.track_loop import WANTED
    from ipmclab.model.numerics.drifting_loop import Drive, Marching, drifting

    stated = actuator.parameter_values
    kind = len(values), asked.course.start.shape[1]
    key = "drifting", *kind, asked.durations.tobytes(), way.cold, way.warm
    panels = actuator.keep(key, lambda: Panels(stated, way.cold, way.warm, Making(assembled, stated, asked.durations)))
    wanted = float(np.log(way.at_begin.water_content))
    _, (seen, table, _) = panels.at(wanted)
    begun = np.asarray(state, dtype=np.float64)
    if np.any(begun):
        begun = begun * charged(actuator.state_names, values_in(stated, way.at_begin), stated)
    x = begun[seen]
    walk, water = way.set_out()
    laws = np.zeros(2 * len(table.forms))
    march = Marching(x, laws, walk)
    area = sum(abs(part) for _, _, part in actuator.structure.law_ports(stated)) or 1.0
    lengths = asked.durations[asked.course.interval]
    ends = way.begin + np.concatenate([[0.0], np.cumsum(lengths)])
    drive, interval = Drive(asked.course, ends, float(area)), 0
    while interval < len(lengths):
        panel, (_, _, knots) = panels.at(wanted)
        interval, found = drifting(way.track, panel, knots, table, drive, interval, march, water, values)
        if not found:
            check_solved(interval)
        wanted = float(walk[WANTED])
    return way.given.course(water)


class Making:
    """Makes the numbers of ``drifting_loop`` at the states of a panel; states are those that the first panel shows."""

    def __init__(self, assembled: Assembled, stated: Mapping[str, float], durations: FloatArray) -> None:
        self._assembled, self._stated, self._durations = assembled, stated, durations
        self._seen: IndexArray | None = None

    def __call__(self, states: Sequence[Mapping[str, float]]) -> tuple[IndexArray, LawTable, Knots]:
        systems = [self._assembled(there) for there in states]
        systems = [
            _charged(one, charged(one.states, there, self._stated)) for one, there in zip(systems, states, strict=True)
        ]
        every = range(len(systems[0].outputs))
        if self._seen is None:
            self._seen = seen_states(systems, every)
        systems = [reduced(one, every, self._seen) for one in systems]
        return self._seen, *_knots(systems, self._durations)


def _knots(systems: Sequence[System], durations: FloatArray) -> tuple[LawTable, Knots]:
    from ipmclab.model.numerics.dense_loop import law_table
    from ipmclab.model.numerics.drifting_loop import Knots

    count, kinds = len(systems), len(durations)
    move = transitions(systems, durations)
    read = np.array([np.hstack([one.d, one.c]) for one in systems])
    laws = [one.law_ports for one in systems if one.law_ports is not None]
    table, drop = law_table(laws[0].laws if laws else ()), np.zeros((count, kinds + 1, 0, 0))
    ports = np.zeros((count, 0, read.shape[2]))
    if laws:
        ports = np.array([np.hstack([one.d, one.c]) for one in laws])
        read = np.concatenate([read, np.array([one.reach for one in laws])], axis=2)
        loop, of_state = (np.array([getattr(one, name) for one in laws])[:, None] for name in ("loop", "c"))
        drop = -np.concatenate([loop + of_state @ move.law_end, loop], axis=1)
    step = np.concatenate([move.constant, move.slope, move.state, move.law_begin], axis=-1)
    moves = [one.reshape(count, kinds, -1) for one in (step, move.law_end, drop[:, :kinds])]
    reads = [one.reshape(count, -1) for one in (read, ports, drop[:, kinds])]
    each = np.concatenate(moves, axis=2).transpose(1, 0, 2)
    return table, Knots(np.ascontiguousarray(each), np.concatenate(reads, axis=1))


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
