"""The estimation itself: start, search, weigh, and ask the readings whether the assumptions hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.confidence import NORMAL_95
from ipmclab.errors import InputError
from ipmclab.fit.fit import DETERMINED
from ipmclab.identification.noise.correlate import Correlated, with_noise
from ipmclab.identification.noise.under_noise import at_rest_after_all
from ipmclab.identification.noise.unseen import Unseen, without_unseen
from ipmclab.identification.noise.weighting import weighted
from ipmclab.identification.problem.free import FreeParameters
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import ASSUMED_REST, PreparedRun
from ipmclab.identification.problem.response import ActuatorResponder, CircuitResponder, lumped
from ipmclab.identification.problem.thin import thinned
from ipmclab.identification.problem.unknowns import Unknown, unknowns_of
from ipmclab.identification.search.doublet import COUPLING, without_doublet
from ipmclab.identification.search.rest import is_idle, not_at_rest
from ipmclab.identification.search.solve import (
    SETTLED,
    Pinned,
    Solution,
    entry_errors,
    minimise,
    null_directions,
    polish,
    settle,
    settled,
)
from ipmclab.identification.search.starts.start import (
    StartingPoint,
    fastest_rate,
    known_first,
    leak_shares,
    other_zeros,
    starting_points,
)
from ipmclab.identification.search.starts.usual import usual_coupling
from ipmclab.identification.search.valleys import Minima, Place, Rival, branch_valley
from ipmclab.identification.search.weights import found_noise
from ipmclab.identification.solved import Estimate
from ipmclab.identification.uncertainty.unshown_zero import unshown_zeros
from ipmclab.model import Actuator
from ipmclab.model.declared import electrical, has_several_minima, is_of_circuit
from ipmclab.model.geometry import DIMENSIONS
from ipmclab.model.parameters import Parameter
from ipmclab.model.stages.circuit import DC, SERIES
from ipmclab.model.stages.coupling import GAIN, ZERO
from ipmclab.model.stages.leak import SLOW_TIME
from ipmclab.model.structure import Structure
from ipmclab.progress import stage
from ipmclab.run import Finding

FloatArray = npt.NDArray[np.float64]

_SAME_NOISE: Final = 0.002
_WEIGHED_AGAIN: Final = 6  # times, each of which leaves of a difference of the weights a part of unknowns by readings
_AT_FLOOR: Final = 1.3  # times the noise between neighbours
_WEAK: Final = 0.2  # standard error of a logarithm from which other valleys are looked for
_RIVAL: Final = 4.0  # of chi-square: a minimum no higher than that is as good
_SAME: Final = 1e-3  # of an entry: a search that ends so near found the same point
_SLOWER: Final = (0.2, 0.4, 0.7, 1.4, 2.5, 4.5, 8.0)  # times the time constant of a leak that hardly shows how slow
_LONGEST: Final = 300  # evaluations of one search
_COSTLY: Final = 1e-8  # of the cost: for thousands of readings a ten-thousandth of chi-square
_CHEAP: Final = 1e-10
_SHORTLY: Final = 15  # of a search that is only to show whether it is worth more
_HOPE: Final = 1.05  # times the best cost: a search above that is left


def estimate(actuator: Actuator, names: FreeParameters, records: Sequence[PreparedRun]) -> Estimate:
    """Fit, and settle what belongs to each run by asking its readings.

    A sensor's zero is an unknown until the readings allow it to be zero; a run is at rest at its start until
    the readings contradict it.
    """
    records = list(records)
    # Before any numerics; starting states are counted when their number is known.
    parameters = actuator.parameters()
    _need_as_many_readings(len(unknowns_of(names, parameters, records)), records)
    given_up: set[int] = set()
    while True:
        searched, near, minima = _fit(actuator, parameters, names, records)
        problem, solution = _without_idle(searched, near, names)
        moving = not_at_rest(problem, solution) - given_up
        if not moving:
            break
        given_up |= moving
        records = [replace(record, start="free") if record.place in moving else record for record in records]
    rivals, along = minima.rivals, minima.along
    if problem is not searched:
        # With fewer unknowns all is known better, at the other minima and along the valleys too.
        rivals = _still_rivals(problem, solution, rivals)
        along = _allowed(problem, solution, _along_valleys(actuator, names, problem, solution)) if along else ()
    rivals += along
    stage("finding the noise in what the fit leaves", 0.5, 0.7, 1000)
    noisy = partial(_noisy, names=names, ends=minima.ends)
    under, other = noisy(problem, solution)
    resting = at_rest_after_all(under, given_up)
    if resting:
        places = set(resting)
        starts = {c for c, unknown in enumerate(problem.unknowns) if unknown.nuisance and unknown.place in places}
        problem, solution = _with_less(problem, solution, starts, places)
        given_up -= places
        under, other = noisy(problem, solution)
    stage("asking what the readings do not show", 0.7, 0.75)
    unseen, beside = without_unseen(under), None
    if unseen:
        beside = under
        problem, solution = _without_stages(problem, solution, unseen)
        under, other = noisy(problem, solution)
    at = under.solution
    if problem.unknowns and len(null_directions(at.evaluation)):
        at = settle(under.problem, at, _reference(under.problem, at))
    under = under.at(_nearest_zero(under.problem, at))
    # Least squares may have gone far after a drift: what the model lacks is looked at where the noise has the strip.
    strip = other or under
    white = problem, _in_full(problem, strip.problem, strip.solution)
    findings = [_not_at_rest(r) for r in problem.records if r.place in given_up and r.start == "free"]
    problem, solution = under.problem, under.solution
    findings += [_sensor_error(problem, unknown) for unknown in problem.unknowns if _is_asked(unknown, names)]
    findings += [found for record in problem.records if (found := _impossible_current(problem, solution, record))]
    findings += unshown_zeros(problem, solution)
    if under.shapes:
        # Under their noise the readings tell fewer minima apart: all of them are asked again.
        asked = [*rivals, *minima.ends, *_usual(problem, solution, minima.ends)]
        rivals = _still_rivals(problem, solution, asked, under)
        if other is not None:
            reach = NORMAL_95 * entry_errors(other.solution.evaluation)
            rivals += (Rival.of(problem, other.solution.theta, reach),)
        if isinstance(problem.responder, CircuitResponder):  # the ends of a coupling's valley would reach too far
            valley = _along_valleys(actuator, names, problem, solution)
            rivals += _allowed(problem, solution, valley, under)
    return Estimate(parameters, problem, solution, rivals, tuple(findings), under, unseen, beside, white)


def _noisy(
    problem: Problem, solution: Solution, names: FreeParameters, ends: Sequence[Rival]
) -> tuple[Correlated, Correlated | None]:
    """The noise of a fit, the fit under it where that predicts as well; and another fit that is as good."""
    least = with_noise(problem, solution, _asked(problem, names), partial(_least, ends=ends))
    return weighted(least, partial(_from_everywhere, ends=ends))


def _least(problem: Problem, near: Solution, ends: Sequence[Rival]) -> tuple[Problem, Solution]:
    """Least squares beside zeros and slopes: without them the lowest minimum may be one that follows the drift."""
    return _weigh(*_from_everywhere(problem, near, ends))


def _from_everywhere(problem: Problem, near: Solution, ends: Sequence[Rival]) -> tuple[Problem, Solution]:
    """The lowest minimum of a problem near one that was searched before, and from where those searches ended."""
    first = _again(problem, near)
    starts = [_entries(problem, near.theta, end.entries) for end in (*ends, *_usual(problem, near, ends))]
    tried = [(problem, first), *((problem, _minimise(problem, start, evaluations=_SHORTLY)) for start in starts)]
    return _to_the_end(tried)[0] if starts else tried[0]


def _usual(problem: Problem, near: Solution, ends: Sequence[Rival]) -> list[Rival]:
    """Where a search from a usual strip would begin, where there may be several minima."""
    theta = usual_coupling(problem, near.theta) if ends else None
    return [] if theta is None else [Rival.of(problem, theta)]


def _entries(problem: Problem, own: FloatArray, entries: Mapping[str, float]) -> FloatArray:
    names = [unknown.name for unknown in problem.unknowns]
    return np.array([entries.get(name, entry) for name, entry in zip(names, own, strict=True)])


def _without_stages(problem: Problem, solution: Solution, unseen: Sequence[Unseen]) -> tuple[Problem, Solution]:
    """Least squares without some stages."""
    gone = {unknown.name for one in unseen for unknown in one.unknowns}
    off = {name: value for one in unseen for name, value in one.off.items()}
    columns = [column for column, unknown in enumerate(problem.unknowns) if unknown.name in gone]
    fewer = problem.without(columns, off)
    theta = np.delete(solution.theta, columns)
    first = replace(solution, theta=theta, evaluation=fewer.evaluate(theta), evaluations=solution.evaluations + 1)
    return _weigh(fewer, _again(fewer, first)) if len(theta) else (fewer, first)


def _in_full(problem: Problem, smaller: Problem, solution: Solution) -> Solution:
    """A point of a problem whose zeros and slopes were left to the noise, with the best of these in the whole one."""
    if len(problem.unknowns) == len(smaller.unknowns) and problem is smaller:
        return solution
    theta = _entries(problem, np.zeros(len(problem.unknowns)), Rival.of(smaller, solution.theta).entries)
    names = {unknown.name for unknown in smaller.unknowns}
    left = np.array([unknown.name not in names for unknown in problem.unknowns], dtype=bool)
    here = problem.evaluate(theta)
    if left.any():
        theta[left] -= np.linalg.lstsq(here.jacobian[:, left], here.residual, rcond=1e-12)[0]
        here = problem.evaluate(theta)
    return replace(solution, theta=theta, evaluation=here)


def _allowed(
    problem: Problem, solution: Solution, valley: Sequence[Place], under: Correlated | None = None
) -> tuple[Rival, ...]:
    """The places of a valley that the readings allow, under the noise that was found."""
    least = solution.evaluation.cost
    variance = least / len(solution.evaluation.residual)
    found = []
    for place in valley:
        times = under.inflation(place.solution.evaluation.residual - solution.evaluation.residual) if under else 1.0
        found.append(Rival.at(problem, place, least, variance * times))
    return tuple(rival for rival in found if rival is not None)


def _still_rivals(
    problem: Problem, solution: Solution, rivals: Sequence[Rival], under: Correlated | None = None
) -> tuple[Rival, ...]:
    """Those of other minima that are as good in another problem, where they lie then."""
    per_reading = solution.evaluation.cost / len(solution.evaluation.residual)
    found = []
    for rival in rivals:
        if any(rival.reach.values()):  # it need not be as good: the readings cannot tell it from the best
            found.append(rival)
            continue
        theta = _entries(problem, solution.theta, rival.entries)
        other = polish(problem, theta) or _minimise(problem, theta, evaluations=_SHORTLY)
        if np.abs(other.theta - solution.theta).max(initial=0.0) < _SAME:
            continue
        times = under.inflation(other.evaluation.residual - solution.evaluation.residual) if under else 1.0
        if other.evaluation.cost <= solution.evaluation.cost + _RIVAL * per_reading * times:
            found.append(Rival.of(problem, other.theta))
    return tuple(found)


def _asked(problem: Problem, names: FreeParameters) -> list[int]:
    """Entries of the offsets and drifts that nobody freed by name, and that no row at 0 V shows."""
    shown = {(record.place, *one) for record in problem.records for one in record.shown}
    return [
        column
        for column, unknown in enumerate(problem.unknowns)
        if _is_asked(unknown, names) and (unknown.place, *unknown.base.split(".")[1:]) not in shown
    ]


def _is_asked(unknown: Unknown, names: FreeParameters) -> bool:
    """Whether it is an offset or a drift that nobody freed by name."""
    return unknown.base.startswith(("observation.offset.", "observation.drift.")) and (
        unknown.base not in names.observation
    )


def _nearest_zero(problem: Problem, solution: Solution) -> Solution:
    """Where the zero of the coupling is not seen, the one of the actuator's file, if the readings allow it."""
    name = ZERO
    held = [unknown.name for unknown in problem.unknowns].index(name) if _has(problem, name) else -1
    if held < 0 or not _is_hidden(problem, solution, held):
        return solution
    unknown = problem.unknowns[held]
    wanted = float(np.clip(problem.base[name], unknown.lower, unknown.upper))
    values = problem.values(solution.theta, problem.records[0].place)
    level = values[GAIN] * values[name]
    (place,) = _held(problem, solution, name, [{name: wanted, GAIN: level / wanted}])
    found = place.solution
    per_reading = solution.evaluation.cost / len(solution.evaluation.residual)
    spent = found.evaluations + solution.evaluations
    allowed = found.evaluation.cost <= solution.evaluation.cost + _RIVAL * per_reading
    return replace(found if allowed else solution, evaluations=spent)


