"""Pairs of both polarities, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab.errors import InputError
from ipmclab.quality import pair
from ipmclab.run import Run

TIME = np.arange(2000) / 50.0
TURNING = 2e-3 * (1.0 - np.exp(-TIME / 3.0))
DRIFT = 5e-4 + 1e-4 * TIME
EVEN = 3e-4 * np.sin(TIME) ** 2


def run_of(sign: float, rows: int = 2000, **changes: np.ndarray) -> Run:
    columns = {"time": TIME, "voltage": np.full(2000, sign), "force": sign * TURNING + DRIFT + EVEN}
    return Run.from_arrays(**{name: values[:rows] for name, values in (columns | changes).items()})  # type: ignore[arg-type]


def test_what_turns_with_the_voltage_and_what_does_not_come_apart() -> None:
    found = pair(run_of(1.0), run_of(-1.0, rows=1500))
    assert len(found.time) == 1500
    np.testing.assert_allclose(found.half_difference["force"], TURNING[:1500], atol=1e-15)
    np.testing.assert_allclose(found.half_sum["force"], (DRIFT + EVEN)[:1500], atol=1e-15)
    # The same with the runs exchanged, but for the sign of what turns.
    other = pair(run_of(-1.0), run_of(1.0))
    np.testing.assert_allclose(other.half_difference["force"], -TURNING, atol=1e-15)
    np.testing.assert_allclose(other.half_sum["force"], DRIFT + EVEN, atol=1e-15)


def test_it_is_told_in_a_line_for_each_channel() -> None:
    gap = np.where(TIME > 30.0, np.nan, -TURNING + 1e-3)
    found = pair(run_of(1.0, force=TURNING + 1e-3, current=0.02 * TURNING / 2e-3), run_of(-1.0, force=gap))
    assert found.texts() == (
        "force: half the difference of the pair peaks at 2 mN, half the sum is 1 mN rms (50 % of that)",
    )
    assert np.isnan(found.half_sum["force"][-1])


@pytest.mark.parametrize(
    ("other", "says"),
    [
        (run_of(1.0), "the voltages are not opposite: their sum reaches 2 V"),
        (run_of(-1.0, time=TIME * 2.0), "other times"),
    ],
)
def test_what_is_no_pair(other: Run, says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        pair(run_of(1.0), other)
    assert caught.value.code == "no-pair"
