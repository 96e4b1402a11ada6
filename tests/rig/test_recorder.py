"""The recorder on the virtual bench, ended in every way that there is: output at 0 V, and the rows kept."""

from __future__ import annotations

import gc
import os
import signal
import threading
import weakref
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ipmclab import InputError, IpmclabError, RunMetadata, check, load_actuator
from ipmclab.model import Actuator
from ipmclab.rig.bench import BenchError, Block
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.recording.control import Control
from ipmclab.rig.recording.keeping import Rows
from ipmclab.rig.recording.recorder import record
from ipmclab.rig.recording.recording import Outcome
from ipmclab.rig.recording.slow import Air
from ipmclab.rig.rows import RowSource, as_rows
from ipmclab.rig.safety.limit import Limit
from ipmclab.rig.safety.limits import Limits
from ipmclab.rig.virtual import VirtualBench
from ipmclab.run import Mark
from ipmclab.signals import Signal
from tests.rig.captured import captured
from tests.waiting import AtRow

RATE = 50.0


@pytest.fixture(scope="module")
def strip() -> Actuator:
    return load_actuator("friend-2")


class Watched(VirtualBench):
    """A virtual bench that can do what hardware does, and says what it was told."""

    def __init__(self, strip: Actuator, change: Callable[[Block], Block | None] = lambda block: block) -> None:
        super().__init__(strip)
        self.change = change
        self.applied: list[float] = []
        self.zeroed = 0
        self.closed = 0

    def apply(self, source: Signal | RowSource, rows: int | None = None) -> Iterator[Block]:
        played = as_rows(source, rows)
        given_out = super().apply(played)
        if played.length is None or np.any(played.voltages(0, played.length, self._rate)):
            return self._changed(given_out)
        return given_out

    def _changed(self, blocks: Iterator[Block]) -> Iterator[Block]:
        for block in blocks:
            changed = self.change(block)
            if changed is not None:
                yield changed

    def zero(self) -> None:
        self.zeroed += 1
        super().zero()

    def close(self) -> None:
        self.closed += 1
        super().close()

    @property
    def output(self) -> float:
        return self._output


class Heart:
    """Counts beats, and remembers whether it is armed."""

    def __init__(self, dies_after: int | None = None) -> None:
        self.armed = False
        self.beats = 0
        self.dies_after = dies_after

    def arm(self, block_time: float) -> None:
        assert block_time == pytest.approx(0.04)
        self.armed = True

    def beat(self) -> None:
        assert self.armed
        self.beats += 1
        if self.beats == self.dies_after:
            raise IpmclabError("there is no guardian", code="guardian-lost", where="guardian", repair="see its log")

    status = None

    def explain(self, failure: IpmclabError) -> None:
        assert self.armed

    def hold(self, seconds: float) -> None:
        assert 0.0 < seconds <= 2.0

    def disarm(self) -> None:
        self.armed = False


def is_safe(bench: Watched, heart: Heart) -> None:
    assert bench.output == 0.0
    assert bench.zeroed >= 2  # at the end, and when it was closed
    assert bench.closed == 1
    assert not heart.armed


def test_a_run_is_as_it_was_recorded(strip: Actuator) -> None:
    bench, heart, blocks = Watched(strip), Heart(), []
    run = record(
        bench, "step 1 V", duration=4.0, rate=RATE, rest_before=1.0, rest_after=1.0, heartbeat=heart,
        on_block=blocks.append, metadata=RunMetadata(operator="NN"), zero_after=2.0,
    )  # fmt: skip
    is_safe(bench, heart)
    assert len(run) == 300
    assert heart.beats == 150
    assert (run.metadata.state, run.metadata.state_reason, run.metadata.marks) == ("complete", None, ())
    assert run.metadata.uuid is not None
    assert run.metadata.recorded_at is not None
    assert (run.metadata.rig, run.metadata.operator) == (THESIS_RIG.name, "NN")
    assert run.metadata.limits["voltage"] == "3.5 V for 0.02 s, then zero"
    assert "nothing shows when it is exceeded" in run.metadata.limits["current"]
    # Raw volts beside each quantity, and what the output was told.
    assert set(run.raw) == {"voltage", "current", "force", "relative_humidity", "output"}
    assert run.raw["output"].tolist() == [0.0] * 51 + [1.0] * 200 + [0.0] * 49
    assert run.current == pytest.approx(run.raw["current"] * THESIS_RIG["current"].gain)
    # What the blocks told is what the run holds.
    assert np.concatenate([rows.values["current"] for rows in blocks]).tolist() == run.current.tolist()
    # The air, one reading a second.
    assert run.time_environment is not None
    assert run.time_environment.tolist() == [0.5, 1.5, 2.5, 3.5, 4.5, 5.5]
    assert run.temperature == pytest.approx(22.0, abs=0.2)
    assert run.relative_humidity == pytest.approx(45.0, abs=0.5)
    assert {(zero.channel, zero.when) for zero in run.metadata.zeros} >= {("force", "before"), ("force", "after")}


