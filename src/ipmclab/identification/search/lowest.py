"""The lowest minimum, searched from every start that the readings suggest, and the minima beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ipmclab.errors import InputError
from ipmclab.identification.problem.free import FreeParameters
from ipmclab.identification.problem.problem import Noise, Problem
from ipmclab.identification.problem.record import PreparedRun, at_their_rows
from ipmclab.identification.search.along import along_valleys
from ipmclab.identification.search.as_good import allowed_places
from ipmclab.identification.search.descent import LONGEST, SHORTLY, at_floor, minimum, minimum_near, to_the_end, weigh
from ipmclab.identification.search.doublet import COUPLING, without_doublet
from ipmclab.identification.search.names_of_poles import with_slow_poles_slow
from ipmclab.identification.search.pose import entries_at, is_size_of_leak, problem_at, without_leak
from ipmclab.identification.search.searched_run import moves_of_rows
from ipmclab.identification.search.solve import Solution
from ipmclab.identification.search.starts.start import StartingPoint, known_first, starting_points
from ipmclab.identification.search.starts.start_in_state import in_one_state, moved_back, there_alone
from ipmclab.identification.search.valleys import AS_GOOD, Minima, Place, Rival, Valley
from ipmclab.model import Actuator
from ipmclab.model.declared import electrical, has_several_minima, is_of_leak
from ipmclab.model.geometry import DIMENSIONS
from ipmclab.model.stages.circuit import SERIES
from ipmclab.progress import stage
from ipmclab.run import FloatArray

_TOO_SMALL: Final = 1e-3
"""Of the size of a leak that the readings suggest: it adds nothing to a circuit that was found without it."""

_LOWER: Final = 1e-3  # of chi-square: what lies lower by less is the same minimum


def find_minima(
    actuator: Actuator, names: FreeParameters, records: Sequence[PreparedRun]
) -> tuple[Problem, Solution, Minima]:
    """The best minimum, and the others."""
    stage("finding where to start from the readings alone", 0.05, 0.2, 300)
    points = _points(actuator, names, records)
    if not points:
        raise InputError(
            "these records do not show where a search could start: their readings do not answer to the voltage",
            code="no-start",
            where="runs",
            repair="record longer, with steps that the readings answer to",
        )
    return _search(actuator, names, records, points)


def _points(actuator: Actuator, names: FreeParameters, records: Sequence[PreparedRun]) -> list[StartingPoint]:
    """Where to start; of runs in several states from those of one of them, the laws as the literature has them."""
    alike = in_one_state(records)
    if alike is None:
        return known_first(actuator, names, records, _circuit_first(actuator, names, records))
    strip, fewer = there_alone(actuator, names, alike)
    circuit = _circuit_first(strip, fewer, alike)
    nowhere = StartingPoint({}, at_their_rows(records))
    points = known_first(strip, fewer, alike, circuit) if fewer.actuator else [nowhere]
    return [moved_back(actuator, names, point, alike, records) for point in points]


def _search(
    actuator: Actuator, names: FreeParameters, records: Sequence[PreparedRun], points: Sequence[StartingPoint]
) -> tuple[Problem, Solution, Minima]:
    """The best minimum from some starts, and the others."""
    posed = _posed(actuator, names, records, points)
    noise = posed[0][0].noise
    smaller = _from_without_leak(posed)
    if smaller is not None:
        posed.append(smaller)
    weights = _left_by_starts(posed)
    # These have several minima, of which noise can make the wrong one the first.
    explore = any(has_several_minima(name) for name in names.actuator)
    tried: list[tuple[Problem, Solution]] = []
    shortly = SHORTLY if explore and len(posed) > 1 else LONGEST
    finds = [minimum_near if point.exact else minimum for point in points] + [minimum] * (len(posed) - len(points))
    for number, (find, (problem, theta)) in enumerate(zip(finds, posed, strict=True)):
        begin, end = (0.2 + 0.2 * part / len(posed) for part in (number, number + 1))
        stage(f"searching from start {number + 1} of {len(posed)}", begin, end)
        problem = problem.with_noise(weights)
        solution = find(problem, theta, evaluations=shortly)
        tried.append((problem, solution))
        if not explore and solution.converged and at_floor(problem, solution, noise):
            break
    tried = to_the_end(tried, noise)
    hopeful = tried[0][1].evaluation.cost + AS_GOOD * tried[0][1].evaluation.per_residual
    tried = [(of, with_slow_poles_slow(of, one) if one.evaluation.cost <= hopeful else one) for of, one in tried]
    problem, solution = min(tried, key=lambda pair: pair[1].evaluation.cost)
    found = between_other_rows(problem, solution)
    tried += [(problem, other) for other in found if other is not solution]
    solution = found[0]
    stage("looking for other fits that are as good", 0.4, 0.5, 300)
    # A valley is walked under the weights of the fit, to be the same one when its places are asked again.
    weighed, best = weigh(problem, solution)
    valley = along_valleys(weighed, best)
    lowest = _lowest_of(weighed, best, valley)
    if lowest is not best:
        walked = Valley(weighed, best, tuple(valley))
        weighed, best = weigh(weighed, lowest)
        valley = along_valleys(weighed, best, walked)
        solution = replace(best, evaluation=problem.evaluate(best.theta))
    spent = [*(other for _, other in tried if other is not found[0]), *(place.solution for place in valley), best]
    best = replace(best, evaluations=sum(other.evaluations for other in spent))
    allowed = solution.evaluation.cost + AS_GOOD * solution.evaluation.per_residual
    rivals = [
        Rival.of(of, other.theta)
        for of, other in tried
        if other.theta is not solution.theta and other.evaluation.cost <= allowed
    ]
    if set(COUPLING) <= set(names.shared):
        lowest_one = problem, solution
        higher = [one for one in tried if one[1].evaluation.cost > allowed]
        rivals += [r for one in higher if (r := without_doublet(lowest_one, one, actuator)) is not None]
    ends = [Rival.of(of, other.theta) for of, other in tried] if explore else []
    walked = Valley(weighed, best, tuple(valley))
    return weighed, best, Minima(tuple(rivals), allowed_places(weighed, best, valley), tuple(ends), walked)


def between_other_rows(problem: Problem, solution: Solution) -> list[Solution]:
    """The fit and others with the edges of one record, or of all, a row earlier or later, the lowest first.

    At a row the current jumps: no step of a search goes over one. Poles and residues have said between which rows edges
    lie, by circuits of which some cannot exist. Those that can are asked here; from a lower minimum all again.
    """
    edges = [
        column
        for column, unknown in enumerate(problem.unknowns)
        if unknown.base == "observation.delay" and "current" in problem.record_at(int(unknown.place or 0)).readings
    ]
    found = [solution]
    asked: set[tuple[float, ...]] = set()
    while edges:
        best = found[0]
        rows = np.ceil(best.theta[edges])
        asked.add(tuple(rows))
        beside = []
        for moved in moves_of_rows(rows):
            if tuple(moved) in asked:
                continue
            asked.add(tuple(moved))
            theta = best.theta.copy()
            theta[edges] = np.where(moved == rows, theta[edges], moved - 0.5)
            beside.append((problem, minimum(problem, theta, evaluations=SHORTLY)))
        found = [one for _, one in to_the_end([*((problem, one) for one in found), *beside])]
        if not found[0].evaluation.cost < best.evaluation.cost - _LOWER:
            break
    return found


def _posed(
    actuator: Actuator, names: FreeParameters, records: Sequence[PreparedRun], points: Sequence[StartingPoint]
) -> list[tuple[Problem, FloatArray]]:
    """The problem and the vector of each start."""
    noise = {(one.place, output): reading.noise for one in records for output, reading in one.readings.items()}
    problems = [problem_at(actuator, names, records, point, noise) for point in points]
    return [(problem, entries_at(problem, point)) for problem, point in zip(problems, points, strict=True)]


def _lowest_of(problem: Problem, solution: Solution, valley: Sequence[Place]) -> Solution:
    """A minimum, or the lower one that lies along its valleys."""
    lowest = min((place.solution for place in valley), key=lambda other: other.evaluation.cost, default=solution)
    is_lower = lowest.evaluation.cost < solution.evaluation.cost - _LOWER
    return minimum(problem, lowest.theta) if is_lower else solution


def _from_without_leak(posed: Sequence[tuple[Problem, FloatArray]]) -> tuple[Problem, FloatArray] | None:
    """Where a circuit stands without its leak, and the leak beside it too small to show.

    A leak stops no circuit from following the readings as it does without one. Poles and residues find that at once,
    with minima that lie apart.
    """
    problem = posed[0][0]
    leaking = [place for place, unknown in enumerate(problem.unknowns) if is_of_leak(unknown.base)]
    sizes = {place: problem.unknowns[place] for place in leaking if is_size_of_leak(problem.unknowns[place].base)}
    if not sizes:
        return None
    off = {unknown.base: 0.0 for unknown in sizes.values()}
    circuit = without_leak(problem.without(leaking, off))
    if not circuit.is_circuit:
        return None
    starts = [(theta, minimum(circuit, np.delete(theta, leaking), evaluations=SHORTLY)) for _, theta in posed]
    start, solution = min(starts, key=lambda pair: pair[1].evaluation.cost)
    solution = minimum(circuit, solution.theta)
    solution = _lowest_of(circuit, solution, along_valleys(circuit, solution))
    whole = start.copy()
    whole[np.delete(np.arange(len(start)), leaking)] = solution.theta
    for place, unknown in sizes.items():
        whole[place] = unknown.entry(unknown.inside(_TOO_SMALL * unknown.value(float(start[place]))))
    return problem, whole


def _left_by_starts(posed: Sequence[tuple[Problem, FloatArray]]) -> Noise:
    """The noise that a search weighs by: of each output as many times that of its readings as the best start leaves.

    No model is complete. What it leaves of two outputs can be many times their noise, which then says nothing of how
    one weighs against the other. Runs of one output keep their own noise: of two that disagree none is to be followed.
    """
    noise = posed[0][0].noise
    outputs = {output for _, output in noise}
    if len(outputs) == 1:
        return noise
    times = dict.fromkeys(outputs, np.inf)
    for problem, theta in posed:
        shorter = problem.on_means or problem
        here = shorter.evaluate(theta)
        for output in outputs:
            squares = [
                np.sum(np.square(here.residual[piece])) for (_, of), piece in shorter.pieces.items() if of == output
            ]
            readings = sum(piece.stop - piece.start for (_, of), piece in problem.pieces.items() if of == output)
            left = math.sqrt(sum(squares) / max(readings, 1))  # a mean weighs as its readings
            times[output] = min(times[output], left) if np.isfinite(left) else times[output]
    return {key: one * max(times[key[1]], 1.0) if np.isfinite(times[key[1]]) else one for key, one in noise.items()}


def _circuit_first(actuator: Actuator, names: FreeParameters, records: Sequence[PreparedRun]) -> StartingPoint | None:
    """The circuit and its leak from the current alone, where that is costly and the motion is asked for too.

    None where poles and residues find the circuit at once, or where the current does not determine it.
    """
    own_electrical = [name for name in names.actuator if electrical(name)]
    if actuator.structure.is_lumped or not own_electrical or len(own_electrical) == len(names.actuator):
        return None
    with_current = [replace(r, readings={"current": r.readings["current"]}) for r in records if "current" in r.readings]
    if not with_current or set(SERIES) & set(names.actuator) or any(n in DIMENSIONS for n in names.actuator):
        return None
    own = [f"observation.{what}.current" for what in ("offset", "drift")]
    observed = tuple(name for name in names.observation if name in own)
    fewer = replace(names.of(own_electrical), observation=observed, priors={}, together={}, age=())
    points = list(starting_points(actuator, fewer, with_current))
    posed = _posed(actuator, fewer, with_current, points)
    if not posed:
        return None
    problem, solution = to_the_end([(one, minimum(one, theta, evaluations=SHORTLY)) for one, theta in posed])[0]
    found = problem.values(solution.theta, with_current[0].place)
    return StartingPoint({name: found[name] for name in own_electrical}, points[0].delays)
