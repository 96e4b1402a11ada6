"""What a reading moves by as the delay grows, against differences; time lines of other delays."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.model.numerics.timeline import timeline
from ipmclab.run import Hold


def test_a_row_on_a_corner_of_the_voltage_takes_the_mean_of_both_slopes() -> None:
    time = 0.1 * np.arange(12)
    voltage = np.array([0.0, 1.0, 2.0, 1.5, 1.0, 1.0, 1.0, -2.0, 0.0, 3.0, 2.0, 2.0])
    step = 1e-3  # [s]; the voltage consists of straight lines, so that the difference is exact
    later, earlier = (timeline(time, voltage, "first", delay=delay, from_rest=True) for delay in (step, -step))
    inside = slice(1, -1)
    found = timeline(time, voltage, "first", delay=0.0, from_rest=True).reading_rate[inside]
    np.testing.assert_allclose(found, (later.reading - earlier.reading)[inside] / (2.0 * step), rtol=1e-9, atol=1e-9)


@given(
    steps=st.lists(st.sampled_from([0.03, 0.04, 0.04, 0.05]), min_size=3, max_size=12),
    levels=st.data(),
    hold=st.sampled_from(["zero", "zero-before"]),
    from_rest=st.booleans(),
    delay=st.floats(-0.12, 0.12),
    by=st.floats(-0.02, 0.02),
)
def test_edges_between_the_same_rows_make_one_time_line_of_other_durations(
    steps: list[float], levels: st.DataObject, hold: Hold, from_rest: bool, delay: float, by: float
) -> None:
    time = np.concatenate([[0.0], np.cumsum(steps)])
    drawn = levels.draw(st.lists(st.sampled_from([0.0, 1.0, 2.0]), min_size=len(time), max_size=len(time)))
    voltage = np.array(drawn)
    one, other = (timeline(time, voltage, hold, delay=one, from_rest=from_rest) for one in (delay, delay + by))
    moved = one.delayed(by)
    if moved is None:  # an edge came to a row on the way, or was on one
        assert not one.room[0] < by < one.room[1]
        return
    for name in ("start", "end", "row", "reading", "rate", "jump", "reading_rate", "arrives", "leaves"):
        np.testing.assert_array_equal(getattr(moved, name), getattr(other, name))
    np.testing.assert_allclose(moved.durations[moved.interval], other.durations[other.interval], atol=1e-8)
    np.testing.assert_allclose(moved.room, other.room, atol=1e-12)
    # The way back leads to where it began.
    back = moved.delayed(-by)
    assert back is not None
    np.testing.assert_allclose(back.durations, one.durations, atol=1e-12)


def test_edges_may_move_as_far_as_to_the_next_row_and_no_farther() -> None:
    time, voltage = 0.1 * np.arange(8), np.array([0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 2.0, 0.0])
    line = timeline(time, voltage, "zero", delay=0.03, from_rest=True)
    assert line.room == pytest.approx((-0.03, 0.07), abs=1e-6)
    assert line.delayed(0.0699) is not None
    assert line.delayed(0.0701) is None
    assert line.delayed(-0.0301) is None
    assert timeline(time, voltage, "zero", delay=0.0, from_rest=True).delayed(1e-3) is None
    assert timeline(time, voltage, "first", delay=0.03, from_rest=True).delayed(1e-3) is None


def test_intervals_of_one_length_that_change_unlike_are_of_two_kinds() -> None:
    """In the middle between rows what lies before an edge is as long as what lies behind it."""
    time, voltage = 0.1 * np.arange(8), np.array([0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0])
    moved = timeline(time, voltage, "zero", delay=0.05, from_rest=True).delayed(0.02)
    other = timeline(time, voltage, "zero", delay=0.07, from_rest=True)
    assert moved is not None
    np.testing.assert_allclose(moved.durations[moved.interval], other.durations[other.interval], rtol=1e-9)