def _has(problem: Problem, name: str) -> bool:
    return {name, GAIN} <= {unknown.name for unknown in problem.unknowns}


def _is_hidden(problem: Problem, solution: Solution, held: int) -> bool:
    zero = problem.unknowns[held].value(float(solution.theta[held]))
    # As the error towards its nearer side, of a zero of which the readings know the reciprocal.
    error = np.log1p(entry_errors(solution.evaluation)[held])
    return zero > fastest_rate(problem.records) or bool(error > DETERMINED)


def _without_idle(problem: Problem, solution: Solution, names: FreeParameters) -> tuple[Problem, Solution]:
    """Take out offsets and starting states that turned out not to be needed."""
    unsure = {r.place for r in problem.records if r.start == "free" and r.run.metadata.starts_from_rest is None}
    groups: dict[tuple[int, str], list[int]] = {}
    asked = set(_asked(problem, names))
    for column, unknown in enumerate(problem.unknowns):
        offset = column in asked
        if unknown.place is None or not (offset or (unknown.nuisance and unknown.place in unsure)):
            continue
        groups.setdefault((unknown.place, unknown.base if offset else "start"), []).append(column)
    idle = {key: columns for key, columns in groups.items() if is_idle(solution, columns)}
    if not idle:
        return problem, solution
    resting = {place for place, what in idle if what == "start"}
    return _with_less(problem, solution, {column for columns in idle.values() for column in columns}, resting)


