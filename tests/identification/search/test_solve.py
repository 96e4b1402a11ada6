"""The search on what a model leaves, where derivatives are far apart."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.search.descent import minimum_near
from ipmclab.identification.search.projected import Projected
from ipmclab.identification.search.solve import PATIENCE, descend, minimise

Array = npt.NDArray[np.float64]


class Lines:
    """Readings that hang on three unknowns in proportion, on the last one by so little; the first two end at bounds."""

    lower, upper = np.array([-20.0, -20.0, -np.inf]), np.array([2.0, 20.0, np.inf])
    linear = np.array([False, False, True])
    added = np.zeros(3, dtype=bool)
    on_means, is_circuit = None, False

    def __init__(self, little: float) -> None:
        generator = np.random.default_rng(20261123)
        self.columns = generator.standard_normal((3, 6)) * np.array([[1.0], [1e-7], [little]])
        self.target = 3.0 * self.columns[0]
        self.asked = 0

    def evaluate(self, theta: Array) -> Evaluation:
        self.asked += 1
        return Evaluation(np.vstack([self.columns, theta @ self.columns - self.target]))


@pytest.mark.parametrize("little", [1.0, 1e-9, 1e-40, 1e-170, 1e-214, 1e-300, 0.0])
def test_an_unknown_that_no_reading_feels_stops_no_search(little: float) -> None:
    """A drawn record ended in SciPy's overflow: a drift that no reading felt was moved in steps of 1e214."""
    start = np.array([1.0, 2.0, -1e95 if little < 1e-100 else 0.0])
    assert minimise(Lines(little), start).theta[0] == pytest.approx(2.0, abs=0.01)


class Meeting:
    """t^2 exp(-t) and noise, read as three decays: the nearer their rates, the better they follow."""

    lower, upper = np.array([-np.inf] * 3 + [-5.0] * 3), np.array([np.inf] * 3 + [5.0] * 3)

    def __init__(self, *, projected: bool = False) -> None:
        self.linear = np.array([projected] * 3 + [False] * 3)
        self.added = np.zeros(6, dtype=bool)
        self.time = np.linspace(0.0, 8.0, 400)
        self.readings = 100.0 * self.time**2 * np.exp(-self.time)
        self.readings += np.random.default_rng(20261126).standard_normal(400)
        self.asked = 0

    def evaluate(self, theta: Array) -> Evaluation:
        self.asked += 1
        sizes, rates = theta[:3], np.exp(theta[3:])
        decays = np.exp(-np.outer(rates, self.time))
        return Evaluation(
            np.vstack([decays, -(sizes * rates)[:, None] * self.time * decays, sizes @ decays - self.readings])
        )


def test_a_search_along_a_valley_without_an_end_ends_where_the_readings_tell_no_more() -> None:
    problem = Meeting()
    begin = np.array([100.0, -100.0, 100.0, 0.5, 0.0, -0.5])
    found = minimise(problem, begin, evaluations=1000, patience=PATIENCE)
    assert found.converged
    assert problem.asked < 500
    shapes = problem.time ** np.arange(3)[:, None] * np.exp(-problem.time)
    met = np.linalg.lstsq(shapes.T, problem.readings, rcond=None)[1][0]
    assert found.evaluation.cost < met + 1.0


def test_a_search_that_falls_too_slowly_is_left_and_one_that_gets_there_is_not() -> None:
    begin = np.array([100.0, -100.0, 100.0, 0.5, 0.0, -0.5])
    first = Meeting().evaluate(begin).cost
    whole = minimise(Meeting(), begin, evaluations=100)
    left = minimise(Meeting(), begin, evaluations=100, fall=first)  # down to nothing, below all noise
    assert not left.converged
    assert "too slowly" in left.message
    assert left.evaluations < whole.evaluations
    far = first - 2.0 * whole.evaluation.cost
    assert minimise(Meeting(), begin, evaluations=100, fall=far).evaluation.cost == whole.evaluation.cost


