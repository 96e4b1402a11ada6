"""The estimation itself: start, search, weigh, and ask the readings whether the assumptions hold."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.identify.doublet import COUPLING, without_doublet
from ipmclab.identify.free import FreeParameters
from ipmclab.identify.noise.correlate import Correlated
from ipmclab.identify.observation import ASSUMED_REST, Record
from ipmclab.identify.problem import Problem
from ipmclab.identify.progress import stage
from ipmclab.identify.response import ActuatorResponder, CircuitResponder, is_lumped, lumped
from ipmclab.identify.rest import is_idle, not_at_rest
from ipmclab.identify.solve import Pinned, Solution, entry_errors, minimise, null_directions, polish, settle
from ipmclab.identify.starts.anew import anew, drifts, in_full
from ipmclab.identify.starts.start import (
    StartingPoint,
    fastest_rate,
    known_first,
    leak_shares,
    other_zeros,
    starting_points,
)
from ipmclab.identify.thin import thinned
from ipmclab.identify.under_noise import at_rest_after_all, noise_of, unseen_under_noise
from ipmclab.identify.undetermined.diagnosis import DETERMINED
from ipmclab.identify.unknowns import Unknown, unknowns_of
from ipmclab.identify.unseen import Unseen
from ipmclab.identify.unshown_zero import unshown_zeros
from ipmclab.identify.valleys import Minima, Place, Rival, branch_valley
from ipmclab.model import Actuator
from ipmclab.model.parameters import Parameter
from ipmclab.model.structure import Structure
from ipmclab.run import Finding

FloatArray = npt.NDArray[np.float64]

_SAME_NOISE: Final = 0.002
_AT_FLOOR: Final = 1.3  # times the noise between neighbours
_WEAK: Final = 0.2  # standard error of a logarithm from which other valleys are looked for
_CLEARLY: Final = 0.8  # of what is left: a zero that explains so much is one, whatever the noise
_RIVAL: Final = 4.0  # of chi-square: a minimum no higher than that is as good
_SLOWER: Final = (0.2, 0.4, 0.7, 1.4, 2.5, 4.5, 8.0)  # times the time constant of a leak that hardly shows how slow
_LONGEST: Final = 300  # evaluations of one search
_DEAR: Final = 1e-8  # of the cost: for thousands of readings a ten-thousandth of chi-square
_CHEAP: Final = 1e-10
_SHORTLY: Final = 15  # of a search that is only to show whether it is worth more
_HOPE: Final = 1.05  # times the best cost: a search above that is left

_ELECTRICAL: Final = ("circuit.", "leak.", "clamp.")
_SEVERAL_MINIMA: Final = ("coupling.", "relaxation.", "viscoelastic.", "leak.", "clamp.")


@dataclass(frozen=True, eq=False)
class Estimate:
    """The solved problem, and what was found out about the runs on the way.

    Under noise that is not white its rows are whitened; ``correlated`` holds them as they are.

    ``parameters`` are those of the actuator that was given. ``rivals`` are other fits that the
    readings do not tell from the solution. ``unseen`` are stages that were taken out of the problem;
    ``beside`` is the fit that still had them, where there are any. ``white`` is what least squares gave, before the
    noise was looked at; where that drifts and there are several minima, the most likely point under it.
    """

    parameters: Mapping[str, Parameter]
    problem: Problem
    solution: Solution
    rivals: tuple[Rival, ...]
    findings: tuple[Finding, ...]
    correlated: Correlated
    unseen: tuple[Unseen, ...] = ()
    beside: Correlated | None = None
    white: tuple[Problem, Solution] | None = None


def estimate(actuator: Actuator, names: FreeParameters, records: Sequence[Record]) -> Estimate:
    """Fit, and settle what belongs to each run by asking its readings.

    A sensor's zero is an unknown until the readings allow it to be zero; a run is at rest at its start until
    the readings contradict it.
    """
    found = _estimate(actuator, names, records)
    doubted = "current" in found.correlated.contradicted and "observation.offset.current" not in names.observation
    if not (doubted and any(record.zero_is_open for record in records)):
        return found
    # A zero of the current that is not at zero can lead the first fit so far away that what it leaves is no noise.
    opened = [
        replace(record, unsettled=record.unsettled | {("offset", "current")}) if record.zero_is_open else record
        for record in records
    ]
    again = _estimate(actuator, names, opened)
    nearer = _power(again, "current") < _CLEARLY * _power(found, "current")
    taken = again if nearer and "current" not in again.correlated.contradicted else found
    spent = found.solution.evaluations + again.solution.evaluations
    return replace(taken, solution=replace(taken.solution, evaluations=spent))


def _power(found: Estimate, output: str) -> float:
    """What least squares leaves of an output [SI squared]."""
    problem, solution = found.white or (found.problem, found.solution)
    return sum(
        float(np.sum((problem.noise[key] * solution.evaluation.residual[piece]) ** 2))
        for key, piece in problem.pieces.items()
        if key[1] == output
    )


def _estimate(actuator: Actuator, names: FreeParameters, records: Sequence[Record]) -> Estimate:
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
    stage("asking what the readings do not show", 0.5, 0.6)
    resting = at_rest_after_all(problem, solution, _asked(problem, names), given_up)
    if resting:
        problem, solution = _at_rest(problem, solution, resting)
        given_up -= set(resting)
    problem, solution, unseen, beside = unseen_under_noise(problem, solution, _asked(problem, names), _again)
    if unseen and problem.unknowns:
        problem, solution = _weigh(problem, solution)
    if problem.unknowns and len(null_directions(solution.evaluation)):
        solution = settle(problem, solution, _reference(problem, solution))
    solution = _nearest_zero(problem, solution)
    findings = [_not_at_rest(r) for r in problem.records if r.place in given_up and r.start == "free"]
    findings += [_sensor_error(problem, unknown) for unknown in problem.unknowns if _is_asked(unknown, names)]
    findings += [found for record in problem.records if (found := _impossible_current(problem, solution, record))]
    # Where the residuals are more than white noise, the parameters are those that are most likely under their noise.
    stage("finding the noise, and fitting under it", 0.6, 0.75, 1000)
    white = problem, solution
    yielding = _asked(problem, names)
    correlated = noise_of(problem, solution, yielding)
    again: tuple[Rival, ...] = ()
    if minima.ends and drifts(correlated):
        correlated, again = anew(problem, correlated, minima.ends, lambda at: noise_of(problem, at, yielding))
        # Least squares may have gone far after the drift: what the model leaves is looked at where the strip is.
        white = problem, in_full(problem, correlated.problem, correlated.solution)
    problem, solution = correlated.problem, correlated.solution
    findings += unshown_zeros(problem, solution)
    if correlated.noise:
        rivals = _still_rivals(problem, solution, [replace(r, reach=dict.fromkeys(r.reach, 0.0)) for r in rivals])
        if isinstance(problem.responder, CircuitResponder):  # the ends of a coupling's valley would reach too far
            rivals += _allowed(problem, solution, _along_valleys(actuator, names, problem, solution))
    return Estimate(parameters, problem, solution, rivals + again, tuple(findings), correlated, unseen, beside, white)


def _allowed(problem: Problem, solution: Solution, valley: Sequence[Place]) -> tuple[Rival, ...]:
    """The places of a valley that the readings allow."""
    least = solution.evaluation.cost
    variance = least / len(solution.evaluation.residual)
    found = (Rival.at(problem, place, least, variance) for place in valley)
    return tuple(rival for rival in found if rival is not None)


def _still_rivals(problem: Problem, solution: Solution, rivals: Sequence[Rival]) -> tuple[Rival, ...]:
    """Those of other minima that are as good in another problem, where they lie then."""
    names = [unknown.name for unknown in problem.unknowns]
    allowed = solution.evaluation.cost * (1.0 + _RIVAL / len(solution.evaluation.residual))
    found = []
    for rival in rivals:
        if any(rival.reach.values()):  # it need not be as good: the readings cannot tell it from the best
            found.append(rival)
            continue
        theta = np.array([rival.entries.get(name, own) for name, own in zip(names, solution.theta, strict=True)])
        other = polish(problem, theta) or _minimise(problem, theta, evaluations=_SHORTLY)
        if other.evaluation.cost <= allowed:
            found.append(Rival.of(problem, other.theta))
    return tuple(found)


def _asked(problem: Problem, names: FreeParameters) -> list[int]:
    """Entries of the offsets and drifts that nobody freed by name."""
    return [column for column, unknown in enumerate(problem.unknowns) if _is_asked(unknown, names)]


def _is_asked(unknown: Unknown, names: FreeParameters) -> bool:
    """Whether it is an offset or a drift that nobody freed by name."""
    return unknown.base.startswith(("observation.offset.", "observation.drift.")) and (
        unknown.base not in names.observation
    )


def _nearest_zero(problem: Problem, solution: Solution) -> Solution:
    """Where the zero of the coupling is not seen, the one of the actuator's file, if the readings allow it."""
    name = "coupling.zero"
    held = [unknown.name for unknown in problem.unknowns].index(name) if _has(problem, name) else -1
    if held < 0 or not _is_hidden(problem, solution, held):
        return solution
    unknown = problem.unknowns[held]
    wanted = float(np.clip(problem.base[name], unknown.lower, unknown.upper))
    values = problem.values(solution.theta, problem.records[0].place)
    level = values["coupling.gain"] * values[name]
    (place,) = _held(problem, solution, name, [{name: wanted, "coupling.gain": level / wanted}])
    found = place.solution
    per_reading = solution.evaluation.cost / len(solution.evaluation.residual)
    spent = found.evaluations + solution.evaluations
    allowed = found.evaluation.cost <= solution.evaluation.cost + _RIVAL * per_reading
    return replace(found if allowed else solution, evaluations=spent)


