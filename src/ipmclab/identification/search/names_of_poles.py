"""Which poles of a motion or a force are called slow: the same answer has several names."""

from __future__ import annotations

from dataclasses import replace

from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import fastest_rate
from ipmclab.identification.search.descent import minimum_near
from ipmclab.identification.search.doublet import COUPLING
from ipmclab.identification.search.solve import Solution
from ipmclab.identification.search.valleys import AS_GOOD
from ipmclab.model.slow_modes import fastest_to_coupling


def with_slow_poles_slow(problem: Problem, solution: Solution) -> Solution:
    """The same answer with the fastest real poles called those of d(s), where one as good has these names.

    A fit that ended under other names would be certain of a coupling that is none. Two outputs share their d(s): there
    the names say something.
    """
    outputs = {output for record in problem.records for output in record.readings} - {"current"}
    places = {unknown.name: place for place, unknown in enumerate(problem.unknowns)}
    if len(outputs) != 1 or not places.keys() >= set(COUPLING):
        return solution
    values = problem.in_reference(solution.theta, problem.records[0].place)
    named = fastest_to_coupling(values, min(outputs), fastest_rate(problem.records))
    if not named or not places.keys() >= named.keys():
        return solution
    theta = solution.theta.copy()
    for name, value in named.items():
        unknown = problem.unknowns[places[name]]
        theta[places[name]] = unknown.entry(unknown.inside(value))
    found = minimum_near(problem, theta)
    is_as_good = found.evaluation.cost <= solution.evaluation.cost + AS_GOOD * solution.evaluation.per_residual
    if not (found.converged and is_as_good):
        return solution
    return replace(found, evaluations=found.evaluations + solution.evaluations)