def _with_less(problem: Problem, solution: Solution, dropped: Set[int], resting: Set[int]) -> tuple[Problem, Solution]:
    """The fit without some entries, some runs being at rest at their start."""
    kept = [column for column in range(len(problem.unknowns)) if column not in dropped]
    records = [replace(r, start=ASSUMED_REST) if r.place in resting else r for r in problem.records]
    smaller = Problem(
        problem.base, records, [problem.unknowns[column] for column in kept], problem.responder, problem.noise
    )
    theta = solution.theta[kept]
    here = replace(solution, theta=theta, evaluation=smaller.evaluate(theta), evaluations=solution.evaluations + 1)
    return _weigh(smaller, _again(smaller, here))


def _again(problem: Problem, near: Solution) -> Solution:
    """The minimum beside a point."""
    found = polish(problem, near.theta, near.evaluation) or _minimise(problem, near.theta)
    return replace(found, evaluations=found.evaluations + near.evaluations)


def _fit(
    actuator: Actuator, parameters: Mapping[str, Parameter], names: FreeParameters, records: Sequence[PreparedRun]
) -> tuple[Problem, Solution, Minima]:
    """The best minimum, and the others."""
    stage("finding where to start from the readings alone", 0.05, 0.2, 300)
    circuit = _circuit_first(actuator, parameters, names, records)
    points = known_first(actuator, names, records, circuit)
    if not points:
        raise InputError(
            "these records do not show where a search could start: their readings do not answer to the voltage",
            code="no-start",
            where="runs",
            repair="record longer, with steps that the readings answer to",
        )
    costly = not (actuator.structure.is_lumped and all(set(record.readings) == {"current"} for record in records))
    shorter = thinned(records, points[0].delays) if costly else None
    if shorter is None:
        problem, solution, minima = _search(actuator, parameters, names, records, points)
    else:
        rough, near, minima = _search(actuator, parameters, names, shorter, points)
        stage("fitting every row", 0.45, 0.5)
        problem = problem_at(actuator, parameters, names, records, points[0], _noise_of(records))
        minima = minima.moved_to(rough, problem)
        theta = entries_at(problem, points[0])
        there = Rival.of(rough, near.theta).moved_to(rough, problem).entries
        for place, unknown in enumerate(problem.unknowns):
            theta[place] = there.get(unknown.name, theta[place]) if not unknown.nuisance else theta[place]
        found = _minimise(problem, theta)
        solution = replace(found, evaluations=found.evaluations + near.evaluations)
    return *_weigh(problem, solution), minima