def _has(problem: Problem, name: str) -> bool:
    return {name, "coupling.gain"} <= {unknown.name for unknown in problem.unknowns}


def _is_hidden(problem: Problem, solution: Solution, held: int) -> bool:
    zero = problem.unknowns[held].value(float(solution.theta[held]))
    # As the error towards its nearer side, of a zero of which the readings know the reciprocal.
    error = np.log1p(entry_errors(solution.evaluation)[held])
    return zero > fastest_rate(problem.records) or bool(error > DETERMINED)


def _without_idle(problem: Problem, solution: Solution, names: FreeParameters) -> tuple[Problem, Solution]:
    """Take out offsets and starting states that turned out not to be needed."""
    unsure = {r.place for r in problem.records if r.start == "free" and r.run.metadata.starts_from_rest is None}
    groups: dict[tuple[int, str], list[int]] = {}
    for column, unknown in enumerate(problem.unknowns):
        offset = _is_asked(unknown, names)
        if unknown.place is None or not (offset or (unknown.nuisance and unknown.place in unsure)):
            continue
        groups.setdefault((unknown.place, unknown.base if offset else "start"), []).append(column)
    idle = {key: columns for key, columns in groups.items() if is_idle(solution, columns)}
    if not idle:
        return problem, solution
    resting = {place for place, what in idle if what == "start"}
    return _with_less(problem, solution, {column for columns in idle.values() for column in columns}, resting)


