"""A fit with one stage more: quickly, to see what the stage would explain."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from typing import Final

import numpy as np

from ipmclab.errors import IpmclabError
from ipmclab.identification.problem.free import FreeParameters
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import ASSUMED_REST
from ipmclab.identification.problem.response import ActuatorResponder, CircuitResponder
from ipmclab.identification.problem.unknowns import actuator_unknown, amplitudes
from ipmclab.identification.search.descent import HOPE, SHORTLY, on_every_row
from ipmclab.identification.search.pose import entries_at, problem_at, solved_for
from ipmclab.identification.search.settled import settled_to
from ipmclab.identification.search.solve import Solution, minimise
from ipmclab.identification.search.starts.start import starting_points
from ipmclab.model import Actuator
from ipmclab.model.declared import is_held
from ipmclab.model.kinds import kind_named
from ipmclab.model.stages.kind import Trial
from ipmclab.model.variants import with_stages
from ipmclab.run import FloatArray

_EVALUATIONS: Final = 25  # of the model, from the point that a fit has reached: they show what a stage explains
_NEAR: Final = 1e-5  # of the cost
_SETTLED: Final = 0.1  # of a standard error
_SAME: Final = 1e-3  # of the cost: two searches that end so near each other have found one minimum
_AFRESH: Final = 60  # of the model, for the best of the other starts, which is farther away
_STARTS: Final = 3  # the most likely ones


Extended = tuple[Problem, Solution]
"""The problem with one stage more, not whitened, with the weights of the fit without it; near its least squares."""


def from_here(
    problem: Problem, theta: FloatArray, actuator: Actuator, direction: Trial, size: float
) -> Extended | None:
    """Fit again with a stage, from the point that a fit has reached; None where the stage does not go with it.

    Parameters
    ----------
    problem : Problem
        Not whitened.
    theta : float array, shape (n_unknown,)
    actuator : Actuator
        That was fitted, without the stage.
    direction : Trial
    size : float
        The first guess of how much there is of it, in steps along the direction.
    """
    try:
        values = {**actuator.parameter_values, **problem.base}
        richer = with_stages(actuator.replace(**values), direction.stage)
        sized = direction.sized(kind_named(direction.stage), size)
        kept = [column for column, unknown in enumerate(problem.unknowns) if not unknown.is_start]
        unknowns = [problem.unknowns[column] for column in kept]
        entries = [float(theta[column]) for column in kept]
        parameters = richer.replace(**sized).parameters()
        for name in _freed(actuator, richer):
            unknown = actuator_unknown(parameters[name], None)
            unknowns.append(unknown)
            entries.append(unknown.entry(unknown.inside(parameters[name].value)))
        base = {**richer.parameter_values, **values, **sized}
        responder: CircuitResponder | ActuatorResponder = ActuatorResponder(richer)
        if problem.is_circuit and richer.structure.is_lumped:
            responder = CircuitResponder(richer.circuit.branches)
        for record in problem.records:
            if record.start == "free":
                if isinstance(responder, ActuatorResponder):
                    responder.prepare(record, {**base, **problem.values(theta, record.place)})
                unknowns += amplitudes(record.place, responder.amplitudes(record))
        wider = Problem(base, problem.records, unknowns, responder, problem.noise)
        start = np.append(entries, np.zeros(len(unknowns) - len(entries)))
        start = solved_for(wider, start, np.arange(len(unknowns)) >= len(entries))
        found = _briefly(wider, start, _EVALUATIONS)
    except (IpmclabError, ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None
    return (wider, found) if np.isfinite(found.evaluation.cost) else None


def afresh(
    problem: Problem, actuator: Actuator, names: FreeParameters, direction: Trial, known: Extended | None
) -> Extended | None:
    """Fit again with a stage, from what the readings themselves show; None where the stage does not go with it.

    Parameters
    ----------
    problem : Problem
        Not whitened.
    actuator : Actuator
        That was fitted, without the stage.
    names : FreeParameters
        That were free.
    direction : Trial
    known : Extended or None
        What was found from where the fit is: where a start leads there too, no other is asked.
    """
    try:
        richer = with_stages(actuator, direction.stage)
        richer = richer.replace(**direction.sized(kind_named(direction.stage), 1.0))
        wider = replace(names, shared=(*names.shared, *_freed(actuator, richer)))
        # It may be for want of this stage that a start from rest was contradicted.
        records = [
            replace(record, start=ASSUMED_REST)
            if record.start == "free" and record.run.metadata.starts_from_rest is None
            else record
            for record in problem.records
        ]
        tried = []
        least = np.inf if known is None else known[1].evaluation.cost
        for point in islice(starting_points(richer, wider, records), _STARTS):
            own = problem_at(richer, wider, records, point, problem.noise)
            tried.append((own, _briefly(own, entries_at(own, point), SHORTLY)))
            if abs(tried[-1][1].evaluation.cost - least) < _SAME * least:
                return known
        own, lowest = min(tried, key=lambda one: one[1].evaluation.cost)
        if not lowest.evaluation.cost < HOPE * least:
            return known
        if not lowest.converged:
            lowest = _briefly(own, lowest.theta, _AFRESH)
    except (IpmclabError, ArithmeticError, ValueError, np.linalg.LinAlgError):
        return known
    return (own, lowest) if lowest.evaluation.cost < least else known


def _briefly(problem: Problem, theta: FloatArray, evaluations: int) -> Solution:
    """Near the minimum: from means of the rows where these are fewer, and the last step by every row."""
    if problem.on_means is None:
        return minimise(problem, theta, evaluations=evaluations, tolerance=_NEAR)
    near = minimise(problem.on_means, theta, evaluations=evaluations, tolerance=_NEAR)
    return settled_to(problem, on_every_row(problem, near), _SETTLED)[0]


def _freed(actuator: Actuator, richer: Actuator) -> list[str]:
    """The parameters of a stage that are free at a first look."""
    return [name for name in richer.parameter_values if name not in actuator.parameter_values and not is_held(name)]
