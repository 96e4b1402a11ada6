"""One recording, at its ends and where two things happen at once."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ipmclab import InputError, IpmclabError, RunMetadata
from ipmclab.rig.bench import BenchError, Block
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.recording import recorder
from ipmclab.rig.recording.control import Control
from ipmclab.rig.recording.recorder import record
from ipmclab.rig.recording.recording import Outcome
from ipmclab.rig.recording.run_request import RunRequest
from ipmclab.rig.recording.slow import Air
from ipmclab.rig.safety.limit import Limit
from ipmclab.rig.safety.limits import Limits
from ipmclab.run import Mark, Run, ZeroReading
from tests.rig.toy_bench import RATE, Ends, ToyBench, done, kept, marks
from tests.waiting import AtRow


def asked(calls: dict[int, Callable[[Control], None]], **more: Any) -> tuple[Outcome, ToyBench, Ends]:
    """A run of which something is asked once a row has been read."""
    control, bench, told = Control(), ToyBench(), Ends()
    acts = [AtRow(row, lambda act=act: act(control)) for row, act in calls.items()]

    def on_block(rows: Any) -> None:
        for act in acts:
            act(rows)

    outcome = done(bench, control=control, on_block=on_block, **told.listeners, **more)
    assert outcome.error is None
    return outcome, bench, told


def smells(control: Control) -> None:
    control.abort("it smells")


# What is asked for once 20 rows were read acts with the next block.
STOPPED = "stopped by the operator at 0.44 s"


@pytest.mark.parametrize(
    ("calls", "rest_after", "state", "reason", "rows"),
    [
        ({20: Control.stop}, 0.0, "complete", STOPPED, 22),
        ({20: Control.stop}, 0.2, "complete", STOPPED, 32),
        ({20: Control.zero}, 0.2, "aborted", "emergency zero by the operator", 42),
        ({20: smells}, 0.2, "aborted", "it smells", 22),
        # A stop during the rest does not make the record longer; an emergency does, by its discharge.
        ({104: Control.stop}, 0.2, "complete", "stopped by the operator at 2.12 s", 110),
        ({104: Control.zero}, 0.2, "aborted", "emergency zero by the operator", 126),
        ({108: Control.stop}, 0.2, "complete", "stopped by the operator at 2.2 s", 110),
        ({108: Control.zero}, 0.2, "aborted", "emergency zero by the operator", 130),
        # A second word after a stop: another stop changes nothing.
        ({20: Control.stop, 24: Control.stop}, 0.2, "complete", STOPPED, 32),
        ({20: Control.stop, 24: smells}, 0.2, "aborted", "it smells", 26),
        ({20: Control.stop, 24: Control.zero}, 0.2, "aborted", "emergency zero by the operator", 32),
        ({20: smells, 22: Control.stop}, 0.2, "aborted", "it smells", 22),
        ({20: Control.zero, 24: smells}, 0.2, "aborted", "emergency zero by the operator", 26),
        ({20: Control.zero, 24: Control.stop}, 0.2, "aborted", "emergency zero by the operator", 42),
    ],
)
def test_how_a_run_ends_that_is_asked_to(
    calls: dict[int, Callable[[Control], None]], rest_after: float, state: str, reason: str, rows: int
) -> None:
    outcome, _, _ = asked(calls, rest_after=rest_after)
    assert (outcome.state, outcome.reason, outcome.rows) == (state, reason, rows)
    assert len(kept(outcome)) == rows
    assert kept(outcome).time.tolist() == [row / RATE for row in range(rows)]


def test_each_word_that_ends_a_run_zeroes_the_output_again_and_is_kept() -> None:
    outcome, bench, told = asked({20: Control.stop, 22: Control.stop, 24: Control.zero, 28: smells}, rest_after=0.4)
    said = [("stop", STOPPED), ("stop", "emergency zero by the operator"), ("stop", "it smells")]
    assert marks(outcome) == said
    assert [(kind, text) for kind, text, _ in told.ends] == said
    assert [rows for *_, rows in told.ends] == [42, 42, 30]
    assert told.marks == []
    assert bench.said.count("zero") == 3 + 1  # and once at the end


def test_without_an_on_end_what_ended_the_run_goes_to_on_mark() -> None:
    told: list[Mark] = []
    control = Control()
    done(control=control, on_block=AtRow(20, control.stop), on_mark=told.append)
    assert [mark.text for mark in told] == [STOPPED]


def test_a_word_in_the_last_block_of_an_odd_run_tells_the_row_that_is_not_kept() -> None:
    """101 rows: the last block has one row too many, which no row of the record may stand for."""
    held, bench = Control(), ToyBench()
    bench.change = lambda block: (held.zero() if block.first_row == 100 else None, block)[1]
    odd = done(bench, duration=2.02, control=held)
    assert marks(odd) == [("stop", "emergency zero by the operator"), ("gap", "1 rows were lost before row 102")]
    assert kept(odd).time[[100, 101, -1]] * RATE == pytest.approx([100, 102, 120])


def lost(*first_rows: int) -> Callable[[Block], Block | None]:
    return lambda block: None if block.first_row in first_rows else block


@pytest.mark.parametrize(
    ("first_rows", "text", "rows"),
    [
        ((0,), "2 rows were lost before row 2", 98),
        ((50, 52, 54), "6 rows were lost before row 56", 94),
        ((96, 98), "4 rows were lost before row 100", 96),  # those after the end of the run are not among them
        ((96, 98, 100, 102), "4 rows were lost before row 100", 96),
    ],
)
def test_lost_rows_are_told_with_their_number(first_rows: tuple[int, ...], text: str, rows: int) -> None:
    outcome = done(ToyBench(change=lost(*first_rows)))
    assert marks(outcome) == [("gap", text)]
    assert (outcome.rows, outcome.state) == (rows, "complete")


def test_a_block_that_overlaps_the_one_before_by_a_row_is_refused() -> None:
    outcome = done(ToyBench(change=lambda block: replace(block, first_row=block.first_row - (block.first_row == 50))))
    assert outcome.error is not None
    assert outcome.error.code == "rows-out-of-order"
    assert (outcome.rows, outcome.state) == (50, "aborted")


CURRENT = Limits(current=Limit(0.1, 0.0))


def surge(row: int) -> Callable[[Block], Block]:
    """200 mA from a row of the signal on."""
    gain = THESIS_RIG["current"].gain

    def change(block: Block) -> Block:
        rows = block.first_row + np.arange(len(block))
        current = np.where(rows >= row, 0.15 / gain, block.readings["current"])
        return replace(block, readings={**block.readings, "current": current})

    return change


def test_a_limit_in_the_last_block_records_its_whole_discharge() -> None:
    told = Ends()
    outcome = done(ToyBench(change=surge(98)), limits=CURRENT, rest_after=0.0, **told.listeners)
    assert (outcome.state, outcome.rows) == ("aborted", 100 + 20)
    assert outcome.alarm is not None
    assert (outcome.alarm.limit, outcome.alarm.row) == ("current", 98)
    assert told.ends == [("limit", outcome.reason, 120)]
    assert told.marks == []


def test_a_limit_that_warns_is_told_as_a_mark() -> None:
    told = Ends()
    outcome = done(ToyBench(change=surge(50)), limits=Limits(current=Limit(0.1, 0.0, "warn")), **told.listeners)
    assert (outcome.state, outcome.rows, outcome.alarm, told.ends) == ("complete", 100, None, [])
    assert [mark.kind for mark in told.marks] == ["limit"]


def test_of_two_limits_in_one_block_the_first_ends_the_run_and_both_are_kept() -> None:
    told = Ends()
    limits = Limits(current=Limit(0.1, 0.0), power=Limit(1e-9, 0.0))
    outcome = done(ToyBench(change=surge(0)), limits=limits, **told.listeners)
    assert [kind for kind, _ in marks(outcome)] == ["limit", "limit"]
    assert [text for _, text, _ in told.ends] == [outcome.reason]
    assert len(told.marks) == 1


def test_before_the_signal_a_mark_is_kept_and_any_other_word_ends_it() -> None:
    control, bench = Control(), ToyBench()
    control.mark("fan on")
    control.stop()
    outcome = done(bench, control=control, metadata=RunMetadata(operator="NN"))
    assert (outcome.state, outcome.reason, outcome.rows) == ("aborted", "stop, before the signal began", 0)
    assert outcome.metadata.operator == "NN"
    control.abort("it smells")
    assert done(control=control).reason == "it smells, before the signal began"


def test_the_zeros_after_a_run_are_read_unless_it_had_to_end_in_a_hurry() -> None:
    tare = ZeroReading("force", "tare", "after", 1e-3, 0.0)
    for act, is_read in ((Control.stop, True), (Control.zero, False), (Control.abort, False)):
        outcome, _, _ = asked({20: act}, zero_after=0.2, finish=lambda _: [tare])
        after = [(zero.channel, zero.kind) for zero in outcome.metadata.zeros if zero.when == "after"]
        assert after == ([("voltage", "zero"), ("current", "zero"), ("force", "preload"), ("force", "tare")] * is_read)


def test_what_fails_after_a_run_is_a_mark_and_keeps_what_was_read() -> None:
    def finish(_: object) -> list[ZeroReading]:
        raise BenchError("no block for 1 s", code="bench-frozen", where="chassis", repair="see its cable")

    outcome = done(finish=finish, zero_after=0.2)
    assert (outcome.state, outcome.error) == ("complete", None)
    ((kind, text),) = marks(outcome)
    assert kind == "bench"
    assert text.startswith("the zeros could not be read after the run: chassis: no block")
    assert {zero.channel for zero in outcome.metadata.zeros if zero.when == "after"} == {"voltage", "current", "force"}


def test_the_clock_of_the_bench_is_stopped_before_the_output_is_zeroed() -> None:
    """Also where it gives more rows than are recorded."""
    bench = ToyBench()
    done(bench)
    assert bench.said == ["open", "clock stopped", "clock stopped", "zero", "close"]


def test_the_air_of_instruments_beside_the_bench_is_kept_and_guarded() -> None:
    """The rig has its own thermometer and humidity: those at the strip count, the chamber's are kept beside them."""
    told: list[Air] = []
    readings = {"chamber_temperature": np.array([30.0, 32.0]), "chamber_relative_humidity": np.array([np.nan])}
    outcome = done(duration=2.5, slow=lambda: readings, on_air=told.append)
    assert [air.time for air in told] == [0.5, 1.5, 2.25]
    assert told[0].values["chamber_temperature"] == 31.0
    assert told[0].values["relative_humidity"] == pytest.approx(45.0, abs=1e-9)
    assert np.isnan(told[0].values["chamber_relative_humidity"])
    assert outcome.metadata.temperature == 31.0
    assert outcome.metadata.relative_humidity == 45.0
    run = kept(outcome)
    assert run.chamber_temperature is not None
    assert run.chamber_temperature.tolist() == [31.0, 31.0, 31.0]
    assert run.chamber_relative_humidity is None
    bare = replace(THESIS_RIG, thermometer=None, channels=THESIS_RIG.channels[:-1])
    hot = {"chamber_temperature": np.array([70.0])}
    limits = Limits(temperature=Limit(60.0, 0.5))
    assert done(slow=lambda: hot, limits=limits).state == "complete"  # the strip has a thermometer of its own
    guarded = done(ToyBench(rig=bare), slow=lambda: hot, limits=limits)
    assert guarded.alarm is not None
    assert guarded.alarm.limit == "temperature"


