"""The minimum itself, wherever near it a search has stopped: on a problem whose residuals bend and do not vanish."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from ipmclab import Run, RunMetadata, load_actuator
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.search.descent import found_noise, minimum, weigh
from ipmclab.identification.search.settled import SETTLED, settled, settled_with_unfelt_held
from ipmclab.identification.search.solve import Solution
from ipmclab.identification.solved import solved
from tests.identification.brief import brief
from tests.identification.many import noisy

TIME = np.linspace(0.0, 4.0, 60)
READINGS = 2.0 * np.exp(-0.7 * TIME) + 0.1 * np.random.default_rng(20261121).standard_normal(60)


class Decay:
    """exp(a - exp(b) t), inside bounds."""

    def __init__(self, lower: float = -9.0) -> None:
        self.lower, self.upper = np.array([-9.0, lower]), np.array([9.0, 9.0])
        self.linear = np.zeros(2, dtype=bool)
        self.added = self.linear

    def evaluate(self, theta: np.ndarray) -> Evaluation:
        model = np.exp(theta[0] - np.exp(theta[1]) * TIME)
        rows = np.vstack([model, -np.exp(theta[1]) * TIME * model, model - READINGS])
        return Evaluation(rows)


def stopped(problem: Decay, theta: np.ndarray) -> Solution:
    return Solution(theta, problem.evaluate(theta), True, "", 1)


def test_wherever_a_search_stopped_the_minimum_is_one() -> None:
    problem = Decay()
    expected = minimize(lambda theta: problem.evaluate(theta).cost, [0.7, -0.4], method="Nelder-Mead", tol=1e-13).x
    generator = np.random.default_rng(20261121)
    found = [settled(problem, stopped(problem, expected + 3e-3 * generator.standard_normal(2))) for _ in range(10)]
    assert np.ptp([one.theta for one in found], axis=0).max() < 1e-10
    np.testing.assert_allclose(found[0].theta, expected, atol=1e-6)  # half of the digits of a cost
    assert all(one.evaluations < 14 for one in found)


class Bent:
    """Two entries, one of which bends a large residual so much that a Gauss-Newton step goes five times too far."""

    def __init__(self) -> None:
        self.lower, self.upper = np.full(2, -9.0), np.full(2, 9.0)
        self.linear = np.zeros(2, dtype=bool)
        self.added = self.linear

    def evaluate(self, theta: np.ndarray) -> Evaluation:
        one, other = theta
        residual = np.concatenate([[one - 0.1, one + other, 5.0 + 0.5 * one**2 + 0.2 * one**3], np.full(20, 0.1)])
        rows = np.zeros((3, len(residual)))
        rows[0, :3], rows[1, 1] = [1.0, 1.0, one + 0.6 * one**2], 1.0
        rows[2] = residual
        return Evaluation(rows)


@pytest.mark.parametrize("away", [1e-3, -1e-3, 2e-2])
def test_where_each_gauss_newton_step_ends_farther_away_the_minimum_is_found_all_the_same(away: float) -> None:
    """Of (x - 0.1)^2 + (5 + x^2/2 + x^3/5)^2: at the root of its slope."""
    bent = np.polynomial.Polynomial([5.0, 0.0, 0.5, 0.2])
    slope = np.polynomial.Polynomial([-0.1, 1.0]) + bent * bent.deriv()
    expected = min(slope.roots(), key=abs).real
    found = settled(Bent(), stopped(Bent(), np.array([expected + away, -expected])))
    np.testing.assert_allclose(found.theta, [expected, -expected], atol=1e-9)


def test_what_presses_on_its_bound_stays_there_and_the_others_settle() -> None:
    problem = Decay(lower=-0.2)  # the minimum lies at -0.36
    there = minimize(lambda entry: problem.evaluate(np.array([entry[0], -0.2])).cost, [0.8]).x[0]
    starts = [np.array([there + away, -0.2 + 2e-4]) for away in (-1e-3, 1e-3)]
    found = [settled(problem, stopped(problem, start)) for start in starts]
    assert found[0].theta[1] == pytest.approx(-0.2, abs=2e-6)
    assert abs(found[0].theta[0] - found[1].theta[0]) < 1e-10
    assert abs(found[0].evaluation.rows[0] @ found[0].evaluation.residual) < 1e-8


class HardlyFelt(Decay):
    """The same beside two entries of which the readings feel a trace: derivatives lead far out of their ranges."""

    def __init__(self) -> None:
        super().__init__()
        self.lower, self.upper = np.append(self.lower, [-9.0, -9.0]), np.append(self.upper, [9.0, 9.0])
        self.linear = np.zeros(4, dtype=bool)
        self.added = self.linear

    def evaluate(self, theta: np.ndarray) -> Evaluation:
        rows = super().evaluate(theta[:2]).rows
        traces = 1e-9 * np.vstack([np.cos(TIME), np.sin(3.0 * TIME)])
        return Evaluation(np.vstack([rows[:2], traces, rows[2] + theta[2:] @ traces]))


def test_what_is_hardly_felt_stays_and_the_others_settle() -> None:
    alone = Decay()
    expected = minimize(lambda theta: alone.evaluate(theta).cost, [0.7, -0.4], method="Nelder-Mead", tol=1e-13).x
    expected = settled(alone, stopped(alone, expected)).theta
    away = 3e-3 * np.random.default_rng(20261127).standard_normal((5, 2))
    for one in away:
        found = settled_with_unfelt_held(HardlyFelt(), stopped(HardlyFelt(), np.append(expected + one, [3.0, -5.0])))
        np.testing.assert_array_equal(found.theta[2:], [3.0, -5.0])
        np.testing.assert_allclose(found.theta[:2], expected, atol=1e-7)  # the traces move it by some 1e-8


def test_what_is_determined_is_at_its_minimum_beside_parameters_that_are_hardly_felt() -> None:
    """A current that is a zero and noise: branches and leak went to their bounds, the zero is known."""
    generator = np.random.default_rng([20261127, 3])
    current = 1e-3 + 1e-4 * (np.cumsum(generator.standard_normal(400)) + generator.standard_normal(400))
    time = np.arange(400) / 50.0
    resting = RunMetadata(starts_from_rest=True)
    voltage = np.where(time > 1.0, 1.0, 0.0)
    run = Run.from_arrays(time=time, voltage=voltage, current=current, hold="zero", metadata=resting)
    fit = brief(load_actuator("friend-2"), run, free="electrical,observation.offset.current", followed=False)
    name = "observation.offset.current[0]"
    assert fit.parameters[name].determined
    estimate = solved(fit)
    place = [unknown.name for unknown in estimate.problem.unknowns].index(name)
    further = settled_with_unfelt_held(estimate.problem, estimate.solution).theta - estimate.solution.theta
    unit = estimate.problem.unknowns[place].scale
    assert abs(further[place]) * unit < 1e-6 * fit.parameters[name].standard_error


def test_far_from_any_minimum_nothing_is_done() -> None:
    problem = Decay()
    start = stopped(problem, np.array([3.0, 1.0]))
    assert settled(problem, start) is start


def test_a_search_that_was_left_is_only_the_start_of_the_one_under_other_weights() -> None:
    """The fit is a minimum of the last weights; whether that of the first ones was reached says nothing."""
    run = noisy(np.random.default_rng(1), "step 1 V delay=1 s", outputs=("current",), duration=20.0, rate=20.0)
    estimate = solved(brief(load_actuator("friend-2"), run, followed=False))
    problem, solution = estimate.problem, estimate.solution
    other = problem.with_noise({key: 2.0 * noise for key, noise in problem.noise.items()})
    left = replace(solution, evaluation=other.evaluate(solution.theta), converged=False, message="left")
    found = weigh(other, left)[1]
    assert found.converged
    assert found.message != "left"
    np.testing.assert_allclose(found.theta, solution.theta, atol=1e-9)
    # Under the same weights nothing has been searched again.
    assert not weigh(problem, replace(solution, converged=False))[1].converged


def test_weights_that_move_the_parameters_far_are_followed_until_they_stay() -> None:
    """A circuit that is held at wrong values leaves of two outputs what each weighs against the other by."""
    wrong = {"circuit.branches.0.permittivity": 0.14, "circuit.dc_resistivity": 85.6}
    slow = {"coupling.gain": 4.26e-9, "coupling.zero": 221.0, "coupling.p1": 10.0, "coupling.p2": 30.0}
    friend = load_actuator("friend-2")
    run = noisy(
        np.random.default_rng(1),
        "step 1 V delay=1 s",
        strip=friend.replace(**wrong, **slow),
        outputs=("displacement", "force"),
        rate=50.0,
    )
    found = solved(brief(friend, run, "coupling,beam.modulus", followed=False)).correlated
    noise = found_noise(found.problem, found.solution.evaluation)
    assert max(abs(noise[key] / found.problem.noise[key] - 1.0) for key in noise) < SETTLED


def test_runs_that_disagree_are_weighed_until_the_fit_is_a_minimum_of_its_own_weights() -> None:
    """A fit that follows one run more is led on by its weights: after six of these steps it was no minimum at all."""
    friend = load_actuator("friend-2")
    # The fit does not know the first of these.
    times = {"circuit.sheet_resistance": 0.8, "circuit.branches.0.permittivity": 0.365, "coupling.p2": 0.4}
    strip = friend.replace(**{name: factor * friend[name] for name, factor in times.items()})
    generator = np.random.default_rng(206)
    runs = [
        noisy(generator, signal, strip=strip, outputs=("current", "force"), duration=8.0, rate=50.0)
        for signal in ("sine 1 V 0.2 Hz", "step 1 V delay=1 s")
    ]
    found = solved(brief(friend, runs, "electrical,coupling", followed=False)).correlated
    lower = minimum(found.problem, found.solution.theta).evaluation.cost
    assert lower > (1.0 - 1e-6) * found.solution.evaluation.cost
