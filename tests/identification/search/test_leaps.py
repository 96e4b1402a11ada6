"""On along a bent valley in which a search creeps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import pytest

from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.search.descent import minimum
from ipmclab.identification.search.leaps import led_on
from ipmclab.identification.search.solve import LIMIT, PATIENCE, minimise

Array = npt.NDArray[np.float64]

NARROW = 1e5
"""Times its noise a reading falls short where the delay is off by a row."""


class Bent:
    """What a delay has passed of a fast decay: exp(-rate) of a row, and noise that 100 readings have beside it.

    Another reading asks for a rate of e^6, or of one as high as its bound.
    """

    linear = added = np.zeros(2, dtype=bool)
    on_means, is_circuit = None, False

    def __init__(self, end: float) -> None:
        self.lower, self.upper = np.array([-20.0, -3.0]), np.array([end, 3.0])

    def evaluate(self, theta: Array) -> Evaluation:
        rate, delay = theta
        passed = np.exp(-rate)
        rows = np.zeros((3, 102))
        rows[:, 0] = NARROW * passed, NARROW, NARROW * (delay - passed)
        rows[:, 1] = 3.0, 0.0, 3.0 * (rate - 6.0)
        rows[2, 2:] = np.where(np.arange(100) % 2, 1.0, -1.0)
        return Evaluation(rows)


@pytest.mark.parametrize(("end", "rate"), [(20.0, 6.0), (4.0, 4.0)])
def test_leaps_come_to_the_end_of_a_valley_in_which_a_search_creeps(end: float, rate: float) -> None:
    problem, begin = Bent(end), np.array([0.0, 1.0])
    crept = minimise(problem, begin, evaluations=100, patience=PATIENCE)
    assert crept.message == LIMIT
    assert crept.theta[0] < rate - 1.0
    found = led_on(problem, begin, crept)
    assert found.evaluations < crept.evaluations + 200
    last = minimise(problem, found.theta, found.evaluation, evaluations=100, patience=PATIENCE)
    assert last.converged
    assert last.theta == pytest.approx([rate, np.exp(-rate)], abs=0.03)


def test_a_search_that_has_not_moved_leads_nowhere() -> None:
    problem, begin = Bent(20.0), np.array([0.0, 1.0])
    stopped = replace(minimise(problem, begin, evaluations=1), theta=begin, evaluation=problem.evaluate(begin))
    found = led_on(problem, begin, stopped)
    assert found.theta is stopped.theta
    assert found.evaluations == stopped.evaluations


def test_a_whole_search_that_creeps_to_its_limit_is_led_on_and_a_short_one_ends_there() -> None:
    problem, begin = cast(Any, Bent(20.0)), np.array([0.0, 1.0])
    found = minimum(problem, begin)
    assert found.converged
    assert found.evaluations > 300
    assert found.theta == pytest.approx([6.0, np.exp(-6.0)], abs=0.03)
    short = minimum(problem, begin, evaluations=100)
    assert (short.message, short.evaluations) == (LIMIT, 100)
