"""Fits with a weakly seen parameter held: along the valley where it lies, and at the value of the actuator's file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ipmclab.fit.fit import DETERMINED
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import LONGEST_DELAY, fastest_rate
from ipmclab.identification.problem.response import CircuitResponder
from ipmclab.identification.search.branch_valley import branch_valley
from ipmclab.identification.search.descent import on_every_row, shorter
from ipmclab.identification.search.solve import Pinned, Solution, descend
from ipmclab.identification.search.tangent import entry_errors, error_parts
from ipmclab.identification.search.valleys import AS_GOOD, EVALUATIONS, NEAR, WEAK, Place, Valley
from ipmclab.model.declared import MOTION, in_group, is_of_circuit
from ipmclab.model.stages.circuit import DC, SERIES, slowest_branch
from ipmclab.model.stages.coupling import GAIN, ZERO
from ipmclab.model.stages.leak import SLOW_TIME
from ipmclab.model.stages.relaxation import slow_times
from ipmclab.model.structure import Structure

_SETTLED: Final = 1e-3  # of chi-square: a further step of the others would lower it by less
_SHARES: Final = (0.01, 0.03, 0.07, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.92, 0.96, 0.98, 0.995)
"""Parts of the steady current beside the other branches that the dc path is given, the slowest branch the rest."""

_ZEROS: Final = (0.1, 0.3, 0.7, 1.5, 5.0)  # times the Nyquist rate: zeros of a coupling that is too fast to be seen
_ROWS: Final = tuple(np.arange(0.5 - LONGEST_DELAY, LONGEST_DELAY, 1.0).tolist())
"""Rows by which the edges of a motion are tried to lie after those of the voltage."""

_SLOW: Final = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)  # times the longest record: a slow mode that is not a slope yet
_SLOWER: Final = (0.2, 0.4, 0.7, 1.4, 2.5, 4.5, 8.0)  # times the time constant of a leak that hardly shows how slow


def along_valleys(problem: Problem, solution: Solution, walked: Valley | None = None) -> list[Place]:
    """The best fits with a weakly seen parameter held at other values.

    A record that is short for the slowest branch does not tell it from the leak, and one that is slow for the zero of
    the coupling does not tell it from the gain. At either end of such a valley the curvature shows a parameter as
    known that is not. Nor does a motion alone tell where the edges of the voltage lie from how fast the strip answers
    them. The valley of a branch begins where it was ``walked`` before, of a minimum near by.
    """
    values = problem.values(solution.theta, problem.records[0].place)
    errors = dict(zip((u.name for u in problem.unknowns), entry_errors(solution.evaluation), strict=True))
    found: list[Place] = []
    circuit = max((error for name, error in errors.items() if is_of_circuit(name)), default=0.0)
    if circuit > WEAK and not any(unknown.base in SERIES for unknown in problem.unknowns):
        resistivity, permittivity = slowest_branch(Structure.of(values).branches, values)
        if {DC, resistivity, permittivity} <= errors.keys():
            both = 1.0 / values[DC] + 1.0 / values[resistivity]
            found += held_at(problem, solution, DC, [1.0 / (share * both) for share in _SHARES])
    if {GAIN, ZERO} <= errors.keys() and errors[ZERO] > WEAK:
        fastest = fastest_rate(problem.records)
        found += held_at(problem, solution, ZERO, [part * fastest for part in _ZEROS])
    if errors.get(SLOW_TIME, 0.0) > WEAK:
        found += held_at(problem, solution, SLOW_TIME, [values[SLOW_TIME] * factor for factor in _SLOWER])
    longest = max(float(record.run.time[-1] - record.run.time[0]) for record in problem.records)
    for output in ("displacement", "force"):
        slowest = max(slow_times(errors, output), key=values.__getitem__, default="")
        if errors.get(slowest, 0.0) > WEAK:
            found += held_at(problem, solution, slowest, [longest * part for part in _SLOW])
    # The delay of the record without a current of which least is known: the delays of others follow it.
    delays = [unknown for unknown in problem.unknowns if unknown.base == "observation.delay"]
    alone = [delay for delay in delays if (delay.place, "current") not in problem.readings]
    edges = max(alone, key=lambda delay: errors[delay.name], default=None)
    if edges is not None and in_group(MOTION, errors):
        found += held_at(problem, solution, edges.name, [edges.value(row) for row in _ROWS])
    if isinstance(problem.responder, CircuitResponder):
        before = [] if walked is None else walked.with_branch_held(problem, solution.theta)
        found += branch_valley(problem, solution, problem.responder.branches, before)
    return found


def held_at(problem: Problem, solution: Solution, name: str, values: Sequence[float]) -> list[Place]:
    """The best fits with one parameter held at some values [SI], each from the one beside it."""
    held = [unknown.name for unknown in problem.unknowns].index(name)
    unknown, own = problem.unknowns[held], float(solution.theta[held])
    entries = sorted(unknown.entry(unknown.inside(value)) for value in values)
    rows, lowest = shorter(problem, solution)
    found = []
    for side in ([e for e in entries if e >= own], [e for e in reversed(entries) if e < own]):
        neighbour = lowest
        for entry in side:
            pinned = Pinned(rows, held, entry)
            settled = _SETTLED * lowest.evaluation.per_residual
            best, left = pinned.follow(neighbour.theta, neighbour.evaluation, settled)
            if left > settled:
                best = descend(pinned, best.theta, best.evaluation, evaluations=EVALUATIONS, tolerance=NEAR)
            if not best.converged:  # lost on the way: from the lowest point once more
                again = descend(pinned, np.delete(lowest.theta, held), evaluations=EVALUATIONS, tolerance=NEAR)
                best = min(best, again, key=lambda one: one.evaluation.cost)
            errors = np.insert(error_parts(best.evaluation), held, 0.0, axis=1)
            neighbour = pinned.in_full(best)
            found.append(Place(neighbour if rows is problem else on_every_row(problem, neighbour), errors))
    return found


def nearest_zero(problem: Problem, solution: Solution) -> Solution:
    """Where the zero of the coupling is not seen, the one of the actuator's file, if the readings allow it."""
    names = [unknown.name for unknown in problem.unknowns]
    if not {ZERO, GAIN} <= set(names):
        return solution
    held = names.index(ZERO)
    zero = problem.unknowns[held].value(float(solution.theta[held]))
    # As the error towards its nearer side, of a zero of which the readings know the reciprocal.
    error = np.log1p(entry_errors(solution.evaluation)[held])
    if not (zero > fastest_rate(problem.records) or error > DETERMINED):
        return solution
    (place,) = held_at(problem, solution, ZERO, [problem.base[ZERO]])
    found = place.solution
    spent = found.evaluations + solution.evaluations
    if not found.evaluation.cost <= solution.evaluation.cost + AS_GOOD * solution.evaluation.per_residual:
        return replace(solution, evaluations=spent)
    # As good as a minimum: whether that was reached counts, not whether the walk along the valley came to its end.
    return replace(found, converged=solution.converged, message=solution.message, evaluations=spent)
