"""The 95 % of every interval against the printed tables."""

from __future__ import annotations

import pytest

from ipmclab.confidence import NORMAL_95, wider_for_few

TWO_SIDED_95 = {1: 12.706, 2: 4.303, 3: 3.182, 5: 2.571, 10: 2.228, 30: 2.042, 120: 1.980}
"""Student's t for 95 % to both sides, as in the tables of any textbook of statistics."""


@pytest.mark.parametrize(("freedom", "t"), TWO_SIDED_95.items())
def test_few_readings_widen_as_in_the_tables_of_student(freedom: int, t: float) -> None:
    assert wider_for_few(freedom) * NORMAL_95 == pytest.approx(t, abs=5e-4)
    assert pytest.approx(1.96, abs=5e-5) == NORMAL_95