@pytest.mark.parametrize("apart", [1e-2, 1e-3, 1e-4])
def test_decays_that_nearly_meet_follow_as_well_as_apart(apart: float) -> None:
    """Their sizes are left out of the search: what they follow is known to a square of how far they lie apart."""
    problem = Meeting(projected=True)
    begin = np.array([0.0, 0.0, 0.0, apart, 0.0, -apart])
    shapes = problem.time ** np.arange(3)[:, None] * np.exp(-problem.time)
    met = np.linalg.lstsq(shapes.T, problem.readings, rcond=None)[1][0]
    assert Projected(problem, begin).evaluate(begin[3:]).cost < 1.01 * met


def test_linear_entries_may_be_more_than_the_readings() -> None:
    problem = Meeting(projected=True)
    problem.time, problem.readings = problem.time[[3, 9]], problem.readings[[3, 9]]
    begin = np.array([0.0, 0.0, 0.0, 0.5, 0.0, -0.5])
    assert Projected(problem, begin).evaluate(begin[3:]).cost == pytest.approx(0.0, abs=1e-20)


def test_the_last_look_at_a_minimum_is_no_step() -> None:
    """Whatever the limit of evaluations is, the search gives an answer."""
    for limit in range(28, 36):
        begin = np.array([100.0, -100.0, 100.0, 0.5, 0.0, -0.5])
        assert minimise(Meeting(), begin, evaluations=limit, patience=PATIENCE).theta.size == 6


def test_what_enters_linearly_is_left_out_of_a_search() -> None:
    """Three decays in a third of the evaluations, from sizes that are off by any factor, and as low as with them."""
    begin = np.array([1e9, -1e7, 3.0, 0.5, 0.0, -0.5])
    without, whole = Meeting(projected=True), Meeting()
    found = minimise(without, begin, evaluations=1000, patience=PATIENCE)
    other = minimise(whole, begin, evaluations=1000, patience=PATIENCE)
    assert found.converged
    assert 3 * without.asked < whole.asked
    assert found.evaluation.cost < other.evaluation.cost + 0.1
    # At the rates found, the sizes are those of a linear least-squares fit.
    decays = np.exp(-np.outer(np.exp(found.theta[3:]), without.time))
    least = np.linalg.lstsq(decays.T, without.readings, rcond=1e-14)[1][0]
    assert found.evaluation.cost == pytest.approx(least, rel=1e-6)


class Overflowing(Meeting):
    """The same, whose decays are not finite for rates beyond e^3."""

    def evaluate(self, theta: Array) -> Evaluation:
        found = super().evaluate(theta)
        return Evaluation(found.rows * np.inf) if theta[3:].max() > 3.0 else found


def test_a_search_without_linear_entries_steps_back_from_what_is_not_finite() -> None:
    with np.errstate(invalid="ignore"):
        found = minimise(Overflowing(projected=True), np.array([1.0, 1.0, 1.0, 2.9, 2.0, -4.0]), evaluations=1000)
    assert np.isfinite(found.evaluation.cost)
    assert found.evaluation.cost < 1e4


def test_where_all_is_linear_one_step_is_the_answer() -> None:
    lines = Lines(1.0)
    lines.linear = np.ones(3, dtype=bool)
    lines.added = np.zeros(3, dtype=bool)
    lines.lower, lines.upper = np.full(3, -np.inf), np.full(3, np.inf)
    found = minimise(lines, np.array([-1e6, 1e9, 0.0]))
    assert found.converged
    assert found.evaluation.cost < 1e-12


@pytest.mark.parametrize("search", [descend, minimum_near])
def test_a_search_from_near_a_minimum_says_how_often_it_has_asked_the_model(search: Any) -> None:
    """The first point was asked for the Gauss-Newton steps, and missing in what a fit says of its evaluations."""
    problem = Lines(1.0)
    problem.upper = np.array([20.0, 20.0, np.inf])
    found = search(problem, np.array([1.0, 2.0, 0.0]))
    assert found.converged
    assert found.evaluations == problem.asked