def _at_rest(problem: Problem, solution: Solution, resting: Mapping[int, Sequence[int]]) -> tuple[Problem, Solution]:
    """Take out the starting states of some runs: by place, their entries."""
    return _with_less(problem, solution, {column for columns in resting.values() for column in columns}, set(resting))


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
    actuator: Actuator, parameters: Mapping[str, Parameter], names: FreeParameters, records: Sequence[Record]
) -> tuple[Problem, Solution, Minima]:
    """The best minimum, and the others."""
    stage("finding where to start from the readings alone", 0.05, 0.2, 300)
    circuit = _circuit_first(actuator, parameters, names, records)
    points = known_first(actuator, names, records, circuit)
    dear = not (is_lumped(actuator.structure) and all(set(record.readings) == {"current"} for record in records))
    shorter = thinned(records, points[0].delays) if dear else None
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


def _noise_of(records: Sequence[Record]) -> dict[tuple[int, str], float]:
    return {
        (record.place, output): max(reading.noise, 1e-300)
        for record in records
        for output, reading in record.readings.items()
    }


def _search(
    actuator: Actuator,
    parameters: Mapping[str, Parameter],
    names: FreeParameters,
    records: Sequence[Record],
    points: Sequence[StartingPoint],
) -> tuple[Problem, Solution, Minima]:
    """The best minimum from some starts, and the others."""
    noise = _noise_of(records)
    # These have several minima, of which noise can make the wrong one the first.
    explore = any(name.startswith(_SEVERAL_MINIMA) for name in names.actuator)
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
    """The minimum from a point, as near to it as readings can tell where each evaluation is dear."""
    dear = not isinstance(problem.responder, CircuitResponder)
    return minimise(problem, theta, evaluations=evaluations, tolerance=_DEAR if dear else _CHEAP)


