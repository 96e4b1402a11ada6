"""The guard against closed forms, and against itself with the rows cut otherwise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import IpmclabError
from ipmclab.rig.channels import THESIS_RIG, Rig
from ipmclab.rig.safety.guard import Alarm, Guard
from ipmclab.rig.safety.guarded_bench import GuardedBench, LimitPassed
from ipmclab.rig.safety.limit import Limit
from ipmclab.rig.safety.limits import Limits
from tests.rig.scripted import ELECTRODES, NOTHING, Scripted


def in_blocks(
    limits: Limits, rate: float, cuts: list[int] | None = None, rig: Rig = ELECTRODES, **readings: np.ndarray
) -> list[Alarm]:
    """All alarms of a record that is cut into blocks at some rows."""
    guard = Guard(limits, rate, rig)
    readings.setdefault("voltage", np.zeros(len(next(iter(readings.values())))))
    count = len(readings["voltage"])
    edges = [0, *sorted(set(cuts or [])), count]
    alarms: list[Alarm] = []
    for first, stop in pairwise(edges):
        if first < stop:
            alarms += guard.look(first, {name: values[first:stop] for name, values in readings.items()})
    return alarms


def ended_by(guarded: GuardedBench) -> Alarm | None:
    """The limit that the next row passes, if it passes one."""
    try:
        guarded.exchange(0.5)
    except LimitPassed as passed:
        return passed.alarm
    return None


def in_single_rows(
    limits: Limits, rate: float, cuts: list[int] | None = None, rig: Rig = ELECTRODES, **readings: np.ndarray
) -> list[Alarm]:
    """The alarms of a record that is read row by row, up to the one that ends it."""
    alarms: list[Alarm] = []
    readings.setdefault("voltage", np.zeros(len(next(iter(readings.values())))))
    bench = Scripted(rig, readings)
    guarded = GuardedBench(bench, limits, on_warning=alarms.append)  # type: ignore[arg-type]
    guarded.open(list(readings), rate)
    for row in range(len(readings["voltage"])):
        ending = ended_by(guarded)
        if ending is not None:
            # The output is at 0 V within this very row, and no voltage is taken any more.
            assert (ending.action, ending.row) == ("zero", row)
            assert bench.output == [0.5] * (row + 1) + [0.0]
            assert ended_by(guarded) == ending
            assert bench.row == row + 1
            return [*alarms, ending]
    assert bench.output == [0.5] * len(readings["voltage"])
    return alarms


Look = Callable[..., list[Alarm]]


@pytest.fixture(params=[in_blocks, in_single_rows])
def look(request: pytest.FixtureRequest) -> Look:
    """All alarms of a record, however it is read."""
    return request.param


@pytest.mark.parametrize("rate", [50.0, 333.0, 10_000.0])
@pytest.mark.parametrize("duration", [0.0, 0.02, 0.05, 0.5])
def test_a_limit_acts_when_it_has_been_passed_for_its_duration(look: Look, rate: float, duration: float) -> None:
    rows = int(2.0 * rate)
    current = np.where(np.arange(rows) >= rate // 2, -0.2, 0.1)
    (alarm,) = look(replace(NOTHING, current=Limit(0.15, duration)), rate, current=current)
    first = int(rate // 2)
    # The first row at which the current has been beyond the limit for at least the duration.
    assert alarm.row == next(row for row in range(first, rows) if (row - first) / rate >= duration - 1e-12)
    assert alarm.time == alarm.row / rate
    assert (alarm.limit, alarm.value, alarm.most, alarm.action) == ("current", -0.2, 0.15, "zero")


def test_a_break_begins_the_duration_anew(look: Look) -> None:
    current = np.array([0.2, 0.2, 0.2, 0.1, 0.2, 0.2, 0.2, 0.2, 0.2, 0.2])
    limits = replace(NOTHING, current=Limit(0.15, 0.06))
    assert [alarm.row for alarm in look(limits, 50.0, current=current)] == [7]
    # A warning comes once each time,
    limits = replace(NOTHING, current=Limit(0.15, 0.02, "warn"))
    assert [alarm.row for alarm in look(limits, 50.0, current=np.repeat(current, 50), cuts=[70, 260])] == [1, 201]
    # and once a second at most.
    assert [alarm.row for alarm in look(limits, 50.0, current=np.tile(current, 15), cuts=[7, 33])] == [1, 55, 105]


@pytest.mark.parametrize("rate", [50.0, 1000.0])
def test_the_mean_current_is_a_convolution(look: Look, rate: float) -> None:
    generator = np.random.default_rng(20261121)
    current = generator.normal(0.0, 0.1, int(5 * rate)) * np.linspace(0.0, 1.5, int(5 * rate))
    mean = np.convolve(np.abs(current), np.full(int(rate), 1.0 / rate))[: len(current)]
    most = 0.8 * mean.max()
    (alarm, *_) = look(replace(NOTHING, mean_current=Limit(most)), rate, current=current)
    assert alarm.row == np.flatnonzero(mean > most)[0]
    assert alarm.value == pytest.approx(mean[alarm.row], rel=1e-8)


def test_the_power_is_that_into_the_strip_without_the_shunt(look: Look) -> None:
    rate, count = 100.0, 400
    voltage, current = np.full(count, 2.0), np.full(count, 0.1)
    # After 1 s the mean is 2 V 0.1 A at the electrodes, or (2 V - 0.1 A 1 ohm) 0.1 A upstream of the shunt.
    for rig, power in ((ELECTRODES, 0.2), (THESIS_RIG, 0.19)):
        limits = replace(NOTHING, power=Limit(0.95 * power))
        (alarm,) = look(limits, rate, rig=rig, voltage=voltage, current=current)
        assert alarm.row == pytest.approx(95, abs=1)
        assert alarm.value == pytest.approx(0.95 * power, rel=0.02)
        assert not look(replace(NOTHING, power=Limit(1.01 * power)), rate, rig=rig, voltage=voltage, current=current)


def test_the_charge_is_an_integral_of_what_flows_above_1_23_v(look: Look) -> None:
    rate, tau, peak = 1000.0, 2.0, 0.1
    time = np.arange(int(10 * rate)) / rate
    current = peak * np.exp(-time / tau)
    voltage = np.where(time < 1.0, 1.2, -1.5)
    # From 1 s on: peak tau (exp(-1/tau) - exp(-t/tau)) = most.
    most = 0.05
    when = -tau * np.log(np.exp(-1.0 / tau) - most / (peak * tau))
    (alarm,) = look(replace(NOTHING, charge=Limit(most)), rate, voltage=voltage, current=current)
    assert alarm.time == pytest.approx(when, abs=2.0 / rate)
    assert alarm.value == pytest.approx(most, rel=2e-3)


def test_the_energy_is_an_integral_that_a_discharge_takes_from(look: Look) -> None:
    rate = 100.0
    into = np.concatenate([np.full(300, 0.1), np.full(300, -0.05), np.full(600, 0.1)])
    voltage = np.full(1200, 1.0)
    # 0.3 J after 3 s, 0.15 J after 6 s, 0.35 J after 8 s.
    (alarm,) = look(replace(NOTHING, energy=Limit(0.35)), rate, voltage=voltage, current=into)
    assert alarm.time == pytest.approx(8.0, abs=0.02)


def test_the_reading_of_the_voltage_has_a_tolerance_and_no_other(look: Look) -> None:
    noise = np.random.default_rng(20261121).normal(0.0, 1e-3, 500)
    assert not look(NOTHING, 50.0, voltage=3.5 + noise)
    (alarm, *_) = look(NOTHING, 50.0, voltage=3.6 + noise)
    assert alarm.row == 1
    assert str(alarm) == f"the voltage is {alarm.value:.4g} V, beyond its limit of 3.5 V for 0.02 s"


@st.composite
def _records(draw: st.DrawFn) -> tuple[dict[str, np.ndarray], list[int]]:
    count = draw(st.integers(2, 120))
    near = st.sampled_from([0.0, 0.1, 0.15, 0.1500000001, 0.2, -0.2, float("nan")])
    values = st.lists(near | st.floats(-0.3, 0.3), min_size=count, max_size=count)
    readings = {"current": np.array(draw(values)), "displacement": np.array(draw(values))}
    readings["voltage"] = np.array(draw(st.lists(st.floats(-4.0, 4.0), min_size=count, max_size=count)))
    return readings, draw(st.lists(st.integers(1, count - 1), max_size=12))


@given(_records(), st.sampled_from([0.0, 0.02, 0.1]), st.sampled_from(["zero", "warn"]))
def test_the_cut_of_the_rows_changes_nothing(
    record: tuple[dict[str, np.ndarray], list[int]], duration: float, action: Any
) -> None:
    readings, cuts = record
    limit = Limit(0.15, duration, action)
    limits = replace(NOTHING, voltage=Limit(3.0, duration), current=limit, displacement=limit)
    limits = replace(limits, mean_current=Limit(0.02, duration, action), power=Limit(0.01), charge=Limit(0.01))
    limits = replace(limits, energy=Limit(0.01, duration, action))
    whole, cut = in_blocks(limits, 50.0, **readings), in_blocks(limits, 50.0, cuts, **readings)
    assert sorted(map(repr, whole)) == sorted(map(repr, cut))
    assert [alarm.row for alarm in whole] == sorted(alarm.row for alarm in whole)
    # Row by row it is the same up to what ends it.
    ending = next((alarm for alarm in whole if alarm.action == "zero"), None)
    until = [alarm for alarm in whole if ending is None or alarm.row <= ending.row]
    warnings = [alarm for alarm in until if alarm.action == "warn"]
    assert in_single_rows(limits, 50.0, **readings) == [*warnings, *([ending] if ending else [])]


def test_a_lost_reading_keeps_what_was_and_is_told(look: Look) -> None:
    rate, nan = 50.0, np.nan
    limits = replace(NOTHING, displacement=Limit(10e-3, 0.1, "zero"))
    # Beyond the limit when it was lost: the time goes on.
    lost = np.array([0.0, 0.012, nan, nan, nan, nan, 0.012, 0.0])
    assert [(alarm.row, alarm.kind) for alarm in look(limits, rate, displacement=lost)] == [(6, "limit")]
    # Within it: the time begins with the first reading that is beyond.
    lost = np.array([0.0, 0.0, nan, nan, nan, nan, 0.012, 0.012])
    assert look(limits, rate, displacement=lost) == []
    # A laser that stays lost watches nothing, which is told once.
    (alarm,) = look(limits, rate, displacement=np.concatenate([np.zeros(10), np.full(200, nan)]))
    assert (alarm.kind, alarm.action, alarm.row) == ("blind", "warn", 60)
    assert str(alarm) == "the displacement has had no reading for 1 s: its limit is not watched"


def test_lost_rows_count_as_the_larger_of_their_neighbours() -> None:
    rate = 50.0
    limits = replace(NOTHING, charge=Limit(0.99), mean_current=Limit(0.0999))
    guard = Guard(limits, rate, ELECTRODES)
    block = {"voltage": np.full(2, 2.0), "current": np.full(2, 0.05)}
    assert guard.look(0, block) == ()
    # 10 s are lost before a current of 0.1 A: 1 C, and a mean that is full.
    alarms = guard.look(502, {**block, "current": np.full(2, 0.1)})
    assert sorted((alarm.limit, alarm.row) for alarm in alarms) == [("charge", 502), ("mean_current", 502)]
    with pytest.raises(IpmclabError, match="a block begins at row 503, row 504 was expected"):
        guard.look(503, block)
    # The larger one may be the last before them, and the current smaller again after.
    guard = Guard(replace(limits, mean_current=Limit(0.0989)), rate, ELECTRODES)
    assert guard.look(0, {**block, "current": np.array([0.05, 0.1])}) == ()
    alarms = guard.look(502, block)
    assert sorted((alarm.limit, alarm.row) for alarm in alarms) == [("charge", 502), ("mean_current", 502)]


def test_after_zeroing_the_discharge_does_not_act_but_an_output_that_stays_does() -> None:
    rate = 50.0
    limits = replace(NOTHING, current=Limit(0.1), charge=Limit(0.01))
    guard = Guard(limits, rate, ELECTRODES)
    (alarm, *_) = guard.look(0, {"voltage": np.full(2, 2.0), "current": np.full(2, 0.2)})
    assert alarm.action == "zero"
    guard.zeroed(2)
    assert guard.is_zeroed
    time = np.arange(100) / rate
    discharge = -0.3 * np.exp(-time)
    # At the electrodes a discharge through the 1 ohm shunt shows as a voltage although the output is at 0 V.
    assert guard.look(2, {"voltage": -discharge, "current": discharge}) == ()
    (stuck,) = guard.look(102, {"voltage": np.full(50, 2.0), "current": np.full(50, 0.2)})
    assert (stuck.kind, stuck.action, stuck.row) == ("stuck", "zero", 112)
    assert str(stuck) == "the output should be at 0 V and 2.2 V are read: take the strip off its leads"


@pytest.mark.parametrize("sensed", ["electrodes", "upstream of shunt"])
def test_what_a_discharge_drops_over_the_source_is_no_output_that_stays(sensed: Any) -> None:
    """An output at 0 V behind 10 ohm reads as 1 V while the strip gives 0.1 A back through them."""
    rig = replace(THESIS_RIG, voltage_sensed=sensed, source_resistance=10.0)
    between = 10.0 + (rig.shunt_resistance if sensed == "electrodes" else 0.0)
    guard = Guard(NOTHING, 50.0, rig)
    guard.zeroed(0)
    discharge = np.full(50, -0.1)
    assert guard.look(1, {"voltage": -between * discharge, "current": discharge}) == ()
    # The same reading without its current: the output does give 1 V.
    (stuck,) = guard.look(51, {"voltage": -between * discharge, "current": 0.0 * discharge})
    assert (stuck.kind, stuck.value) == ("stuck", pytest.approx(0.1 * between))


def test_rows_that_were_sampled_before_the_output_was_at_0_v_do_not_show_that_it_is_stuck() -> None:
    """A busy computer reads them a second late, after it has brought the output to 0 V."""
    guard = Guard(NOTHING, 50.0, ELECTRODES)
    block = {"voltage": np.full(50, 2.0), "current": np.zeros(50)}
    guard.look(0, block, given=np.full(50, 2.0))
    guard.zeroed(50)
    assert guard.look(50, block, given=np.full(50, 2.0)) == ()
    (stuck,) = guard.look(100, block, given=np.where(np.arange(50) < 20, 2.0, 0.0))
    assert (stuck.kind, stuck.row) == ("stuck", 130)  # 0.2 s after the first row at 0 V


def test_the_air_has_a_limit() -> None:
    guard = Guard(replace(NOTHING, temperature=Limit(40.0, 2.0)), 50.0, ELECTRODES)
    block = {"voltage": np.zeros(50)}
    temperatures = [25.0, 41.0, np.nan, 41.0, 41.0]
    found = [guard.look(50 * k, block, {"temperature": np.array([value])}) for k, value in enumerate(temperatures)]
    assert [len(alarms) for alarms in found] == [0, 0, 0, 1, 0]
    assert str(found[3][0]) == "the temperature is 41 degC, beyond its limit of 40 degC for 2 s"
    assert guard.look(250, block, {"temperature": np.empty(0)}) == ()


def test_the_air_of_a_channel_has_the_same_limit() -> None:
    guard = Guard(replace(NOTHING, temperature=Limit(40.0, 2.0)), 50.0, ELECTRODES)
    readings = {"voltage": np.zeros(300), "temperature": np.where(np.arange(300) < 100, 25.0, 41.0)}
    (alarm,) = guard.look(0, readings, {"temperature": np.empty(0)})
    assert (alarm.limit, alarm.row) == ("temperature", 200)


@pytest.mark.parametrize("lost", [0, 10**5, 10**12])
def test_readings_beyond_all_measure_do_not_turn_its_sums_round(lost: int) -> None:
    """Nanocoulombs of 64 bits are full after 92,000 rows of 100 kA; a sum that came round would pass its limit anew."""
    limits = replace(NOTHING, charge=Limit(1.0), energy=Limit(1.0))
    for current, passed in ((np.inf, ["charge", "energy"]), (-np.inf, ["charge"])):
        guard = Guard(limits, 50.0, ELECTRODES)
        block = {"voltage": np.full(1000, 3.0), "current": np.full(1000, current)}
        alarms = [alarm for first in range(200) for alarm in guard.look(first * (1000 + lost), block)]
        assert sorted(alarm.limit for alarm in alarms) == passed
        assert {alarm.row for alarm in alarms} == {0}
