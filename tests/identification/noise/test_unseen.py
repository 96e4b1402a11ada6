"""Which stages are left out because the readings do not show them."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab.identification.noise import unseen
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.search.solve import Solution


def left(size: float, rows: int) -> Solution:
    return Solution(np.zeros(4), Evaluation(size * np.vstack([np.zeros((4, rows)), np.ones((1, rows))])), True, "", 1)


@pytest.mark.parametrize(
    ("times", "rows", "worse"),
    [
        (1.18, 1600, True),  # a real strip at 3 V: 1.64 mA without its leak that grows, 1.39 with it
        (1.04, 1600, False),  # nobody sees it in a figure, whatever white noise would say
        (1.18, 12, False),  # so few rows feign it
    ],
)
def test_a_stage_without_which_the_prediction_is_worse_is_kept(times: float, rows: int, worse: bool) -> None:
    """Noise that fades slowly enough would describe whatever it explains."""
    assert (left(times, rows).evaluation.cost > unseen._most(left(1.0, rows), 3)) is worse