@pytest.mark.parametrize("name", ["rest_before", "rest_after", "zero_time", "zero_after", "longest_wait", "discharge"])
@pytest.mark.parametrize("value", [-0.01, np.inf, np.nan])
def test_a_time_that_is_none_is_refused_by_its_name(name: str, value: float) -> None:
    with pytest.raises(InputError) as caught:
        RunRequest(source="step 1 V", duration=1.0, rate=RATE, **{name: value})
    assert (caught.value.where, caught.value.code) == (name, "out-of-range")
    RunRequest(source="step 1 V", duration=1.0, rate=RATE, **{name: 0.0})


def test_a_run_of_one_row_is_too_short_and_two_are_a_run() -> None:
    def ended_at(row: int) -> Run:
        control = Control()
        return record(
            ToyBench(), "step 1 V", duration=1.0, rate=10.0, zero_time=0.3, control=control,
            on_block=AtRow(row, control.abort),
        )  # fmt: skip

    with pytest.raises(IpmclabError, match="it was ended after 1 rows: aborted by the operator") as caught:
        record_ended_in_first_block()
    assert caught.value.code == "too-short"
    assert len(ended_at(0)) == 2


def record_ended_in_first_block() -> Run:
    control = Control()
    bench = ToyBench()
    bench.change = lambda block: (control.abort() if block.first_row == 0 else None, block)[1]
    return record(bench, "step 1 V", duration=1.0, rate=10.0, zero_time=0.3, control=control)


def test_a_computer_that_is_about_to_leave_zeroes_the_output_at_once_and_ends_the_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    acts: list[Callable[[str], None]] = []
    monkeypatch.setattr(recorder, "on_session_end", lambda act: (acts.append(act), nullcontext())[1])
    bench, said = ToyBench(), list[str]()

    def leave() -> None:
        bench.said.clear()
        acts[0]("the session ends")
        said.extend(bench.said)

    outcome = done(bench, on_block=AtRow(20, leave))
    assert said == ["zero"]
    assert (outcome.state, outcome.reason, outcome.rows) == ("aborted", "the session ends", 22)


def test_in_memory_nothing_is_read_at_rest_after_a_run_unless_it_is_asked_for() -> None:
    asked: dict[str, Any] = {"duration": 1.0, "rate": RATE, "zero_time": 0.1}
    for more, times in (({}, {"before"}), ({"zero_after": 0.1}, {"before", "after"})):
        run = record(ToyBench(), "step 1 V", **asked, **more)
        assert {zero.when for zero in run.metadata.zeros} == times
