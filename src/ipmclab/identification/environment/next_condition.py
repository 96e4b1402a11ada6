"""Which law the runs know least, and in which condition one more run would give most information on it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Final

import numpy as np

from ipmclab.fit.fit import Fit
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import PreparedRun
from ipmclab.identification.search.solve import Solution
from ipmclab.model.environment import Environment, equilibrium
from ipmclab.model.environment.laws import is_of_environment
from ipmclab.model.environment.sorption import slope
from ipmclab.model.order import Order
from ipmclab.normal_equations import inverse
from ipmclab.run import Finding, FloatArray
from ipmclab.strip_state.in_state import InState, in_state
from ipmclab.strip_state.run_state import RunState
from ipmclab.strip_state.state_of_run import HUMIDITY_ERROR

UNDETERMINED: Final = "law-undetermined"
NEXT: Final = "next-condition"

HUMIDITIES: Final = (30.0, 45.0, 60.0, 70.0, 80.0, 90.0)  # percent
TEMPERATURES: Final = (15.0, 25.0, 40.0)
"""Conditions that common chambers reach, in percent and degC."""

_WORTH: Final = 0.8  # of a standard error: a run that leaves more is not worth its time


def next_condition(fit: Fit, problem: Problem, solution: Solution) -> list[Finding]:
    """``law-undetermined`` for each law that the runs leave open, with its cure; else ``next-condition``.

    A run in a new condition is taken to be as long and as quiet as the one of the fit in the nearest state, and its
    humidity as uncertain as a good sensor leaves it.

    Parameters
    ----------
    fit : Fit
    problem : Problem
    solution : Solution
    """
    laws = [name for name in fit.parameters if is_of_environment(name) and name in fit.covariance]
    states = [record.state for record in problem.records if record.state is not None]
    if not laws or any(state.water_content is None for state in states):
        return []
    order = Order(problem.in_reference(solution.theta, problem.records[0].place))
    asked = [place for place, unknown in enumerate(problem.unknowns) if order(unknown.name) in fit.covariance]
    known = solution.evaluation.jacobian
    products = known.T @ known
    others = [place for place in range(len(problem.unknowns)) if place not in asked]
    information = _without(products, asked, others)
    named = [order(problem.unknowns[place].name) for place in asked]
    scales = {order(unknown.name): unknown.scale for unknown in problem.unknowns}
    now = _errors(information)
    after = {
        place: _errors(information + _information_of(problem, solution, asked, *place))
        for place in product(HUMIDITIES, TEMPERATURES)
    }
    open_ones = [name for name in laws if not fit.parameters[name].determined]
    worst = max(laws, key=lambda name: fit.parameters[name].standard_error / scales[name])
    found = []
    for name in open_ones or [worst]:
        number = named.index(name)
        best = min(after, key=lambda place: float(after[place][number]))
        left = float(after[best][number] / now[number])
        if open_ones or not left > _WORTH:
            found.append(_finding(fit, name, best, left, states, is_open=bool(open_ones)))
    return found


def _finding(
    fit: Fit, name: str, place: tuple[float, float], left: float, states: Sequence[RunState], *, is_open: bool
) -> Finding:
    humidity, temperature = place
    one = fit.parameters[name]
    there = f"{temperature:g} degC, {humidity:g} %RH"
    reason = after = ""
    if math.isfinite(one.standard_error):
        reason = f" (standard error {fit.actuator.parameters()[name].quantity.text(one.standard_error)})"
        after = f": {100.0 * left:.2g} % of that error"
    values = {"relative_humidity": humidity, "temperature": temperature, "error_left": left}
    if is_open:
        return Finding(
            UNDETERMINED,
            "warning",
            f"a run at {there} would determine {name} best, which runs at {_range(states)} do not determine{reason}",
            f"record it and fit it with the others{after}",
            values=values,
        )
    return Finding(
        NEXT,
        "info",
        f"{name} is the law that is known least{reason}",
        f"one more run at {there} would leave {100.0 * left:.2g} % of that error",
        values=values,
    )


def _errors(information: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.maximum(inverse(information).diagonal(), 0.0)))


def _range(states: Sequence[RunState]) -> str:
    warm = sorted({state.temperature for state in states if state.temperature is not None})
    wet = sorted({state.relative_humidity for state in states if state.relative_humidity is not None})
    ranges = [(f"{each[0]:.3g}", f"{each[-1]:.3g}", unit) for each, unit in ((warm, "degC"), (wet, "%RH")) if each]
    return " and ".join(f"{low if low == high else f'{low} to {high}'} {unit}" for low, high, unit in ranges)


def _information_of(
    problem: Problem, solution: Solution, asked: Sequence[int], humidity: float, temperature: float
) -> FloatArray:
    """The information of one more run, its water content averaged out."""
    values = problem.in_reference(solution.theta, problem.records[0].place)
    water = equilibrium(values, Environment(temperature, humidity)).water_content
    uncertainty = float(slope(values, humidity / 100.0)) * HUMIDITY_ERROR / 100.0
    new = RunState(water, uncertainty, "assumed", temperature, humidity)
    runs = [(record, state) for record in problem.records if (state := record.state) is not None]
    record, old = min(runs, key=lambda run: sum(abs(a - b) for a, b in zip(run[1].place, new.place, strict=True)))
    state = replace(new, doses=old.doses)
    unknowns = [problem.unknowns[place] for place in asked]
    shared = [u.base if u.base in values and u.belongs_to(record.place) else "" for u in unknowns]
    names = [name for name in shared if name]
    here = in_state(values, state, names)
    rows = iter(here.by)
    moves = np.array(
        [
            next(rows) * unknown.chain(values[name]) if name else np.zeros(len(here.names))
            for unknown, name in zip(unknowns, shared, strict=True)
        ]
        + [here.by_water * uncertainty]
    )
    single = moves @ _of_parameters(problem, solution, record, here) @ moves.T
    last = len(unknowns)
    single[last, last] += 1.0
    return _without(single, range(last), [last])


def _of_parameters(problem: Problem, solution: Solution, record: PreparedRun, here: InState) -> FloatArray:
    """The information of a run as of the fit about the parameters that its strip has, its sensors known."""
    found = problem.responder.respond(
        record,
        here.values,
        here.names,
        problem.delay(solution.theta, record),
        problem.start(solution.theta, record.place),
    )
    total = np.zeros((len(here.names), len(here.names)))
    for row, (output, reading) in enumerate(record.readings.items()):
        columns = found.parameters[row][reading.used] / problem.noise[record.place, output]
        if ("offset", output) in record.unsettled:
            columns = columns - columns.mean(axis=0)
        total += columns.T @ columns
    return total


def _without(products: FloatArray, kept: Sequence[int], others: Sequence[int]) -> FloatArray:
    """Information about some unknowns, the others averaged out."""
    own = products[np.ix_(kept, kept)]
    across = products[np.ix_(kept, others)]
    return np.asarray(own - across @ np.linalg.pinv(products[np.ix_(others, others)], hermitian=True) @ across.T)