def _circuit_first(
    actuator: Actuator, parameters: Mapping[str, Parameter], names: FreeParameters, records: Sequence[Record]
) -> StartingPoint | None:
    """The circuit and its leak from the current alone, where that is dear and the motion is asked for too.

    None where poles and residues find the circuit at once, or where the current does not determine it.
    """
    series = {"circuit.sheet_resistance", "circuit.contact_resistance"}
    electrical = [name for name in names.actuator if name.startswith(_ELECTRICAL)]
    if is_lumped(actuator.structure) or not electrical or len(electrical) == len(names.actuator):
        return None
    with_current = [replace(r, readings={"current": r.readings["current"]}) for r in records if "current" in r.readings]
    if not with_current or series & set(names.actuator) or any(n.startswith("geometry.") for n in names.actuator):
        return None
    own = [f"observation.{what}.current" for what in ("offset", "drift")]
    fewer = FreeParameters(
        tuple(name for name in names.shared if name in electrical),
        tuple(name for name in names.per_run if name in electrical),
        tuple(name for name in names.per_mounting if name in electrical),
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
    return StartingPoint({name: found[name] for name in electrical}, points[0].delays)


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
    series = {"circuit.sheet_resistance", "circuit.contact_resistance"}
    found: list[Place] = []
    circuit = max((error for name, error in errors.items() if name.startswith("circuit.")), default=0.0)
    if circuit > _WEAK and not series & set(names.actuator):
        shares = leak_shares(actuator, values)
        if set(shares[0]) <= set(names.shared):
            found += _held(problem, solution, "circuit.dc_resistivity", shares)
    if {"coupling.gain", "coupling.zero"} <= set(names.shared) and errors["coupling.zero"] > _WEAK:
        found += _held(problem, solution, "coupling.zero", other_zeros(values, problem.records))
    slow = "leak.slow.time_constant"
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
    records: Sequence[Record],
    point: StartingPoint,
    noise: Mapping[tuple[int, str], float],
) -> Problem:
    """The least-squares problem of a fit, with what a starting point knows of its delays."""
    responder: CircuitResponder | ActuatorResponder
    if is_lumped(actuator.structure) and all(set(record.readings) == {"current"} for record in records):
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


def _need_as_many_readings(unknowns: int, records: Sequence[Record]) -> None:
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


def found_noise(problem: Problem, solution: Solution) -> dict[tuple[int, str], float]:
    """Standard deviation of the residuals of each run and output, for the parameters that they had to feed."""
    pieces = problem.pieces
    total = sum(piece.stop - piece.start for piece in pieces.values())
    freedom = max(total - len(problem.unknowns), 1) / total
    noise = {}
    for key, piece in pieces.items():
        residual = solution.evaluation.residual[piece]
        active = max(int(np.count_nonzero(residual)), 1)  # a bound that holds says nothing about noise
        sigma = problem.noise[key] * math.sqrt(float(residual @ residual) / (active * freedom))
        noise[key] = max(sigma, problem.floors[key])
    return noise


def _at_floor(problem: Problem, solution: Solution) -> bool:
    """Whether what is left looks like the noise between neighbouring readings."""
    found = found_noise(problem, solution)
    return all(found[key] < _AT_FLOOR * problem.noise[key] for key in found)


def _weigh(problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
    """Take the weights from the residuals until they no longer change."""
    for _ in range(6):
        noise = found_noise(problem, solution)
        if max(abs(noise[key] / problem.noise[key] - 1.0) for key in noise) < _SAME_NOISE:
            break
        weighed = problem.with_noise(noise)
        here = problem.weighed(solution.evaluation, noise)
        again = polish(weighed, solution.theta, here) or _minimise(weighed, solution.theta)
        spent = again.evaluations + solution.evaluations
        problem, solution = weighed, replace(again, converged=again.converged and solution.converged, evaluations=spent)
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


def _not_at_rest(record: Record) -> Finding:
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


def _impossible_current(problem: Problem, solution: Solution, record: Record) -> Finding | None:
    """A current that not even a short circuit behind the electrodes could draw."""
    reading = record.readings.get("current")
    if reading is None or not len(reading.measured):
        return None
    values = problem.values(solution.theta, record.place)
    structure = Structure.of(values)
    if structure.clamp or structure.line:
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