def _noise_of(records: Sequence[PreparedRun]) -> dict[tuple[int, str], float]:
    return {
        (record.place, output): max(reading.noise, 1e-300)
        for record in records
        for output, reading in record.readings.items()
    }


def _search(
    actuator: Actuator,
    parameters: Mapping[str, Parameter],
    names: FreeParameters,
    records: Sequence[PreparedRun],
    points: Sequence[StartingPoint],
) -> tuple[Problem, Solution, Minima]:
    """The best minimum from some starts, and the others."""
    noise = _noise_of(records)
    # These have several minima, of which noise can make the wrong one the first.
    explore = any(has_several_minima(name) for name in names.actuator)
    tried: list[tuple[Problem, Solution]] = []
    shortly = _SHORTLY if explore and len(points) > 1 else _LONGEST
    for number, point in enumerate(points):
        stage(f"searching from start {number + 1} of {len(points)}", *_share(0.2, 0.4, number, len(points)))
        problem = problem_at(actuator, parameters, names, records, point, noise)
        theta = entries_at(problem, point)
        solution = (polish(problem, theta) if point.exact else None) or _minimise(problem, theta, evaluations=shortly)
        tried.append((problem, solution))
        if not explore and solution.converged and _at_floor(problem, solution):
            break
    tried = _to_the_end(tried)
    problem, solution = min(tried, key=lambda pair: pair[1].evaluation.cost)
    stage("looking for other fits that are as good", 0.4, 0.5, 300)
    valley = _along_valleys(actuator, names, problem, solution)
    lowest = min((place.solution for place in valley), key=lambda other: other.evaluation.cost, default=solution)
    if lowest.evaluation.cost < solution.evaluation.cost - 1e-3:
        solution = _minimise(problem, lowest.theta)
        valley = _along_valleys(actuator, names, problem, solution)
    spent = [*(other for _, other in tried), *(place.solution for place in valley)]
    solution = replace(solution, evaluations=sum(other.evaluations for other in spent))
    per_reading = solution.evaluation.cost / len(solution.evaluation.residual)
    allowed = solution.evaluation.cost + _RIVAL * per_reading
    rivals = [
        Rival.of(of, other.theta)
        for of, other in tried
        if other.theta is not solution.theta and other.evaluation.cost <= allowed
    ]
    if set(COUPLING) <= set(names.shared):
        higher = [(of, other) for of, other in tried if other.evaluation.cost > allowed]
        rivals += [r for of, other in higher if (r := without_doublet(of, solution, other, actuator)) is not None]
    ends = [Rival.of(of, other.theta) for of, other in tried] if explore else []
    return problem, solution, Minima(tuple(rivals), _allowed(problem, solution, valley), tuple(ends))


