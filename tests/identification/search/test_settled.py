"""The minimum itself, wherever near it a search has stopped: on a problem whose residuals bend and do not vanish."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from ipmclab import identify, load_actuator
from ipmclab.identification.problem.problem import Evaluation
from ipmclab.identification.search.descent import weigh
from ipmclab.identification.search.solve import Solution, settled
from ipmclab.identification.solved import solved
from tests.identification.many import noisy

TIME = np.linspace(0.0, 4.0, 60)
READINGS = 2.0 * np.exp(-0.7 * TIME) + 0.1 * np.random.default_rng(20261121).standard_normal(60)


class Decay:
    """exp(a - exp(b) t), inside bounds."""

    def __init__(self, lower: float = -9.0) -> None:
        self.lower, self.upper = np.array([-9.0, lower]), np.array([9.0, 9.0])

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


def test_what_presses_on_its_bound_stays_there_and_the_others_settle() -> None:
    problem = Decay(lower=-0.2)  # the minimum lies at -0.36
    there = minimize(lambda entry: problem.evaluate(np.array([entry[0], -0.2])).cost, [0.8]).x[0]
    starts = [np.array([there + away, -0.2 + 2e-4]) for away in (-1e-3, 1e-3)]
    found = [settled(problem, stopped(problem, start)) for start in starts]
    assert found[0].theta[1] == pytest.approx(-0.2, abs=2e-6)
    assert abs(found[0].theta[0] - found[1].theta[0]) < 1e-10
    assert abs(found[0].evaluation.rows[0] @ found[0].evaluation.residual) < 1e-8


def test_far_from_any_minimum_nothing_is_done() -> None:
    problem = Decay()
    start = stopped(problem, np.array([3.0, 1.0]))
    assert settled(problem, start) is start


def test_a_search_that_was_left_is_only_the_start_of_the_one_under_other_weights() -> None:
    """The fit is a minimum of the last weights; whether that of the first ones was reached says nothing."""
    run = noisy(np.random.default_rng(1), "step 1 V delay=1 s", outputs=("current",), duration=20.0, rate=20.0)
    estimate = solved(identify(load_actuator("friend-2"), run))
    problem, solution = estimate.problem, estimate.solution
    other = problem.with_noise({key: 2.0 * noise for key, noise in problem.noise.items()})
    left = replace(solution, evaluation=other.evaluate(solution.theta), converged=False, message="left")
    found = weigh(other, left)[1]
    assert found.converged
    assert found.message != "left"
    np.testing.assert_allclose(found.theta, solution.theta, atol=1e-9)
    # Under the same weights nothing has been searched again.
    assert not weigh(problem, replace(solution, converged=False))[1].converged
