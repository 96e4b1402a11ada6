"""Fits with a weakly seen parameter held: along the valley where it lies, and at the value of the actuator's file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.fit.fit import DETERMINED
from ipmclab.identification.problem.free import FreeParameters
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.response import CircuitResponder
from ipmclab.identification.search.as_good import AS_GOOD
from ipmclab.identification.search.solve import Pinned, Solution, entry_errors, minimise, polish
from ipmclab.identification.search.starts.start import fastest_rate, leak_shares, other_zeros
from ipmclab.identification.search.valleys import Place, branch_valley
from ipmclab.model import Actuator
from ipmclab.model.declared import is_of_circuit
from ipmclab.model.stages.circuit import DC, SERIES
from ipmclab.model.stages.coupling import GAIN, ZERO
from ipmclab.model.stages.leak import SLOW_TIME

FloatArray = npt.NDArray[np.float64]

_WEAK: Final = 0.2  # standard error of a logarithm from which other valleys are looked for
_SLOWER: Final = (0.2, 0.4, 0.7, 1.4, 2.5, 4.5, 8.0)  # times the time constant of a leak that hardly shows how slow


def along_valleys(actuator: Actuator, names: FreeParameters, problem: Problem, solution: Solution) -> list[Place]:
    """The best fits with a weakly seen parameter held at other values.

    A record that is short for the slowest branch does not tell it from the leak, and one that is slow for the zero of
    the coupling does not tell it from the gain. At either end of such a valley the curvature shows a parameter as
    known that is not.
    """
    values = problem.values(solution.theta, problem.records[0].place)
    errors = dict(zip((u.name for u in problem.unknowns), entry_errors(solution.evaluation), strict=True))
    found: list[Place] = []
    circuit = max((error for name, error in errors.items() if is_of_circuit(name)), default=0.0)
    if circuit > _WEAK and not set(SERIES) & set(names.actuator):
        shares = leak_shares(actuator, values)
        if set(shares[0]) <= set(names.shared):
            found += held_at(problem, solution, DC, shares)
    if {GAIN, ZERO} <= set(names.shared) and errors[ZERO] > _WEAK:
        found += held_at(problem, solution, ZERO, other_zeros(values, problem.records))
    slow = SLOW_TIME
    if slow in names.shared and errors[slow] > _WEAK:
        found += held_at(problem, solution, slow, [{slow: values[slow] * factor} for factor in _SLOWER])
    if isinstance(problem.responder, CircuitResponder):
        found += branch_valley(problem, solution)
    return found


def held_at(problem: Problem, solution: Solution, name: str, points: Sequence[Mapping[str, float]]) -> list[Place]:
    held = [unknown.name for unknown in problem.unknowns].index(name)
    found = []
    for point in points:
        theta = solution.theta.copy()
        for place, unknown in enumerate(problem.unknowns):
            if unknown.base in point:
                theta[place] = unknown.entry(unknown.inside(point[unknown.base]))
        pinned, others = Pinned(problem, held, float(theta[held])), np.delete(theta, held)
        best = polish(pinned, others) or minimise(pinned, others, evaluations=25)
        full = np.insert(best.theta, held, theta[held])
        errors = np.insert(entry_errors(best.evaluation), held, 0.0)
        found.append(Place(replace(best, theta=full, evaluation=problem.evaluate(full)), errors))
    return found


def nearest_zero(problem: Problem, solution: Solution) -> Solution:
    """Where the zero of the coupling is not seen, the one of the actuator's file, if the readings allow it."""
    name = ZERO
    held = [unknown.name for unknown in problem.unknowns].index(name) if _has(problem, name) else -1
    if held < 0 or not _is_hidden(problem, solution, held):
        return solution
    unknown = problem.unknowns[held]
    wanted = unknown.inside(problem.base[name])
    values = problem.values(solution.theta, problem.records[0].place)
    level = values[GAIN] * values[name]
    (place,) = held_at(problem, solution, name, [{name: wanted, GAIN: level / wanted}])
    found = place.solution
    per_reading = solution.evaluation.cost / len(solution.evaluation.residual)
    spent = found.evaluations + solution.evaluations
    allowed = found.evaluation.cost <= solution.evaluation.cost + AS_GOOD * per_reading
    return replace(found if allowed else solution, evaluations=spent)


def _has(problem: Problem, name: str) -> bool:
    return {name, GAIN} <= {unknown.name for unknown in problem.unknowns}


def _is_hidden(problem: Problem, solution: Solution, held: int) -> bool:
    zero = problem.unknowns[held].value(float(solution.theta[held]))
    # As the error towards its nearer side, of a zero of which the readings know the reciprocal.
    error = np.log1p(entry_errors(solution.evaluation)[held])
    return zero > fastest_rate(problem.records) or bool(error > DETERMINED)