def _share(begin: float, end: float, number: int, count: int) -> tuple[float, float]:
    """Where one of several equal parts of a stage begins and ends."""
    step = (end - begin) / count
    return begin + number * step, begin + (number + 1) * step


def _minimise(problem: Problem, theta: FloatArray, *, evaluations: int = _LONGEST) -> Solution:
    """The minimum from a point, as near to it as readings can tell where each evaluation is costly."""
    costly = not isinstance(problem.responder, CircuitResponder)
    return minimise(problem, theta, evaluations=evaluations, tolerance=_COSTLY if costly else _CHEAP)


def _circuit_first(
    actuator: Actuator, parameters: Mapping[str, Parameter], names: FreeParameters, records: Sequence[PreparedRun]
) -> StartingPoint | None:
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
    fewer = FreeParameters(
        tuple(name for name in names.shared if name in own_electrical),
        tuple(name for name in names.per_run if name in own_electrical),
        tuple(name for name in names.per_mounting if name in own_electrical),
        tuple(name for name in names.observation if name in own),
    )
    noise = {(record.place, "current"): max(record.readings["current"].noise, 1e-300) for record in with_current}
    points = starting_points(actuator, fewer, with_current)
    tried = []
    for point in points:
        problem = problem_at(actuator, parameters, fewer, with_current, point, noise)
        tried.append((problem, _minimise(problem, entries_at(problem, point), evaluations=_SHORTLY)))
    problem, solution = _to_the_end(tried)[0]
    found = problem.values(solution.theta, with_current[0].place)
    return StartingPoint({name: found[name] for name in own_electrical}, points[0].delays)