def test_a_limit_ends_the_run_and_its_discharge_is_recorded(strip: Actuator) -> None:
    bench, heart, marks = Watched(strip), Heart(), list[Mark]()
    limits = Limits(charge=None, mean_current=Limit(0.02, 0.0))
    run = record(
        bench, "step 1 V delay=1 s", duration=20.0, rate=RATE, limits=limits, heartbeat=heart, on_mark=marks.append
    )
    is_safe(bench, heart)
    assert run.metadata.state == "aborted"
    assert run.metadata.state_reason is not None
    assert run.metadata.state_reason.startswith("the mean current over 1 s is 20")
    assert [(mark.kind, mark.text) for mark in run.metadata.marks] == [("limit", run.metadata.state_reason)]
    assert marks == list(run.metadata.marks)
    # The mean over the 50 rows to the mark, and not a row before, is beyond 20 mA.
    assert run.current is not None
    row = round(marks[0].time * RATE)
    means = np.convolve(np.abs(run.current), np.full(50, 1 / 50))[: len(run)]
    assert np.flatnonzero(means > 0.02)[0] == row
    # Within 100 ms the output is at 0 V, and the strip is short-circuited for 5 s more.
    after = np.flatnonzero((run.raw["output"] == 0.0) & (np.arange(len(run)) > 60))
    assert 0 < (after[0] - row) / RATE <= 0.1
    assert len(run) - after[0] == pytest.approx(5.0 * RATE, abs=3)
    assert np.all(run.raw["output"][after[0] :] == 0.0)
    assert run.current[after[0] + 1] < -0.01


def test_a_warning_is_a_mark_and_no_end(strip: Actuator) -> None:
    limits = Limits(current=Limit(0.05, 0.02, "warn"))
    run = record(VirtualBench(strip), "square 1 V 0.5 Hz", duration=4.0, rate=RATE, limits=limits)
    assert run.metadata.state == "complete"
    assert len(run) == 200
    assert [mark.kind for mark in run.metadata.marks] == ["limit"] * 4
    assert run.metadata.marks[0].text.endswith("beyond its limit of 50 mA for 0.02 s")


def ended(strip: Actuator, act: Callable[[Control], None], **more: Any) -> tuple[Outcome, Watched, Heart]:
    control, bench, heart = Control(), Watched(strip), Heart()
    outcome = captured(
        bench, "step 1 V", duration=20.0, rate=RATE, control=control, heartbeat=heart, zero_after=1.0,
        on_block=AtRow(200, lambda: act(control)), **more,
    )  # fmt: skip
    is_safe(bench, heart)
    assert outcome.error is None
    assert outcome.run is not None
    # What was asked for at row 200 acts with the next block.
    assert outcome.run.raw["output"][201] == 1.0
    assert not outcome.run.raw["output"][203:].any()
    return outcome, bench, heart


def test_stop_keeps_the_run_and_its_rest(strip: Actuator) -> None:
    outcome, _, _ = ended(strip, Control.stop, rest_after=2.0)
    assert (outcome.state, outcome.reason) == ("complete", "stopped by the operator at 4.04 s")
    assert outcome.run is not None
    assert outcome.rows == len(outcome.run) == 302
    assert [(mark.kind, mark.time) for mark in outcome.run.metadata.marks] == [("stop", 4.04)]
    assert "after" in {zero.when for zero in outcome.metadata.zeros}


