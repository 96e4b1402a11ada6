"""Which entries of the vector of a fit say something of one run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ipmclab.identification.problem.record import PreparedRun
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.model.environment.age import AGE
from ipmclab.run import FloatArray
from ipmclab.strip_state.run_state import RunState


@dataclass(frozen=True, eq=False)
class Place:
    """Which entries of the vector one run has, and what they are.

    Parameters
    ----------
    names : list of str
        Actuator parameters that are free in this run.
    columns : list of (int, Unknown)
        Their entries, in the same order.
    starts : list of int
        Entries of its start.
    delays : list of (int, Unknown)
        The entry of its delay, where that is free.
    waters : list of (int, Unknown)
        The entry of its water content, where that is not exact.
    ages : list of (int, Unknown)
        Entries of how fast parameters age.
    sensors : mapping of output to list of (int, float or float array)
        Entries of the zero and the slope of a sensor, and what they add to its readings for each unit.
    state : RunState or None
        In which its strip was.
    """

    names: list[str]
    columns: list[tuple[int, Unknown]]
    starts: list[int]
    delays: list[tuple[int, Unknown]]
    waters: list[tuple[int, Unknown]]
    ages: list[tuple[int, Unknown]]
    sensors: Mapping[str, list[tuple[int, FloatArray | float]]]
    state: RunState | None

    @classmethod
    def of(cls, record: PreparedRun, unknowns: Sequence[Unknown], base: Mapping[str, float]) -> Place:
        """The entries of one run; ``base`` has the parameters of the actuator."""
        own = [(column, u) for column, u in enumerate(unknowns) if u.belongs_to(record.place)]
        columns = [(column, unknown) for column, unknown in own if unknown.base in base]
        sensors: dict[str, list[tuple[int, FloatArray | float]]] = {output: [] for output in record.readings}
        for column, unknown in own:
            if unknown.is_of_sensor:
                what, output = unknown.base.split(".")[1:]
                since = record.run.time - record.run.time[0] if what == "drift" else 1.0
                sensors[output].append((column, since * unknown.scale))
        return cls(
            names=[unknown.base for _, unknown in columns],
            columns=columns,
            starts=[column for column, unknown in own if unknown.is_start],
            delays=[(column, unknown) for column, unknown in own if unknown.base == "observation.delay"],
            waters=[(column, unknown) for column, unknown in own if unknown.is_water],
            ages=[(column, unknown) for column, unknown in own if unknown.base.startswith(AGE)],
            sensors=sensors,
            state=record.state,
        )