def _to_the_end(tried: Sequence[tuple[Problem, Solution]]) -> list[tuple[Problem, Solution]]:
    """The searches that were left early, those that may still win followed to their minimum; the best first."""
    best = np.inf
    found = []
    longest = _LONGEST
    for problem, solution in sorted(tried, key=lambda pair: pair[1].evaluation.cost):
        if not solution.converged and solution.evaluation.cost < _HOPE * best:
            more = _minimise(problem, solution.theta, evaluations=longest)
            solution = replace(more, evaluations=more.evaluations + solution.evaluations)
        best = min(best, solution.evaluation.cost)
        if solution.converged and _at_floor(problem, solution):
            longest = _SHORTLY
        found.append((problem, solution))
    return sorted(found, key=lambda pair: pair[1].evaluation.cost)


def _along_valleys(actuator: Actuator, names: FreeParameters, problem: Problem, solution: Solution) -> list[Place]:
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
            found += _held(problem, solution, DC, shares)
    if {GAIN, ZERO} <= set(names.shared) and errors[ZERO] > _WEAK:
        found += _held(problem, solution, ZERO, other_zeros(values, problem.records))
    slow = SLOW_TIME
    if slow in names.shared and errors[slow] > _WEAK:
        found += _held(problem, solution, slow, [{slow: values[slow] * factor} for factor in _SLOWER])
    if isinstance(problem.responder, CircuitResponder):
        found += branch_valley(problem, solution)
    return found


def _held(problem: Problem, solution: Solution, name: str, points: Sequence[Mapping[str, float]]) -> list[Place]:
    held = [unknown.name for unknown in problem.unknowns].index(name)
    found = []
    for point in points:
        theta = solution.theta.copy()
        for place, unknown in enumerate(problem.unknowns):
            if unknown.base in point:
                theta[place] = unknown.entry(float(np.clip(point[unknown.base], unknown.lower, unknown.upper)))
        pinned, others = Pinned(problem, held, float(theta[held])), np.delete(theta, held)
        best = polish(pinned, others) or minimise(pinned, others, evaluations=25)
        full = np.insert(best.theta, held, theta[held])
        errors = np.insert(entry_errors(best.evaluation), held, 0.0)
        found.append(Place(replace(best, theta=full, evaluation=problem.evaluate(full)), errors))
    return found


def problem_at(
    actuator: Actuator,
    parameters: Mapping[str, Parameter],
    names: FreeParameters,
    records: Sequence[PreparedRun],
    point: StartingPoint,
    noise: Mapping[tuple[int, str], float],
) -> Problem:
    """The least-squares problem of a fit, with what a starting point knows of its delays."""
    responder: CircuitResponder | ActuatorResponder
    if actuator.structure.is_lumped and all(set(record.readings) == {"current"} for record in records):
        responder = CircuitResponder(actuator.circuit.branches)
    else:
        responder = ActuatorResponder(actuator)
        near = {**actuator.parameter_values, **point.values}
        for record in records:
            if record.start == "free":
                responder.prepare(record, near)
    states = {record.place: responder.amplitudes(record) for record in records if record.start == "free"}
    unknowns = unknowns_of(names, parameters, records, states=states, delays=point.delays)
    _need_as_many_readings(len(unknowns), records)
    return Problem(actuator.parameter_values, records, unknowns, responder, noise)


def _need_as_many_readings(unknowns: int, records: Sequence[PreparedRun]) -> None:
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
            value = float(np.clip(point.values[unknown.base], unknown.lower, unknown.upper))
            theta[place] = unknown.entry(value)
        elif unknown.base == "observation.delay":
            assert unknown.place is not None
            theta[place] = unknown.entry(point.delays[unknown.place].value)
        else:
            linear[place] = True
    if np.any(linear):
        here = problem.evaluate(theta)
        theta[linear] -= np.linalg.lstsq(here.jacobian[:, linear], here.residual, rcond=1e-12)[0]
    return theta