def test_the_guardian_is_asked_for_patience_before_the_output_is_brought_to_0_v(strip: Actuator) -> None:
    """The tasks of a chassis are stopped and started for that, which takes longer than it waits for a beat."""
    done: list[str] = []

    class Patient(Heart):
        def beat(self) -> None:
            done.append("beat")
            super().beat()

        def hold(self, seconds: float) -> None:
            done.append("hold")
            super().hold(seconds)

    class Zeroed(Watched):
        def zero(self) -> None:
            done.append("zero")
            super().zero()

    control = Control()

    def stop() -> None:
        done.clear()
        control.stop()

    captured(
        Zeroed(strip), "step 1 V", duration=20.0, rate=RATE, rest_after=1.0, control=control, heartbeat=Patient(),
        on_block=AtRow(200, stop),
    )  # fmt: skip
    assert done[:4] == ["beat", "hold", "zero", "beat"]


def test_abort_keeps_what_there_is_marked(strip: Actuator) -> None:
    outcome, _, _ = ended(strip, lambda control: control.abort("the strip smells"))
    assert (outcome.state, outcome.reason, outcome.rows) == ("aborted", "the strip smells", 202)
    assert outcome.run is not None
    assert (outcome.run.metadata.state, outcome.run.metadata.state_reason) == ("aborted", "the strip smells")


def test_emergency_zero_records_the_discharge(strip: Actuator) -> None:
    outcome, _, _ = ended(strip, Control.zero)
    assert (outcome.state, outcome.reason) == ("aborted", "emergency zero by the operator")
    assert outcome.rows == 202 + 250
    # An abort during that ends it at once.
    control, bench = Control(), Watched(strip)
    calls = {200: control.zero, 300: control.abort}

    def on_block(rows: Rows) -> None:
        for row in [row for row in calls if row <= rows.first_row]:
            calls.pop(row)()

    outcome = captured(bench, "step 1 V", duration=20.0, rate=RATE, control=control, on_block=on_block)
    assert outcome.rows == 304


def test_the_air_is_told_as_it_is_read(strip: Actuator) -> None:
    """Once a second, the same means as the run keeps."""
    told: list[Air] = []
    outcome = captured(VirtualBench(strip), "step 1 V", duration=5.0, rate=RATE, on_air=told.append)
    assert outcome.run is not None
    assert [air.time for air in told] == outcome.run.time_environment.tolist()
    assert [air.values["temperature"] for air in told] == outcome.run.temperature.tolist()


def test_marks_stand_where_they_were_set(strip: Actuator) -> None:
    control = Control()
    control.mark("before it all")
    run = record(
        VirtualBench(strip), "step 1 V", duration=4.0, rate=RATE, control=control,
        on_block=AtRow(100, lambda: control.mark("fan on")),
    )  # fmt: skip
    assert [(mark.time, mark.text) for mark in run.metadata.marks] == [(0.0, "before it all"), (2.04, "fan on")]


def test_ended_before_it_began(strip: Actuator) -> None:
    control, bench = Control(), Watched(strip)
    control.stop()
    outcome = captured(bench, "step 1 V", duration=4.0, rate=RATE, control=control, journal=pytest.fail)
    assert (outcome.state, outcome.rows, outcome.run) == ("aborted", 0, None)
    assert "before the signal began" in outcome.reason
    assert bench.closed == 1


def failing(code: str = "bench-frozen") -> Callable[[Block], Block]:
    def change(block: Block) -> Block:
        if block.first_row >= 100:
            raise BenchError(
                "no block for 1 s", code=code, where="chassis", repair="see its power and its cable, then record again"
            )
        return block

    return change


def test_a_bench_that_fails_leaves_the_run_aborted_with_the_remedy(strip: Actuator) -> None:
    bench, heart = Watched(strip, failing()), Heart()
    with pytest.raises(BenchError, match="no block for 1 s; see its power and its cable") as told:
        record(bench, "step 1 V", duration=4.0, rate=RATE, heartbeat=heart)
    is_safe(bench, heart)
    run = told.value.run  # type: ignore[attr-defined]
    assert len(run) == 100
    assert run.metadata.state == "aborted"
    assert run.metadata.state_reason == str(told.value)
    assert [mark.kind for mark in run.metadata.marks] == ["bench"]


