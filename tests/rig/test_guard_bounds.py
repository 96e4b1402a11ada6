"""The guard to the last digit: what is at a limit, when it acts, and what blocks and gaps may not change."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain, combinations

import numpy as np
import pytest

from ipmclab.rig.bench import BenchError
from ipmclab.rig.safety.guard import Guard
from ipmclab.rig.safety.guarded_bench import GuardedBench
from ipmclab.rig.safety.limit import Limit
from tests.rig.scripted import ELECTRODES, NOTHING, Scripted
from tests.rig.test_guard import in_blocks

NAN = np.nan


@pytest.mark.parametrize(
    ("name", "most", "at"),
    [
        ("current", 0.15, 0.15),
        ("current", 0.15, -0.15),
        ("displacement", 10e-3, -10e-3),
        ("force", 80e-3, 80e-3),
        ("temperature", 40.0, 40.0),
        ("temperature", 40.0, -5.0),
        # The voltage is read with a tolerance of 2 %, or of 20 mV where that is more.
        ("voltage", 3.5, 3.5 + 0.02 * 3.5),
        ("voltage", 0.5, -0.5 - 0.02),
    ],
)
def test_a_reading_at_its_limit_is_within_it(name: str, most: float, at: float) -> None:
    limits = replace(NOTHING, **{name: Limit(most, least=-5.0 if name == "temperature" else None)})
    beyond = np.nextafter(at, np.copysign(np.inf, at))
    assert in_blocks(limits, 50.0, **{name: np.array([at, at, at])}) == []
    (alarm,) = in_blocks(limits, 50.0, **{name: np.array([at, at, beyond])})
    assert (alarm.limit, alarm.row, alarm.value) == (name, 2, beyond)


def test_a_sum_at_its_limit_is_within_it() -> None:
    """Of 0.1 A at 50 Hz 10 mC flow in 5 rows; what flows at 1.23 V or less splits no water."""
    voltage = np.array([2.0] * 5 + [1.23, -1.23, 1.0, 2.0])
    current = np.array([0.1] * 5 + [0.1, 0.1, 0.1, 1e-9])
    (alarm,) = in_blocks(replace(NOTHING, charge=Limit(10e-3)), 50.0, [2, 4], voltage=voltage, current=current)
    assert (alarm.limit, alarm.row, alarm.value) == ("charge", 8, pytest.approx(10e-3, rel=1e-8))
    # 20 mJ into the strip, and again after what it has given back.
    alarms = in_blocks(replace(NOTHING, energy=Limit(20e-3)), 50.0, [2, 4], voltage=voltage, current=current)
    assert [(alarm.limit, alarm.row) for alarm in alarms] == [("energy", 5), ("energy", 7)]


@pytest.mark.parametrize("rate", [50.0, 1.0, 0.4])
def test_a_mean_at_its_limit_is_within_it(rate: float) -> None:
    """Where the rows are a second apart or more, each reading is its own mean."""
    rows = max(1, round(rate))
    current = np.r_[np.full(rows, 0.1), np.full(2, -0.1), 0.2, 0.1]
    (alarm,) = in_blocks(replace(NOTHING, mean_current=Limit(0.1)), rate, current=current)
    assert (alarm.row, alarm.value) == (rows + 2, pytest.approx(0.1 + 0.1 / rows))


def test_at_50_khz_readings_beyond_all_measure_do_not_turn_a_mean_round() -> None:
    """100 kA for a second are 5e18 nA in all, of 9e18 that fit in 64 bits."""
    readings = {"voltage": np.ones(100_000), "current": np.full(100_000, np.inf)}
    (alarm,) = in_blocks(replace(NOTHING, mean_current=Limit(1.0, 1.5)), 50e3, **readings)
    assert (alarm.row, alarm.value) == (75_000, 1e5)


def test_the_side_of_the_air_on_which_a_limit_is_passed_is_said() -> None:
    limits = replace(NOTHING, relative_humidity=Limit(80.0, least=30.0), current=Limit(0.15))
    humidity, current = np.array([50.0, 25.0, 85.0]), np.array([0.1, -0.2, 0.1])
    current_alarm, low, high = in_blocks(limits, 50.0, relative_humidity=humidity, current=current)
    assert str(low) == "the relative humidity is 25 percent, below its limit of 30 percent"
    assert str(high) == "the relative humidity is 85 percent, beyond its limit of 80 percent"
    assert str(current_alarm) == "the current is -200 mA, beyond its limit of 150 mA"


def test_what_a_slow_instrument_reads_during_a_block_counts_at_its_end() -> None:
    guard = Guard(replace(NOTHING, temperature=Limit(40.0)), 50.0, ELECTRODES)
    block = {"voltage": np.zeros(50)}
    assert guard.look(0, block, {"temperature": np.array([25.0, 25.0])}) == ()
    (alarm,) = guard.look(50, block, {"temperature": np.array([41.0, 25.0])})
    assert (alarm.row, alarm.time) == (99, 1.98)


@pytest.mark.parametrize("given", [None, 0.0])
def test_an_output_is_stuck_that_stays_above_0_1_v_from_the_row_after_the_last(given: float | None) -> None:
    """The row at which it was brought to 0 V may have been sampled before."""
    told = None if given is None else np.full(30, given)
    for volts, found in ((0.1, []), (-0.1, []), (np.nextafter(0.1, 1.0), [15]), (-2.0, [15])):
        guard = Guard(NOTHING, 50.0, ELECTRODES)
        guard.zeroed(4)
        alarms = guard.look(0, {"voltage": np.full(30, volts)}, given=told)
        assert [(alarm.kind, alarm.row) for alarm in alarms] == [("stuck", row) for row in found]


def test_single_rows_show_a_stuck_output_from_the_first_one_after_0_v() -> None:
    bench = Scripted(ELECTRODES, {"voltage": np.full(20, 2.0)})
    guarded = GuardedBench(bench, NOTHING)  # type: ignore[arg-type]
    guarded.open(["voltage"], 50.0)
    guarded.exchange(2.0)
    guarded.zero()
    for _ in range(10):
        guarded.exchange(0.0)
    with pytest.raises(BenchError, match="the output should be at 0 V and 2 V are read"):
        guarded.exchange(0.0)  # 0.2 s after the first


def test_a_reading_that_is_none_is_the_one_before_it_in_sums() -> None:
    """2 V 0.1 A, then a row of which the current is lost and one of which the voltage is."""
    voltage, current = np.array([2.0, 2.0, NAN, 1.0]), np.array([0.1, NAN, 0.2, 0.0])
    limits = replace(NOTHING, energy=Limit(0.79))  # J at 1 Hz: 0.2 + 0.2 + 0.4
    for cuts in ([], [1, 2, 3], [2]):
        (alarm,) = in_blocks(limits, 1.0, cuts, voltage=voltage, current=current)
        assert (alarm.row, alarm.value) == (2, pytest.approx(0.8))
    # Before the first reading nothing is known to flow.
    known, unread = np.ones(4), np.full(4, NAN)
    for voltage, current in ((unread, known), (known, unread)):
        assert all(alarm.kind == "blind" for alarm in in_blocks(limits, 1.0, [2], voltage=voltage, current=current))


def test_lost_rows_count_as_the_first_one_after_them() -> None:
    """However the current goes on from there."""
    for after in ([0.1], [0.1, 0.0]):
        guard = Guard(replace(NOTHING, mean_current=Limit(0.0999)), 50.0, ELECTRODES)
        assert guard.look(0, {"voltage": np.zeros(2), "current": np.full(2, 0.05)}) == ()
        (alarm,) = guard.look(502, {"voltage": np.zeros(len(after)), "current": np.array(after)})
        assert (alarm.row, alarm.value) == (502, pytest.approx(0.1))


def test_no_cut_of_a_record_changes_what_acts_and_when() -> None:
    """Every cut of nine rows: limits that begin at the first row, that break off for one, with readings lost."""
    readings = {
        "voltage": np.array([2.0, 2.0, NAN, 1.5, -2.0, -2.0, 1.0, 3.0, 3.0]),
        "current": np.array([0.3, 0.3, 0.1, 0.3, 0.3, 0.3, NAN, 0.3, 0.0]),
        "displacement": np.array([0.0, 2.0, 0.0, 2.0, 2.0, NAN, 2.0, 0.0, 2.0]),
    }
    limits = replace(
        NOTHING,
        voltage=Limit(2.5, 0.25),
        current=Limit(0.2, 0.5, "warn"),
        displacement=Limit(1.0, 0.25, "warn"),
        mean_current=Limit(0.25, 0.25),
        charge=Limit(0.4),
        energy=Limit(0.2, 0.5),
    )
    whole = in_blocks(limits, 4.0, **readings)
    assert [(alarm.limit, alarm.row) for alarm in whole] == [
        ("energy", 3),
        ("displacement", 4),
        ("current", 5),
        ("mean_current", 7),
        ("charge", 7),
        ("voltage", 8),
        ("energy", 8),
    ]
    inside = range(1, 9)
    for cuts in chain.from_iterable(combinations(inside, count) for count in inside):
        assert sorted(map(repr, in_blocks(limits, 4.0, list(cuts), **readings))) == sorted(map(repr, whole))
