"""A system carried exactly over intervals of any length: however they are cut, and however long they are."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import load_actuator
from ipmclab.rig import exact
from ipmclab.rig.exact import ExactSystem, to_ticks

SYSTEM = load_actuator("friend-2").system
SECOND = 64 * 80_000_000


def advanced(lengths: list[int], inputs: list[float]) -> np.ndarray:
    return ExactSystem(SYSTEM).advance(np.array(lengths, dtype=np.int64), np.array(inputs))


def test_times_are_rounded_to_ticks_of_the_clock() -> None:
    assert to_ticks([0.0, 1.0, 0.02, 0.4 / SECOND, 0.6 / SECOND]).tolist() == [0, SECOND, SECOND // 50, 0, 1]
    assert exact.TICK * SECOND == 1.0


def test_an_interval_may_be_cut_anywhere_and_none_takes_no_time() -> None:
    whole = advanced([3 * SECOND], [2.0])
    cut = advanced([1, 2, 0, 4, 6, 5, SECOND - 18, 2 * SECOND], [2.0] * 8)
    assert cut[:, -1] == pytest.approx(whole[:, -1], rel=1e-10)
    assert np.array_equal(cut[:, 2], cut[:, 1])
    steady = advanced([5, 6, 9, 7], [2.0] * 4)
    assert steady[:, -1] == pytest.approx(advanced([27], [2.0])[:, 0], rel=1e-10)
    assert advanced([], []).shape == (len(SYSTEM.outputs), 0)


def test_a_state_goes_on_where_it_was_left() -> None:
    first = ExactSystem(SYSTEM)
    assert not first.state.any()
    first.advance(np.array([SECOND]), np.array([1.0]))
    second = ExactSystem(SYSTEM, first.state)
    went_on = second.advance(np.array([SECOND]), np.array([-1.0]))
    assert went_on[:, 0] == pytest.approx(advanced([SECOND, SECOND], [1.0, -1.0])[:, 1], rel=1e-12)
    assert not np.array_equal(first.state, second.state)


def test_after_months_at_one_voltage_nothing_moves() -> None:
    rested = advanced([2**56 - 1, 2**57, 2**60 + 1], [1.0, 1.0, 1.0])
    assert np.isfinite(rested).all()
    assert rested[:, 1:] == pytest.approx(np.repeat(rested[:, :1], 2, axis=1), rel=1e-9, abs=1e-15)


def test_the_intervals_that_are_kept_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    lengths = [SECOND // 50 + 1000 * step for step in range(12)]
    at_once = advanced(lengths, [1.0] * 12)
    monkeypatch.setattr(exact, "_KEPT", 3)
    system = ExactSystem(SYSTEM)
    for index, length in enumerate(lengths):
        output = system.advance(np.array([length]), np.array([1.0]))
        assert output[:, 0] == pytest.approx(at_once[:, index], rel=1e-12)
        assert len(system._dense) <= 3