@pytest.mark.parametrize("code", ["bench-frozen", "output-not-zero"])
def test_an_output_that_cannot_be_reached_leaves_the_guardian_armed(strip: Actuator, code: str) -> None:
    bench, heart = Watched(strip, failing(code)), Heart()
    reachable = bench.zero

    def zero() -> None:
        bench.zero = reachable  # type: ignore[method-assign]
        raise BenchError("no answer", code=code, where="chassis", repair="switch the amplifier off")

    bench.zero = zero  # type: ignore[method-assign]
    with pytest.raises(BenchError):
        record(bench, "step 1 V", duration=4.0, rate=RATE, heartbeat=heart)
    assert heart.armed


def test_an_output_that_does_not_follow_is_told(strip: Actuator) -> None:
    def stuck(block: Block) -> Block:
        volts = np.full(len(block), 1.0)
        return replace(block, readings={**block.readings, "voltage": volts, "current": 0.02 * volts})

    control, heart, bench = Control(), Heart(), Watched(strip, stuck)
    outcome = captured(
        bench, "step 1 V", duration=4.0, rate=RATE, control=control, heartbeat=heart, on_block=AtRow(50, control.zero)
    )
    assert outcome.error is not None
    assert outcome.error.code == "output-stuck"
    assert "the output should be at 0 V and 1 V are read" in str(outcome.error)
    assert outcome.state == "aborted"
    assert heart.armed


def test_without_its_guardian_a_run_ends(strip: Actuator) -> None:
    bench, heart = Watched(strip), Heart(dies_after=20)
    outcome = captured(bench, "step 1 V", duration=4.0, rate=RATE, heartbeat=heart)
    is_safe(bench, heart)
    assert (outcome.state, outcome.rows) == ("aborted", 40)
    assert outcome.reason == "guardian: there is no guardian; see its log"


@pytest.mark.parametrize("fault", [KeyboardInterrupt, SystemExit, ZeroDivisionError])
def test_whatever_ends_the_program_the_output_is_at_0_and_the_rows_are_kept(
    strip: Actuator, fault: type[BaseException]
) -> None:
    def end() -> None:
        raise fault

    bench, heart = Watched(strip), Heart()
    with pytest.raises(fault) as told:
        record(bench, "step 1 V", duration=4.0, rate=RATE, heartbeat=heart, on_block=AtRow(100, end))
    is_safe(bench, heart)
    run = told.value.run  # type: ignore[attr-defined]
    assert len(run) == 100
    assert run.metadata.state == "aborted"
    assert run.metadata.state_reason == {
        KeyboardInterrupt: "interrupted from the keyboard",
        SystemExit: "the system asked the recorder to end",
        ZeroDivisionError: "ZeroDivisionError: ",
    }.get(fault)


@pytest.fixture(params=["SIGINT", "SIGTERM", "SIGHUP"])
def system_signal(request: pytest.FixtureRequest) -> Iterator[int]:
    """A signal with the action that it has by default: whoever starts the suite with nohup ignores SIGHUP."""
    number = getattr(signal, request.param, None)
    if number is None:
        pytest.skip(f"this system has no {request.param}")
    before = signal.signal(number, signal.default_int_handler if request.param == "SIGINT" else signal.SIG_DFL)
    yield number
    signal.signal(number, before)


def test_a_signal_of_the_system_is_an_end_with_the_output_at_0(strip: Actuator, system_signal: int) -> None:
    before = signal.getsignal(system_signal)
    bench, heart = Watched(strip), Heart()
    with pytest.raises(KeyboardInterrupt if system_signal == signal.SIGINT else SystemExit) as told:
        record(
            bench, "step 1 V", duration=4.0, rate=RATE, heartbeat=heart,
            on_block=AtRow(100, lambda: os.kill(os.getpid(), system_signal)),
        )  # fmt: skip
    is_safe(bench, heart)
    assert told.value.run.metadata.state == "aborted"  # type: ignore[attr-defined, union-attr]
    assert signal.getsignal(system_signal) == before


