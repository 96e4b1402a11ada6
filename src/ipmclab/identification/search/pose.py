"""The least-squares problem of a fit, and its vector, at a starting point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.identification.problem.free import FreeParameters
from ipmclab.identification.problem.problem import Noise, Problem
from ipmclab.identification.problem.record import PreparedRun
from ipmclab.identification.problem.response import ActuatorResponder, CircuitResponder
from ipmclab.identification.problem.unknowns import unknowns_of
from ipmclab.identification.search.starts.start import StartingPoint, allowed
from ipmclab.model import Actuator
from ipmclab.model.kinds import kind_of
from ipmclab.model.structure import Structure
from ipmclab.run import FloatArray


def problem_at(
    actuator: Actuator, names: FreeParameters, records: Sequence[PreparedRun], point: StartingPoint, noise: Noise
) -> Problem:
    """The least-squares problem of a fit, with what a starting point knows of its delays."""
    responder: CircuitResponder | ActuatorResponder
    if actuator.structure.is_lumped and all(set(record.readings) == {"current"} for record in records):
        responder = CircuitResponder(actuator.circuit.branches)
    else:
        responder = ActuatorResponder(actuator)
        near = {**actuator.parameter_values, **allowed(actuator, point.values)}
        for record in records:
            if record.start == "free":
                responder.prepare(record, near)
    states = {record.place: responder.amplitudes(record) for record in records if record.start == "free"}
    unknowns = unknowns_of(names, actuator.parameters(), records, states=states, delays=point.delays)
    need_as_many_readings(len(unknowns), records)
    return Problem(actuator.parameter_values, records, unknowns, responder, noise)


def without_leak(problem: Problem) -> Problem:
    """The problem of a circuit alone where every leak of it is switched off: poles and residues answer at once.

    The problem itself where some leak is left, where more than the current is read, and where a run does not start from
    rest, whose starting state is another.
    """
    free = {unknown.base for unknown in problem.unknowns}
    leaks = 0
    for name, value in problem.base.items():
        if is_size_of_leak(name):
            if value != 0.0 or name in free:
                return problem
            leaks += 1
    only_current = all(set(one.readings) == {"current"} and one.start != "free" for one in problem.records)
    structure = Structure.of(problem.base)
    if not leaks or not only_current or not replace(structure, leak="").is_lumped:
        return problem
    responder = CircuitResponder(structure.branches)
    return Problem(problem.base, problem.records, problem.unknowns, responder, problem.noise)


def is_size_of_leak(name: str) -> bool:
    """Whether a parameter of zero switches a leak off."""
    kind = kind_of(name)
    return kind is not None and kind.one_of == "leak" and kind.ending(name) in kind.off


def need_as_many_readings(unknowns: int, records: Sequence[PreparedRun]) -> None:
    """Refuse, by an ``InputError``, more unknowns than there are usable readings."""
    readings = sum(int(np.count_nonzero(reading.used)) for r in records for reading in r.readings.values())
    if readings < unknowns:
        raise InputError(
            f"{unknowns} unknowns for {readings} usable readings",
            code="more-unknowns-than-data",
            where="free",
            repair="free fewer parameters, or give longer runs",
        )


def entries_at(problem: Problem, point: StartingPoint) -> FloatArray:
    """The vector of a starting point, its linear unknowns solved for."""
    theta = np.zeros(len(problem.unknowns))
    linear = np.zeros(len(theta), dtype=bool)
    for place, unknown in enumerate(problem.unknowns):
        if unknown.base in point.values:
            theta[place] = unknown.entry(unknown.inside(point.values[unknown.base]))
        elif unknown.base == "observation.delay":
            assert unknown.place is not None
            theta[place] = unknown.entry(point.delays[unknown.place].start)
        elif unknown.nuisance and unknown.prior is not None:
            theta[place] = unknown.entry(unknown.value(unknown.prior[0]))
        else:
            linear[place] = True
    return solved_for(problem, theta, linear)


def solved_for(problem: Problem, theta: FloatArray, linear: npt.NDArray[np.bool_]) -> FloatArray:
    """A vector with its linear unknowns solved for, all else being as it is."""
    if not linear.any():
        return theta
    here, found = problem.evaluate(theta), theta.copy()
    found[linear] -= np.linalg.lstsq(here.jacobian[:, linear], here.residual, rcond=1e-12)[0]
    return found
