"""What every benchmark reports: a ratio with a bound is judged, one without is not."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.harness import Ratio


@pytest.mark.parametrize(
    ("bounds", "told"),
    [
        ({}, "|  |  |"),
        ({"at_most": 10.0}, "| at most 10 | holds |"),
        ({"at_most": 2.0}, "| at most 2 | FAILS |"),
        ({"at_least": 4.0}, "| at least 4 | FAILS |"),
        ({"at_least": 1.0, "at_most": 3.0}, "| at least 1, at most 3 | holds |"),
    ],
)
def test_a_ratio_is_judged_by_its_bounds_only(bounds: dict[str, float], told: str) -> None:
    assert str(Ratio("one / other", np.array([2.0, 3.0, 4.0]), **bounds)).endswith(told)