def test_it_records_in_any_thread(strip: Actuator) -> None:
    runs = []
    thread = threading.Thread(
        target=lambda: runs.append(record(VirtualBench(strip), "step 1 V", duration=1.0, rate=RATE))
    )
    thread.start()
    thread.join()
    assert len(runs[0]) == 50


class Ring:
    """What only the garbage collector can take away."""

    def __init__(self) -> None:
        self.itself = self


@pytest.fixture
def thawed() -> Iterator[None]:
    """As in a process that has frozen nothing."""
    gc.unfreeze()
    yield
    gc.collect()
    gc.freeze()


@pytest.mark.usefixtures("thawed")
def test_the_garbage_collector_looks_only_at_what_is_new(strip: Actuator) -> None:
    """In a large process it would stop the guard and the heartbeat for half a second."""
    seen = []

    def on_block(rows: Rows) -> None:
        new = weakref.ref(Ring())
        gc.collect()
        seen.append((old() is not None, new() is None))

    gc.disable()  # by itself it may come by before the recording begins
    old = weakref.ref(Ring())
    try:
        done = captured(VirtualBench(strip), "step 1 V", duration=1.0, rate=50.0, on_block=on_block)
    finally:
        gc.enable()
    assert done.state == "complete"
    assert set(seen) == {(True, True)}
    gc.collect()
    assert old() is None
    gc.freeze()  # the caller's own stays
    record(VirtualBench(strip), "step 1 V", duration=1.0, rate=50.0)
    assert gc.get_freeze_count() > 0


def test_a_gap_is_a_mark_and_a_finding_and_the_rows_keep_their_times(strip: Actuator) -> None:
    bench = Watched(strip, lambda block: None if block.first_row in (100, 102) else block)
    run = record(bench, "sine 1 V 0.5 Hz", duration=4.0, rate=RATE)
    assert run.time.tolist() == [k / RATE for k in range(200) if not 100 <= k < 104]
    assert [(mark.kind, mark.time, mark.text) for mark in run.metadata.marks] == [
        ("gap", 2.0, "4 rows were lost before row 104")
    ]
    missing = next(finding for finding in check(run) if finding.code == "rows-missing")
    assert missing.values["rows"] == 4


def test_rows_that_come_twice_are_an_error(strip: Actuator) -> None:
    bench = Watched(strip, lambda block: replace(block, first_row=min(block.first_row, 100)))
    with pytest.raises(IpmclabError, match="a block begins at row 100, row 102 was expected"):
        record(bench, "sine 1 V 0.5 Hz", duration=4.0, rate=RATE)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"signal": "step 5 V"}, "signal: it commands 5 V at 0 s, the limit is 3.5 V"),
        ({"signal": "step 1 V", "limits": Limits(voltage=Limit(0.5))}, "it commands 1 V at 0 s, the limit is 0.5 V"),
        ({"signal": "step 1 V", "measured": ["curent"]}, "did you mean 'current'?"),
    ],
)
def test_what_is_refused_is_refused_before_anything_moves(
    strip: Actuator, values: dict[str, Any], message: str
) -> None:
    bench = Watched(strip)
    bench.open = pytest.fail  # type: ignore[method-assign, assignment]
    with pytest.raises(InputError) as caught:
        record(bench, values.pop("signal"), duration=4.0, rate=RATE, **values)
    assert message in str(caught.value)


class Journal:
    """A journal in memory that can be full."""

    def __init__(self, header: Any, room: int = 10**9) -> None:
        self.header = header
        self.room = room
        self.rows: list[tuple[int, np.ndarray]] = []
        self.events: list[tuple[str, float, str, dict[str, Any]]] = []
        self.ended: list[tuple[str, str, Any]] = []

    def append(self, first_row: int, columns: Any) -> None:
        if sum(len(values) for _, values in self.rows) >= self.room:
            raise IpmclabError("the disk is full", code="disk-full", where="journal", repair="free some room")
        self.rows.append((first_row, np.array(columns)))

    def event(self, kind: str, time: float, text: str = "", **values: Any) -> None:
        self.events.append((kind, time, text, values))

    def end(self, state: str, reason: str = "", metadata: Any = None) -> None:
        self.ended.append((state, reason, metadata))


