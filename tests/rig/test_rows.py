"""Rows from anywhere: what a capture plays may be a signal, or decide its voltages from what was read."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import pytest

from ipmclab import InputError, load_actuator, signals, simulate
from ipmclab.rig.recording.control import Control
from ipmclab.rig.recording.keeping import Rows
from ipmclab.rig.recording.recorder import record
from ipmclab.rig.recording.run_request import RunRequest
from ipmclab.rig.rows import ClampedRows, Feed, RestedRows, SignalRows, as_rows
from ipmclab.rig.safety.guarded_bench import GuardedBench
from ipmclab.rig.safety.limit import Limit
from ipmclab.rig.safety.limits import Limits
from ipmclab.rig.virtual import VirtualBench
from tests.rig.captured import captured

FloatArray = npt.NDArray[np.float64]

RATE = 50.0


class Pull:
    """Pulls the current to a set point: each voltage is what the last reading of the current asks for."""

    def __init__(self, wanted: float, gain: float, length: int | None = None) -> None:
        self.wanted = wanted
        self.gain = gain
        self.length = length
        self.last = 0.0
        self.asked: list[tuple[int, int]] = []
        self.seen: list[tuple[int, float]] = []

    def voltages(self, first_row: int, count: int, rate: float) -> FloatArray:
        assert rate == RATE
        self.asked.append((first_row, count))
        return np.full(count, self.gain * (self.wanted - self.last))

    def look(self, first_row: int, readings: Mapping[str, FloatArray]) -> None:
        self.last = float(readings["current"][-1])
        self.seen.append((first_row, self.last))

    def __str__(self) -> str:
        return f"pull to {self.wanted:g} A"


class Rogue:
    """Asks for what no strip stands, and for what is no number."""

    length = 60

    def voltages(self, first_row: int, count: int, rate: float) -> FloatArray:
        return np.where(np.arange(first_row, first_row + count) < 30, 1e3, np.nan)

    def look(self, first_row: int, readings: Mapping[str, FloatArray]) -> None:
        """See nothing."""


def test_a_source_decides_each_block_from_the_readings_of_the_one_before() -> None:
    strip, source = load_actuator("friend-2"), Pull(0.02, 8.0, length=200)
    run = record(VirtualBench(strip), source, rate=RATE, rest_before=1.0, rest_after=2.0)
    assert len(run) == 50 + 200 + 100
    assert run.metadata.signal == "pull to 0.02 A"
    assert run.metadata.state == "complete"
    # It was asked for each of its rows once, in order, and saw every row of the record.
    assert source.asked == [(row, 2) for row in range(0, 200, 2)]
    assert [row for row, _ in source.seen] == list(range(-50, 300, 2))
    # Its law holds between what was read and what was given out: the output of a row is told with the row after it.
    given, current = run.raw["output"], run.current
    assert current is not None
    for row in range(50, 250, 2):
        law = 8.0 * (0.02 - current[row - 1])
        assert given[row + 1 : row + 3] == pytest.approx([law, law], abs=1e-12)
    assert not given[:51].any()
    assert not given[251:].any()
    # The strip answered to these very voltages: the model of it says the same current, without any bench.
    in_series = strip.replace(**{"circuit.contact_resistance": strip["circuit.contact_resistance"] + 1.0})
    model = simulate(in_series, given, duration=len(given) / RATE, rate=RATE, hold="zero-before")
    assert np.abs(current - model.current).max() < 0.5e-3
    assert len(set(given[51:251].tolist())) > 50  # noise and all: it moved by what it read, not by a plan


def test_a_source_without_an_end_goes_on_until_it_is_ended() -> None:
    control = Control()

    def on_block(rows: Rows) -> None:
        if rows.first_row == 300:
            control.stop()

    source = Pull(0.02, 8.0)
    outcome = captured(VirtualBench(load_actuator("friend-2")), source, rate=RATE, control=control, on_block=on_block)
    assert (outcome.state, outcome.rows) == ("complete", 304)
    assert outcome.reason.startswith("stopped by the operator")
    # For a time it ends by itself.
    run = record(VirtualBench(load_actuator("friend-2")), Pull(0.02, 8.0), rate=RATE, duration=3.0)
    assert len(run) == 150


def test_no_source_gets_beyond_the_limit_of_the_strip() -> None:
    limits = Limits(voltage=Limit(2.0), current=None, mean_current=None, power=None)
    run = record(VirtualBench(load_actuator("friend-2")), Rogue(), rate=RATE, rest_after=1.0, limits=limits)
    assert run.raw["output"].tolist() == [0.0] + [2.0] * 30 + [0.0] * 79
    assert run.metadata.state == "complete"


def test_a_source_that_fails_leaves_the_output_at_0_and_its_rows_kept() -> None:
    class Broken(Pull):
        def look(self, first_row: int, readings: Mapping[str, FloatArray]) -> None:
            if first_row >= 100:
                raise ZeroDivisionError("no set point")

    bench = VirtualBench(load_actuator("friend-2"))
    with pytest.raises(ZeroDivisionError) as told:
        record(bench, Broken(0.02, 20.0, length=200), rate=RATE)
    run = told.value.run  # type: ignore[attr-defined]
    assert (len(run), run.metadata.state) == (102, "aborted")
    assert run.metadata.state_reason == "ZeroDivisionError: no set point"
    assert bench._output == 0.0


def test_a_limit_ends_a_source_as_it_ends_a_signal() -> None:
    limits = Limits(mean_current=Limit(0.02, 0.0), charge=None)
    run = record(VirtualBench(load_actuator("friend-2")), Pull(0.5, 4.0, length=1000), rate=RATE, limits=limits)
    assert run.metadata.state == "aborted"
    assert run.metadata.state_reason is not None
    assert run.metadata.state_reason.startswith("the mean current over 1 s is 2")
    assert "beyond its limit of 20 mA" in run.metadata.state_reason
    assert not run.raw["output"][-200:].any()


def test_a_bench_takes_no_source_that_nothing_holds_within_a_limit() -> None:
    bench = VirtualBench(load_actuator("friend-2"))
    bench.open(["voltage", "current"], RATE)
    with pytest.raises(InputError, match="nothing holds them within a limit; hand it to the bench through a Guarded"):
        bench.apply(Rogue())
    guarded = GuardedBench(bench, Limits())
    guarded.open(["voltage", "current"], RATE)
    assert np.concatenate([block.output for block in guarded.apply(Rogue())]).max() == 3.5
    with pytest.raises(InputError, match="rows: a signal is given out for a number of rows"):
        bench.apply(signals.Step(1.0))
    bench.close()


def test_a_signal_needs_a_duration() -> None:
    with pytest.raises(InputError, match="duration: a signal is applied for a duration"):
        RunRequest(source="step 1 V", rate=RATE)


@pytest.mark.parametrize("size", [1, 2, 7, 100])
def test_rest_and_limits_are_the_same_however_the_rows_are_cut(size: int) -> None:
    signal = signals.parse("sine 3 V 1 Hz")
    rested = RestedRows(SignalRows(signal, 40), before=10, after=20)
    clamped = ClampedRows(rested, -2.0, 1.0, more=30)
    assert (rested.length, clamped.length) == (70, 100)
    pieces = [clamped.voltages(row, min(size, 100 - row), RATE) for row in range(0, 100, size)]
    expected = np.zeros(100)
    expected[10:50] = np.clip(3.0 * np.sin(2.0 * np.pi * np.arange(40) / RATE), -2.0, 1.0)
    assert np.concatenate(pieces) == pytest.approx(expected, abs=1e-12)


def test_a_source_without_an_end_has_none_with_its_rest_either_unless_it_is_cut() -> None:
    source = Pull(1.0, 2.0)
    rested = RestedRows(source, before=3, after=4)
    assert rested.length is None
    assert ClampedRows(source, -1.0, 1.0).length is None
    assert rested.voltages(0, 6, RATE).tolist() == [0.0, 0.0, 0.0, 2.0, 2.0, 2.0]
    assert source.asked == [(0, 3)]
    cut = RestedRows(source, before=3, after=4, length=2)
    assert cut.length == 9
    assert cut.voltages(0, 9, RATE).tolist() == [0.0] * 3 + [2.0] * 2 + [0.0] * 4
    assert ClampedRows(cut, -1.0, 1.5).length == 9
    # A source is not asked for no rows.
    cut.voltages(0, 3, RATE)
    cut.voltages(5, 4, RATE)
    assert source.asked == [(0, 3), (0, 2)]
    assert (str(rested), str(ClampedRows(source, -1.0, 1.0))) == ("pull to 1 A", "pull to 1 A")


def test_readings_are_handed_on_in_the_rows_of_the_source() -> None:
    source = Pull(1.0, 2.0, length=2)
    clamped = ClampedRows(RestedRows(source, before=3, after=4), -1.0, 1.0)
    for row in (0, 3):
        clamped.look(row, {"current": np.array([0.1 * row])})
    assert source.seen == [(-3, 0.0), (0, pytest.approx(0.3))]


def test_what_is_no_number_is_0_v_and_what_is_beyond_is_the_limit() -> None:
    assert ClampedRows(Rogue(), -1.0, 2.0).voltages(29, 2, RATE).tolist() == [2.0, 0.0]


def test_only_a_signal_needs_a_number_of_rows() -> None:
    source = Rogue()
    assert as_rows(source) is source
    played = as_rows(signals.Step(1.0), 7)
    assert (type(played), played.length) == (SignalRows, 7)
    with pytest.raises(InputError, match="a signal is given out for a number of rows"):
        as_rows(signals.Step(1.0))


def test_a_feed_asks_for_each_row_once_and_no_earlier_than_it_must() -> None:
    source = Pull(1.0, 2.0, length=9)
    feed = Feed(source, RATE)
    feed.prepare(5)
    feed.take(3)
    feed.prepare(2)
    feed.take(4)
    assert source.asked == [(0, 5), (5, 2)]


class Short(Rogue):
    """Gives one voltage, however many are asked for."""

    def voltages(self, first_row: int, count: int, rate: float) -> FloatArray:
        return np.ones(1)


def test_a_source_gives_one_voltage_for_each_row() -> None:
    with pytest.raises(InputError, match=r"asked for 5 voltages and gave an array of shape \(1,\)"):
        ClampedRows(Short(), -1.0, 1.0).voltages(0, 5, RATE)


@pytest.mark.parametrize("rate", [0.0, np.nan, -1.0])
def test_a_source_is_played_at_a_rate_above_0(rate: float) -> None:
    with pytest.raises(InputError, match="it must be a number above 0"):
        RunRequest(source=Rogue(), rate=rate).played(1000)


def test_a_source_without_a_text_is_named_by_its_class() -> None:
    assert str(RestedRows(Short(), 0, 0)) == "Short"
