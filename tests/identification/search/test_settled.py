"""The minimum itself, wherever near it a search has stopped: on a problem whose residuals bend and do not vanish."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from ipmclab.identification.problem.problem import Evaluation
from ipmclab.identification.search.solve import Solution, settled

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
