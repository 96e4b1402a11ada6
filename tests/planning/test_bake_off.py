"""A tiny twin of ``benchmarks.next_runs``."""

from __future__ import annotations

import numpy as np

from benchmarks.next_runs import by_information


def test_proposed_runs_need_half_the_time_of_the_thesis_plan() -> None:
    ratios, errors, runs = by_information(2, 3.0)
    assert np.all(ratios <= 0.5)
    assert np.all(errors < 0.5)
    assert np.all(runs < 9)
