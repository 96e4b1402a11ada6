"""From a solved problem to the fit that is given out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ipmclab.confidence import NORMAL_95
from ipmclab.fit.fit import DETERMINED, Direction, Fit, FittedParameter
from ipmclab.fit.fit_table import changed
from ipmclab.fit.output_diagnosis import OutputDiagnosis
from ipmclab.fit.set_point import set_point_findings
from ipmclab.identification.observed import observation, residuals
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.stated import stated_covariance
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.identification.search.doubts import message, unexplained
from ipmclab.identification.search.solve import Solution
from ipmclab.identification.search.valleys import Rival
from ipmclab.identification.solved import Estimate
from ipmclab.identification.uncertainty.covariance import MOVED, Uncertainty, covariance_table, uncertainty
from ipmclab.identification.uncertainty.interval import (
    as_determined,
    edges_are_open,
    half_width,
    has_open_end,
    interval_of,
    is_at_bound,
    is_too_wide,
    open_ends,
    values_within_bounds,
    with_rivals,
)
from ipmclab.identification.uncertainty.noise_found import drift_findings, noise_findings
from ipmclab.identification.uncertainty.unmodelled import unmodelled
from ipmclab.identification.undetermined.cures import fast_modes
from ipmclab.identification.undetermined.diagnosis import (
    direction_of_one,
    directions,
    in_order,
    names_it,
    relative_errors,
)
from ipmclab.identification.undetermined.known_quantities import Point, known_quantities
from ipmclab.identification.undetermined.leaning import leaning_findings
from ipmclab.identification.undetermined.practical import practical
from ipmclab.model import Actuator
from ipmclab.model.environment.age import AGE, Age
from ipmclab.model.order import Order
from ipmclab.named_matrix import Table, table_of
from ipmclab.run import Finding, FloatArray, Run
from ipmclab.units import CHANNELS
from ipmclab.version import __version__


def build_fit(
    actuator: Actuator,
    runs: Sequence[Run],
    result: Estimate,
    findings: tuple[Finding, ...],
    diagnoses: tuple[OutputDiagnosis, ...] = (),
    *,
    followed: bool = True,
) -> Fit:
    """Errors, intervals (bent ones ``followed`` along profiles), correlations, diagnosis and the fitted actuator."""
    problem, solution, parameters = result.problem, result.solution, actuator.parameters()
    free = {unknown.base for unknown in problem.unknowns}
    stated = stated_covariance(
        actuator, [n for n, p in parameters.items() if n not in free and p.standard_uncertainty > 0.0]
    )
    exact = _exact_names(actuator, problem, free | set(stated))
    found = uncertainty(result.correlated, stated, exact)
    asked = [unknown for _, unknown in problem.asked]
    values = np.array([unknown.value(float(solution.theta[place])) for place, unknown in problem.asked])
    relative = relative_errors(asked, values, found)
    reference = problem.in_reference(solution.theta, problem.records[0].place)
    order = Order(reference)
    rivals = [rival.sorted_as(problem, reference) for rival in result.rivals]
    model = Actuator(actuator.name, reference)
    open_edges = edges_are_open(asked, found)
    alone = [
        interval_of(result.correlated, found, number, error, open_edges=open_edges, followed=followed)
        for number, error in enumerate(relative.tolist())
    ]
    points = _points(result, found, rivals, stated, exact, [end for one in alone for end in one.ends])
    # That a stage does not show is no proof that it is not there: what trades against it is known no better than with
    # it. So each unknown has another entry and another standard error while the unseen stages may still be there.
    while_kept = {
        unknown.name: (float(point.theta[place]), math.sqrt(max(variance, 0.0)))
        for point in points[1:]
        for (place, unknown), variance in zip(
            point.problem.asked, point.found.covariance.diagonal().tolist(), strict=True
        )
    }
    elsewhere = {
        unknown.name: [rival for rival in rivals if one.is_left_by(unknown, rival)]
        for unknown, one in zip(asked, alone, strict=True)
    }
    ambiguous = {name for name, others in elsewhere.items() if others}
    reported_twice = ambiguous | {*while_kept}
    nearer = [math.inf if u.name in reported_twice else one.error for u, one in zip(asked, alone, strict=True)]
    sharper = as_determined(found, relative, np.array(nearer))
    open_directions = directions(asked, values, found, sharper, problem.records, model, rivals, exact)
    beyond = {n for d in open_directions if math.isinf(d.error) for n, c in d.coefficients.items() if abs(c) > MOVED}
    fitted: dict[str, FittedParameter] = {}
    for number, (place, unknown) in enumerate(problem.asked):
        name = order(unknown.name)
        error = math.inf if unknown.name in beyond else float(relative[number])
        nearer_error = math.inf if unknown.name in beyond else nearer[number]
        value = float(values[number])
        # Along an open direction a linear unknown is at the file's value, which may be its bound.
        at_bound = (unknown.log or math.isfinite(error)) and is_at_bound(unknown, float(solution.theta[place]))
        others = [(r.entries[unknown.name], r.reach[unknown.name]) for r in elsewhere[unknown.name]]
        is_open = unknown.name in beyond and not at_bound
        first = open_ends(unknown) if is_open else (alone[number].low, alone[number].high)
        interval, agree = with_rivals(unknown, float(solution.theta[place]), first, others)
        variance = float(found.covariance[number, number])
        wider = half_width(unknown, interval) / NORMAL_95 if unknown.name in ambiguous else 0.0
        if unknown.log and wider**2 > variance:
            variance, error = wider**2, max(error, wider)
        if unknown.name in while_kept:
            middle, deviation = while_kept[unknown.name]
            reach = NORMAL_95 * deviation
            ends = values_within_bounds(unknown, middle - reach, middle + reach)
            interval = min(interval[0], ends[0]), max(interval[1], ends[1])
            variance = max(variance, deviation**2, (middle - float(solution.theta[place])) ** 2)
            error = max(error, math.sqrt(variance) / unknown.size(value))
        fitted[name] = FittedParameter(
            name=name,
            value=value,
            unit=parameters[unknown.base].unit if unknown.base in parameters else _unit(unknown.base),
            symbol=parameters[order(unknown.base)].symbol if unknown.base in parameters else "",
            standard_error=math.inf if math.isinf(error) else math.sqrt(max(variance, 0.0)) * unknown.chain(value),
            interval=interval,
            determined=agree
            and min(error, nearer_error) <= DETERMINED
            and not at_bound
            and not has_open_end(unknown, interval)
            and not is_too_wide(unknown, interval),
            at_bound=at_bound,
            prior=unknown.beforehand,
        )
    for unknown in (unknown for one in result.unseen for unknown in one.unknowns):
        # A parameter of a stage that the readings do not show may be anything.
        name, declared = order(unknown.name), parameters[order(unknown.base)]
        fitted[name] = FittedParameter(
            name=name,
            value=problem.base[unknown.base],
            unit=declared.unit,
            symbol=declared.symbol,
            standard_error=math.inf,
            interval=open_ends(unknown),
            determined=False,
        )
    in_file = {name: place for place, name in enumerate(actuator.parameter_values)}
    fitted = {name: fitted[name] for name in sorted(fitted, key=lambda n: (in_file.get(n.split("[")[0], math.inf), n))}
    renamed = [
        replace(d, coefficients={order(n): c for n, c in d.coefficients.items()}, sentence=order(d.sentence))
        for d in open_directions
    ]
    named = tuple(in_order(renamed, list(fitted)))
    named += tuple(
        Direction(
            {order(unknown.name): len(one.unknowns) ** -0.5 for unknown in one.unknowns}, order(one.sentence), math.inf
        )
        for one in result.unseen
    )
    named = tuple(replace(d, coefficients=dict.fromkeys(fitted, 0.0) | dict(d.coefficients)) for d in named)
    why = {True: "it went to its bound", False: "other values fit as well"}
    fast = {order(name) for name in fast_modes(model, problem.records)}
    named += tuple(
        direction_of_one(list(fitted), name, why[p.at_bound], problem.records, fast)
        for name, p in fitted.items()
        if not p.determined and not any(names_it(direction, name) for direction in named)
    )
    known = np.isfinite(relative) & np.array([unknown.name not in beyond for unknown in asked], dtype=bool)
    correlations = _correlations(list(fitted), [order(unknown.name) for unknown in asked], found, known)
    observations = tuple(
        observation(result.correlated, record, runs[record.place], order) for record in problem.records
    )
    all_findings = (
        *findings,
        *unexplained(problem, result.correlated.left),
        *_fit_findings(solution, found, fitted, stated, exact, asked, order, named),
        *noise_findings(result.correlated, found),
        *drift_findings(problem, observations),
    )
    fit = Fit(
        actuator=actuator,
        parameters=fitted,
        undetermined=named,
        correlations=correlations,
        rank=found.rank,
        singular_values=tuple(float(value) for value in found.singular_values),
        observations=observations,
        findings=all_findings,
        converged=solution.converged,
        message=message(solution, all_findings),
        evaluations=solution.evaluations,
        residuals=residuals(result.correlated),
        software_version=__version__,
        practical=practical(problem, values, solution.evaluation, order),
        covariance=_covariance(asked, values, found, stated, order),
        diagnoses=diagnoses,
        known=known_quantities(actuator, points),
        unmodelled=unmodelled(result.correlated, model, order),
        estimate=result,
    )
    fit = replace(fit, actuator=_fitted_actuator(actuator, problem, solution, fit, order))
    held = set_point_findings(fit)
    fit = replace(fit, findings=(*fit.findings, *held)) if held else fit
    return changed(fit)


def _points(
    result: Estimate,
    found: Uncertainty,
    rivals: Sequence[Rival],
    stated: Table,
    exact: Sequence[str],
    far: Sequence[FloatArray],
) -> list[Point]:
    """The fit, and the one in which the stages that do not show may still be there."""
    read = [record.place for record in result.problem.records if "current" in record.readings]
    of_sensor = {place: result.correlated.of_sensor((place, "current")) for place in read}
    points = [Point(result.problem, result.solution.theta, found, stated, rivals, far, of_sensor)]
    if result.with_unseen is not None:
        problem, solution = result.with_unseen.problem, result.with_unseen.solution
        points.append(Point(problem, solution.theta, uncertainty(result.with_unseen, stated, exact), stated))
    return points


def _exact_names(actuator: Actuator, problem: Problem, taken: set[str]) -> list[str]:
    """Fixed parameters without a stated uncertainty on which the answer leans."""
    candidates = ["circuit.sheet_resistance"]
    if not problem.is_circuit:
        candidates += ["geometry.thickness", "beam.modulus"]
    if any(record.readings.keys() & {"displacement", "force"} for record in problem.records):
        candidates += [name for name in actuator.parameter_values if name.startswith("coupling.")]
    return [name for name in candidates if name not in taken and name in actuator.parameter_values]


def _unit(base: str) -> str:
    if base == "observation.delay":
        return "s"
    if base.startswith(AGE):
        return Age.of(base).unit
    unit = CHANNELS[base.rsplit(".", 1)[1]].unit
    return unit if base.startswith("observation.offset") else f"{unit}/s"


def _correlations(
    names: Sequence[str], asked: Sequence[str], found: Uncertainty, known: npt.NDArray[np.bool_]
) -> dict[str, dict[str, float]]:
    """Between all parameters of a fit: NaN where one of them is not known."""
    deviation = np.sqrt(np.maximum(found.covariance.diagonal(), 1e-300))
    most = deviation[:, None] * deviation
    matrix = np.eye(len(names))
    matrix[matrix == 0.0] = np.nan
    places = [names.index(name) for name, is_known in zip(asked, known, strict=True) if is_known]
    matrix[np.ix_(places, places)] = (found.covariance.clip(-most, most) / most)[np.ix_(known, known)]
    np.fill_diagonal(matrix, 1.0)
    return table_of(names, matrix)


def _covariance(
    asked: Sequence[Unknown], values: FloatArray, found: Uncertainty, stated: Table, order: Order
) -> dict[str, dict[str, float]]:
    names = [order(unknown.name) for unknown in asked]
    chains = [unknown.chain(float(value)) for unknown, value in zip(asked, values, strict=True)]
    held = {order(one): {order(other): value for other, value in row.items()} for one, row in stated.items()}
    return covariance_table(names, found.covariance, chains, {order(one): found.slopes[one] for one in stated}, held)


def _fitted_actuator(actuator: Actuator, problem: Problem, solution: Solution, fit: Fit, order: Order) -> Actuator:
    every = [problem.in_reference(solution.theta, record.place) for record in problem.records]
    means = np.mean([[run[name] for name in actuator.parameter_values] for run in every], axis=0)
    values = {order(name): mean for name, mean in zip(actuator.parameter_values, means.tolist(), strict=True)}
    free = {unknown.base for unknown in problem.unknowns}
    uncertain = {order(name): one for name, one in actuator.standard_uncertainties.items() if name not in free}
    for name, parameter in fit.parameters.items():
        if name in values and parameter.determined:
            uncertain[name] = parameter.standard_error
    return Actuator(
        name=actuator.name,
        parameter_values={name: values[name] for name in actuator.parameter_values},
        standard_uncertainties=uncertain,
        sample=actuator.sample,
    )


def _fit_findings(
    solution: Solution,
    found: Uncertainty,
    fitted: Mapping[str, FittedParameter],
    stated: Table,
    exact: Sequence[str],
    asked: Sequence[Unknown],
    order: Order,
    named: Sequence[Direction],
) -> list[Finding]:
    findings = []
    if not solution.converged:
        said = f"the search did not converge: {solution.message}"
        findings.append(Finding("not-converged", "error", said, "free fewer parameters, or give longer runs"))
    findings += [
        Finding("undetermined", "warning", direction.sentence, "", values=dict(direction.coefficients))
        for direction in named
    ]
    repair = "the model lacks something that the readings show, or the parameter has no effect on them: fix it"
    for one in fitted.values():
        if one.at_bound:
            said = f"{one.name} went to its bound, {one.value:.6g} {one.unit}".rstrip()
            findings.append(Finding("at-bound", "warning", said, repair))
    return [*findings, *leaning_findings(found, fitted, stated, exact, asked, order)]
