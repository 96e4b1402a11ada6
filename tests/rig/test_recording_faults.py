"""One recording whose bench, journal or guardian fails: an output that is not at 0 V is told before all else."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ipmclab import IpmclabError
from ipmclab.rig.bench import BenchError
from ipmclab.rig.recording.control import Control
from ipmclab.rig.recording.zeroing import read_rest
from ipmclab.run import ZeroReading
from tests.rig.toy_bench import Ends, Heart, NotZeroed, ToyBench, done, kept, marks
from tests.waiting import AtRow


def test_the_guardian_beats_once_a_block_and_is_asked_for_patience_where_something_takes_long() -> None:
    heart = Heart()
    done(duration=0.2, heartbeat=heart)
    assert heart.told == [("arm", 0.04), ("hold", 2.0), *["beat"] * 5, ("hold", 2.0), "disarm"]


@pytest.mark.parametrize("code", ["output-not-zero", "output-unread"])
@pytest.mark.parametrize("fault", [None, BenchError, KeyboardInterrupt])
def test_an_output_that_is_not_at_0_v_is_told_whatever_else_happened(code: str, fault: type | None) -> None:
    """Also where the operator interrupts the program: the strip may still be driven."""
    bench, heart, told = ToyBench(), Heart(), Ends()
    bench.refuses_zero = NotZeroed(code)

    def fail() -> None:
        if fault is BenchError:
            raise BenchError("no block for 1 s", code="bench-frozen", where="chassis", repair="see its cable")
        if fault is not None:
            raise fault

    arguments: dict[str, Any] = {"heartbeat": heart, "on_block": AtRow(50, fail), **told.listeners}
    if fault is KeyboardInterrupt:
        with pytest.raises(KeyboardInterrupt) as caught:
            done(bench, **arguments)
        run = caught.value.run  # type: ignore[attr-defined]
    else:
        outcome = done(bench, **arguments)
        assert outcome.error is bench.refuses_zero
        run = outcome.run
    assert str(bench.refuses_zero) in [mark.text for mark in told.marks]
    assert str(bench.refuses_zero) in [mark.text for mark in run.metadata.marks]
    assert run.metadata.state == "aborted"
    assert "disarm" not in heart.told


def test_the_rows_that_were_read_are_kept_where_the_output_cannot_be_brought_to_0_v_on_request() -> None:
    bench, control = ToyBench(), Control()

    def ask() -> None:
        bench.refuses_zero = NotZeroed()
        control.stop()

    outcome = done(bench, control=control, on_block=AtRow(20, ask))
    assert outcome.error is bench.refuses_zero
    assert (outcome.state, outcome.rows, len(kept(outcome))) == ("aborted", 22, 22)


def test_what_failed_first_is_told_where_the_output_fails_in_another_way() -> None:
    bench, told = ToyBench(), Ends()
    bench.refuses_zero = BenchError(
        "the connection is gone", code="bench-lost", where="chassis", repair="see its cable"
    )
    frozen = BenchError("no block for 1 s", code="bench-frozen", where="chassis", repair="see its cable")

    def fail() -> None:
        raise frozen

    heart = Heart()
    outcome = done(bench, on_block=AtRow(50, fail), heartbeat=heart, **told.listeners)
    assert outcome.error is frozen
    assert [mark.text for mark in told.marks] == [str(frozen)]  # once
    assert marks(outcome) == [("bench", str(frozen))]
    assert "explain" in heart.told
    assert "disarm" not in heart.told


def test_the_guardian_puts_its_cause_in_the_place_of_a_failure_before_anybody_is_told() -> None:
    told = Ends()

    def fail() -> None:
        raise BenchError("no block for 1 s", code="bench-frozen", where="chassis", repair="see its cable")

    done(on_block=AtRow(50, fail), heartbeat=Heart(lost=True), **told.listeners)
    assert [mark.text for mark in told.marks] == ["chassis: the guardian is gone; see its cable"]


class FullJournal:
    """A journal without room."""

    def __init__(self, room: int = 0) -> None:
        self.room = room
        self.ended: list[tuple[str, str]] = []
        self.events: list[str] = []

    def append(self, first_row: int, columns: Any) -> None:
        self.room -= len(columns)
        if self.room < 0:
            raise IpmclabError("the disk is full", code="disk-full", where="journal", repair="free some room")

    def event(self, kind: str, time: float, text: str = "", **values: Any) -> None:
        self.events.append(kind)

    def end(self, state: str, reason: str = "", metadata: Any = None) -> None:
        self.ended.append((state, reason))
        if self.room < 0:
            raise IpmclabError(
                "there is no room for the end", code="disk-full", where="journal", repair="free some room"
            )


def test_a_full_disk_does_not_hide_an_output_that_is_not_at_0_v() -> None:
    bench, journal = ToyBench(), FullJournal(50)
    bench.refuses_zero = NotZeroed()
    outcome = done(bench, journal=lambda _: journal)
    assert outcome.error is bench.refuses_zero
    assert outcome.run is None
    assert journal.ended == [("aborted", str(bench.refuses_zero))]


def test_a_full_disk_does_not_hide_an_output_that_is_stuck() -> None:
    control, heart = Control(), Heart()
    held = FullJournal(60)
    bench = ToyBench(change=lambda block: replace(block, readings={**block.readings, "voltage": np.ones(len(block))}))
    outcome = done(
        bench, journal=lambda _: held, control=control, heartbeat=heart, on_block=AtRow(46, control.zero), discharge=2.0
    )
    assert outcome.error is not None
    assert outcome.error.code == "output-stuck"
    assert "disarm" not in heart.told


@pytest.mark.parametrize("seen", ["by the zeros", "by the tare"])
def test_an_output_that_is_found_stuck_after_the_run_is_told_as_one_found_before(seen: str) -> None:
    """Its amplifier fails once the run is over: the operator has to hear of it, and the guardian acts."""
    bench, heart, told = ToyBench(), Heart(), Ends()
    bench.stuck_from = 120 if seen == "by the zeros" else 1000

    def tare(_: object) -> list[ZeroReading]:
        bench.stuck_from = 0
        return [*read_rest(bench, ("voltage",), 50.0, when="after", duration=1.0).zeros]

    outcome = done(bench, zero_after=1.0, finish=tare, heartbeat=heart, **told.listeners)
    assert outcome.error is not None
    assert (outcome.error.code, outcome.state) == ("output-stuck", "aborted")
    assert outcome.error.repair == "switch the output amplifier off"
    assert [mark.text for mark in told.marks] == [str(outcome.error)]
    assert marks(outcome) == [("bench", str(outcome.error))]
    assert [zero.when for zero in outcome.metadata.zeros if zero.when == "after"] == (
        [] if seen == "by the zeros" else ["after"] * 3
    )
    assert len(kept(outcome)) == 100
    assert heart.told[-2:] == ["disarm", ("arm", 0.04)]


def test_a_journal_that_cannot_be_ended_is_an_error_of_a_run_that_was_played() -> None:
    journal = FullJournal(100)
    journal.append = lambda *_: setattr(journal, "room", -1)  # type: ignore[method-assign]
    outcome = done(journal=lambda _: journal)
    assert outcome.error is not None
    assert outcome.error.code == "disk-full"
    assert (outcome.state, outcome.rows) == ("complete", 100)


@pytest.mark.parametrize("early", [True, False])
def test_a_bench_that_cannot_be_closed_is_told_also_where_no_signal_began(early: bool) -> None:
    bench, control = ToyBench(), Control()
    bench.refuses_close = NotZeroed()
    if early:
        control.abort()
    outcome = done(bench, control=control)
    assert outcome.error is bench.refuses_close
    assert outcome.rows == (0 if early else 100)
    assert bench.said[-1] == "close"