def test_with_a_journal_every_row_goes_there(strip: Actuator) -> None:
    journals: list[Journal] = []

    def make(header: Any) -> Journal:
        journals.append(Journal(header))
        return journals[0]

    control = Control()
    outcome = captured(
        VirtualBench(strip), "step 1 V", duration=4.0, rate=RATE, journal=make, control=control, zero_after=1.0,
        on_block=AtRow(100, lambda: control.mark("fan on")),
    )  # fmt: skip
    alone = record(VirtualBench(strip), "step 1 V", duration=4.0, rate=RATE)
    (journal,) = journals
    assert outcome.run is None
    assert journal.header.uuid == outcome.metadata.uuid
    # What is known before the first volt is in the header.
    assert {zero.when for zero in journal.header.metadata.zeros} == {"before"}
    assert journal.header.metadata.calibrations["force"] == alone.metadata.calibrations["force"]
    rows = np.concatenate([values for _, values in journal.rows])
    columns = dict(zip(journal.header.columns, rows.T, strict=True))
    for name in ("voltage", "current", "force"):
        assert columns[name].tolist() == alone.channels[name].tolist()
        assert columns[f"{name}_raw"].tolist() == alone.raw[name].tolist()
    assert columns["output_raw"].tolist() == alone.raw["output"].tolist()
    assert [event[:3] for event in journal.events if event[0] == "note"] == [("note", 2.04, "fan on")]
    air = [event for event in journal.events if event[0] == "environment"]
    assert [time for _, time, _, _ in air] == [0.5, 1.5, 2.5, 3.5]
    assert {name for *_, values in air for name in values} == {"temperature", "relative_humidity"}
    ((state, reason, metadata),) = journal.ended
    assert (state, reason) == ("complete", "")
    assert {zero.when for zero in metadata.zeros} == {"before", "after"}
    assert metadata == outcome.metadata


def test_a_journal_takes_hours_that_memory_does_not(strip: Actuator) -> None:
    asked: dict[str, Any] = {"duration": 2100.0, "rate": 10_000.0}
    with pytest.raises(InputError, match="21000000 rows, allowed are 2 to 20000000"):
        record(VirtualBench(strip), "step 1 V", **asked)
    control = Control()
    control.stop()
    outcome = captured(VirtualBench(strip), "step 1 V", journal=pytest.fail, control=control, **asked)
    assert outcome.rows == 0


def test_a_full_disk_ends_the_run_with_the_output_at_0(strip: Actuator) -> None:
    journals: list[Journal] = []

    def make(header: Any) -> Journal:
        journals.append(Journal(header, room=100))
        return journals[0]

    bench, heart = Watched(strip), Heart()
    outcome = captured(bench, "step 1 V", duration=4.0, rate=RATE, journal=make, heartbeat=heart)
    is_safe(bench, heart)
    assert outcome.error is not None
    assert outcome.error.code == "disk-full"
    assert journals[0].ended[0][:2] == ("aborted", "journal: the disk is full; free some room")


def test_a_real_journal_becomes_the_same_run(strip: Actuator, tmp_path: Path) -> None:
    from ipmclab import read_run
    from ipmclab.store.journal.finalise import finalise
    from ipmclab.store.journal.journal import Journal as RealJournal

    journals: list[RealJournal] = []

    def make(header: Any) -> RealJournal:
        journals.append(RealJournal.create(tmp_path / "lab", header, ballast=0))
        return journals[0]

    bench = Watched(strip, lambda block: None if block.first_row == 100 else block)
    outcome = captured(bench, "step 1 V", duration=4.0, rate=RATE, journal=make, limits=Limits(charge=Limit(1e-9)))
    assert outcome.state == "complete"
    run = read_run(finalise(journals[0].path, tmp_path / "lab"))
    again = Watched(strip, lambda block: None if block.first_row == 100 else block)
    alone = record(again, "step 1 V", duration=4.0, rate=RATE)
    assert run.time.tolist() == alone.time.tolist()
    for name, values in alone.channels.items():
        np.testing.assert_array_equal(run.channels[name], values, err_msg=name)
    assert {name: values.tolist() for name, values in run.raw.items()} == {
        name: values.tolist() for name, values in alone.raw.items()
    }
    assert [mark.kind for mark in run.metadata.marks] == ["gap"]
    assert run.metadata.state == "complete"