def _at_floor(problem: Problem, solution: Solution) -> bool:
    """Whether what is left looks like the noise between neighbouring readings."""
    found = found_noise(problem, solution)
    return all(found[key] < _AT_FLOOR * problem.noise[key] for key in found)


def _weigh(problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
    """Take the weights from the residuals until they no longer change; the minimum under them, to the last digits."""
    for _ in range(6):
        noise = found_noise(problem, solution)
        if max(abs(noise[key] / problem.noise[key] - 1.0) for key in noise) < _SAME_NOISE:
            break
        weighed = problem.with_noise(noise)
        here = problem.weighed(solution.theta, solution.evaluation, noise)
        again = polish(weighed, solution.theta, here) or _minimise(weighed, solution.theta)
        spent = again.evaluations + solution.evaluations
        problem, solution = weighed, replace(again, converged=again.converged and solution.converged, evaluations=spent)
    for _ in range(_WEIGHED_AGAIN):
        solution = settled(problem, solution)
        noise = found_noise(problem, solution)
        if max(abs(noise[key] / problem.noise[key] - 1.0) for key in noise) < SETTLED:
            break
        weighed = problem.with_noise(noise)
        problem, solution = (
            weighed,
            replace(solution, evaluation=problem.weighed(solution.theta, solution.evaluation, noise)),
        )
    return problem, solution


def _reference(problem: Problem, solution: Solution) -> FloatArray:
    """Where an open direction is closed: the values of the file, no delay, no offset."""
    reference = solution.theta.copy()
    for place, unknown in enumerate(problem.unknowns):
        if unknown.base in problem.base:
            reference[place] = unknown.entry(float(np.clip(problem.base[unknown.base], unknown.lower, unknown.upper)))
        elif not unknown.nuisance:
            reference[place] = 0.0
    return reference


def _not_at_rest(record: PreparedRun) -> Finding:
    return Finding(
        "start-not-at-rest",
        "warning",
        f"{record.label}: its readings contradict a start from rest (p < 0.1 %): the state at its start was fitted too",
        "let the strip rest at 0 V before the first row, and record a second of it",
    )


def _sensor_error(problem: Problem, unknown: Unknown) -> Finding:
    what, output = unknown.base.split(".")[1:]
    label = next(record.label for record in problem.records if record.place == unknown.place)
    said = f"the zero of its {output} is not at zero" if what == "offset" else f"its {output} drifts"
    return Finding(
        "sensor-zero" if what == "offset" else "sensor-drift",
        "info",
        f"{label}: {said} (p < 0.1 %), so the {what} was fitted too",
        "zero the channel at import, on the rows before the first edge" if what == "offset" else "",
        channel=output,
    )


def _impossible_current(problem: Problem, solution: Solution, record: PreparedRun) -> Finding | None:
    """A current that not even a short circuit behind the electrodes could draw."""
    reading = record.readings.get("current")
    if reading is None or not len(reading.measured):
        return None
    values = problem.values(solution.theta, record.place)
    structure = Structure.of(values)
    if not replace(structure, leak="").is_lumped:
        return None
    series = lumped(structure.branches, values, record.series_resistance).series
    voltage = record.run.voltage
    most = (max(float(voltage.max()), 0.0) - min(float(voltage.min()), 0.0)) / series if series else np.inf
    noise = problem.noise[record.place, "current"]
    seen = float(np.abs(reading.measured).max())
    if seen <= 1.02 * most or seen <= most + 6.0 * reading.noise or noise <= 0.0:
        return None
    return Finding(
        "impossible-current",
        "error",
        f"{record.label}: the current reaches {1e3 * seen:.4g} mA, but {series:.4g} ohm in series with the branches "
        f"allow {1e3 * most:.4g} mA at most",
        "the sheet or contact resistance is too high, or the clamp feeds part of the strip directly: measure it, free "
        "circuit.sheet_resistance, or add the stage clamp or line.segments to the actuator",
        channel="current",
        values={"current": seen, "largest": most, "series_resistance": series},
    )
