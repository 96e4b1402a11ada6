"""Circuits of given time constants from a linear problem, and the valley that begins there."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ipmclab import Actuator, Run, RunMetadata, identify, load_actuator, simulate
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.response import lumped
from ipmclab.identification.search.branch_times import BranchTimes
from ipmclab.identification.search.branch_valley import Tied, branch_valley
from ipmclab.identification.search.solve import minimise
from ipmclab.identification.solved import solved
from ipmclab.model.stages.circuit import SHEET
from ipmclab.model.variants import with_stages

FloatArray = npt.NDArray[np.float64]
FREE = ("electrical", SHEET)


def drawn(strip: Actuator, signal: str, noise: float, seed: int, duration: float = 40.0, rate: float = 25.0) -> Run:
    """A record of its current from rest."""
    clean = simulate(strip, signal, duration=duration, rate=rate)
    assert clean.current is not None
    current = clean.current + noise * np.random.default_rng(seed).standard_normal(len(clean))
    rest = RunMetadata(signal=signal, starts_from_rest=True)
    return Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current, metadata=rest)


def fitted(run: Run, branches: int) -> tuple[Problem, FloatArray]:
    """The problem of a fit, and where it ended."""
    actuator = with_stages(load_actuator("friend-2"), f"branches={branches}")
    estimate = solved(identify(actuator, run, free=FREE))
    return estimate.problem.plain, estimate.solution.theta


@cache
def problem_of(sheet: float, signal: str) -> Problem:
    """A circuit with a known sheet resistance that is read under a signal."""
    strip = load_actuator("friend-2").replace(**{SHEET: sheet})
    return solved(identify(strip, drawn(strip, signal, 1e-5, 0), free="electrical")).problem.plain


@given(
    resistivity=st.floats(0.1, 30.0),
    permittivity=st.floats(0.02, 3.0),
    sheet=st.sampled_from([1e-6, 1.3, 6.0]),
    signal=st.sampled_from(["step 1 V delay=1 s", "square 1 V 0.1 Hz", "chirp 1 V 0.02 Hz 2 Hz"]),
)
def test_about_the_true_circuit_the_linear_problem_gives_it_back(
    resistivity: float, permittivity: float, sheet: float, signal: str
) -> None:
    problem = problem_of(sheet, signal)
    values = {
        **problem.base,
        "circuit.branches.1.resistivity": resistivity,
        "circuit.branches.1.permittivity": permittivity,
    }
    circuit = lumped(2, values)
    own = circuit.resistances * circuit.capacitances
    assume(max(own) > 1.5 * min(own) and 0.05 < own[1] < 100.0)  # two branches, and the record shows both
    theta = np.array([unknown.entry(values[unknown.base]) for unknown in problem.unknowns])
    rows = problem.evaluate(theta).rows
    rows[-1] = 0.0  # readings without noise
    times = np.array([own[0], 0.3 * own.min(), own[1], 3.0 * own.max()])
    table = BranchTimes.of(problem, theta, Evaluation(rows), times, 2)
    assert table is not None
    for held, branch in ((0, 0), (2, 1)):
        assert table.start(held, branch) == pytest.approx(theta, abs=1e-5)


def test_what_is_held_stays_where_it_is_held() -> None:
    strip = with_stages(load_actuator("friend-2"), "branches=3")
    problem, theta = fitted(drawn(strip, "step 1 V delay=1 s", 3e-5, 1), 3)
    times = np.geomspace(0.05, 200.0, 9)
    table = BranchTimes.of(problem, theta, problem.evaluate(theta), times, 3)
    assert table is not None
    found = [table.start(held, branch) for held in range(9) for branch in range(3)]
    assert any(start is not None for start in found)
    for place, start in enumerate(found):
        if start is not None:
            circuit = lumped(3, problem.values(start, 0))
            assert (circuit.resistances * circuit.capacitances)[place % 3] == pytest.approx(times[place // 3], rel=1e-9)


def test_without_a_free_element_there_is_none() -> None:
    run = drawn(load_actuator("friend-2"), "step 1 V delay=1 s", 3e-5, 1)
    estimate = solved(identify(load_actuator("friend-2"), run, free="circuit.branches.0.resistivity"))
    problem, theta = estimate.problem.plain, estimate.solution.theta
    assert BranchTimes.of(problem, theta, problem.evaluate(theta), np.array([0.1, 1.0]), 2) is None


def test_no_drawn_start_finds_a_place_that_the_walk_missed() -> None:
    """Two branches of a strip that has more: with the time of one held, the other has minima on either side of it."""
    strip = with_stages(load_actuator("friend-2"), "branches=3").replace(**{SHEET: 6.0})
    problem, theta = fitted(drawn(strip, "step 1 V delay=5 s", 3e-5, 0), 2)
    solution = minimise(problem, theta)
    least, variance = solution.evaluation.cost, solution.evaluation.cost / len(solution.evaluation.residual)
    generator = np.random.default_rng(20261121)
    places = [place.solution for place in branch_valley(problem, solution, 2)]
    # The sum of the two entries of one branch is what the walk changes by even steps.
    pairs = [(2, 3), (4, 5)]
    names = [unknown.name for unknown in problem.unknowns]
    assert [names[entry].rsplit(".", 1)[1] for entry in (*pairs[0], *pairs[1])] == ["resistivity", "permittivity"] * 2
    totals = {pair: np.array([place.theta[list(pair)].sum() for place in places]) for pair in pairs}
    held = next(pair for pair in pairs if np.ptp(np.diff(np.sort(totals[pair]))) < 1e-6)
    allowed = 0
    for place, total in zip(places, totals[held], strict=True):
        of_time = Tied(problem, *held, float(total))
        found = place.evaluation.cost
        allowed += found - least < 12.0 * variance
        for _ in range(3):
            start = np.delete(solution.theta, held[1]) + generator.normal(0.0, 1.5, len(theta) - 1)
            other = minimise(of_time, np.clip(start, of_time.lower + 1e-6, of_time.upper - 1e-6)).evaluation.cost
            assert other - least > 12.0 * variance or other > found - 0.1 * variance
    assert allowed >= 5
