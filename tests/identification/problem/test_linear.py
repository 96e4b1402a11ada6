"""Which unknowns of a fit enter linearly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import Actuator, load_actuator, simulate
from ipmclab.identification.problem.free import parse_free
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import PreparedRun, prepare
from ipmclab.identification.problem.response import ActuatorResponder
from ipmclab.identification.problem.unknowns import unknowns_of
from ipmclab.model.variants import with_stages
from ipmclab.quality import check
from ipmclab.run import Run
from tests.identification.brief import brief
from tests.identification.many import noisy

STEP = "step 1 V delay=1 s"
RATIO = "relaxation.displacement.0.ratio"


def problem_of(actuator: Actuator, records: list[PreparedRun], free: str, starts: int = 2) -> Problem:
    names = parse_free(actuator.parameter_values, free)
    states = {record.place: starts for record in records}
    unknowns = unknowns_of(names, actuator.parameters(), records, states=states)
    noise = {(record.place, output): 1.0 for record in records for output in record.readings}
    return Problem(actuator.parameter_values, records, unknowns, ActuatorResponder(actuator), noise)


def records_of(count: int) -> list[PreparedRun]:
    friend = load_actuator("friend-2")
    generator = np.random.default_rng(20261127)
    runs: list[Run] = [noisy(generator, STEP, strip=friend, outputs=("displacement",)) for _ in range(count)]
    return [prepare(run, place, ["displacement"], check(run)) for place, run in enumerate(runs)]


def linear(problem: Problem) -> set[str]:
    return {one.name for one, is_linear in zip(problem.unknowns, problem.linear, strict=True) if is_linear}


FREE = "coupling,observation.offset.displacement,observation.drift.displacement"
OF_SENSOR = {"observation.offset.displacement[0]", "observation.drift.displacement[0]"}
OF_START = {"observation.initial_state.0[0]", "observation.initial_state.1[0]"}


@pytest.mark.parametrize("stage", ["", "+leak.cubic", "+laser"])
def test_sensors_and_starts_of_linear_models_are(stage: str) -> None:
    found = linear(problem_of(load_actuator(f"friend-2{stage}"), records_of(1), FREE))
    assert found == (OF_SENSOR if stage else OF_SENSOR | OF_START)


def test_what_moves_the_residuals_in_proportion_is_what_is_linear() -> None:
    """Twice the step of such an entry moves the residual twice as far, and of no other one."""
    problem = problem_of(load_actuator("friend-2"), records_of(1), FREE, starts=0)
    theta = np.array([one.entry(problem.base.get(one.base, 0.0)) for one in problem.unknowns])
    plain = problem.evaluate(theta).residual
    for place, is_linear in enumerate(problem.linear):
        steps = [problem.evaluate(theta + size * np.eye(len(theta))[place]).residual - plain for size in (0.5, 1.0)]
        if np.linalg.norm(steps[1]) > 0.0:
            assert np.allclose(steps[1], 2.0 * steps[0], rtol=1e-6) == is_linear, problem.unknowns[place].name


def test_what_is_added_is_in_no_derivative_but_its_own() -> None:
    """The derivatives by all others are the same wherever it is; that by a time constant grows with the ratio."""
    strip = load_actuator("friend-2+relaxation.displacement")
    problem = problem_of(strip, records_of(1), f"{FREE},relaxation", starts=0)
    theta = np.array([one.entry(problem.base.get(one.base, 0.0)) for one in problem.unknowns])
    plain = problem.evaluate(theta).jacobian
    assert {one.name for one, added in zip(problem.unknowns, problem.added, strict=True) if added} == OF_SENSOR
    assert problem.linear.sum() == 1 + problem.added.sum()
    for place in np.flatnonzero(problem.linear):
        others = np.arange(len(theta)) != place
        moved = problem.evaluate(theta + 0.5 * np.eye(len(theta))[place]).jacobian
        assert np.array_equal(moved[:, others], plain[:, others]) == problem.added[place], problem.unknowns[place].name


def test_of_a_run_with_readings_that_are_bounds_nothing_is() -> None:
    first, second = records_of(2)
    reading = second.readings["displacement"]
    side = reading.side.copy()
    side[-3:] = 1
    bounded = replace(second, readings={"displacement": replace(reading, side=side)})
    found = linear(problem_of(load_actuator("friend-2"), [first, bounded], FREE))
    assert found == OF_SENSOR | OF_START


@pytest.mark.parametrize("at_rest", [True, False])
def test_what_is_linear_is_so_beside_all_that_is(at_rest: bool) -> None:
    """A ratio multiplies the state in which a run begins: where that is free the two are not linear together."""
    strip = with_stages(load_actuator("friend-2"), "relaxation.displacement").replace(
        **{RATIO: 0.6, "relaxation.displacement.0.time_constant": 3.0}
    )
    clean = simulate(strip, "square 1 V 0.1 Hz delay=1 s", duration=30.0, rate=25.0)
    assert clean.displacement is not None
    moved = clean.displacement + 1e-6 * np.random.default_rng(3).standard_normal(len(clean))
    begun = 0 if at_rest else 40
    run = Run.from_arrays(
        time=clean.time[begun:] - clean.time[begun],
        voltage=clean.voltage[begun:],
        displacement=moved[begun:],
        hold=clean.hold,
    )
    rest = replace(run.metadata, starts_from_rest=at_rest)
    fit = brief(strip, replace(run, metadata=rest), "coupling.gain,relaxation,observation.offset.displacement")
    estimate = fit.estimate
    assert estimate is not None
    problem, theta = estimate.problem.plain, estimate.solution.theta
    linear = np.flatnonzero(problem.linear)
    names = [problem.unknowns[place].base for place in linear]
    assert (RATIO in names) is at_rest
    assert any(name.startswith("observation.initial_state.") for name in names) is not at_rest
    here = problem.evaluate(theta)
    generator = np.random.default_rng(4)
    for _ in range(5):
        there = theta.copy()
        there[linear] += np.maximum(np.abs(theta[linear]), 1.0) * generator.uniform(-1.0, 1.0, len(linear))
        straight = here.residual + here.jacobian[:, linear] @ (there - theta)[linear]
        found = problem.evaluate(there).residual
        np.testing.assert_allclose(found, straight, atol=1e-8 * np.abs(straight).max())
