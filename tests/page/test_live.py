"""What the page knows of the bench, against a real hub: readings, state, who holds it, and what is asked of it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection, Listener
from pathlib import Path
from types import SimpleNamespace

import httpx
import numpy as np
import pytest
from fastapi import FastAPI
from hypothesis import given
from hypothesis import strategies as st
from starlette.testclient import TestClient

from ipmclab import load_actuator, simulate, write_run
from ipmclab.errors import IpmclabError
from ipmclab.page.lab import Lab
from ipmclab.page.live.bench import Bench
from ipmclab.page.live.columns import Columns
from ipmclab.page.live.routes import routes
from ipmclab.page.live.seats import Seats
from ipmclab.page.live.state import State
from ipmclab.page.live.view import View
from ipmclab.page.thin import envelope, thin, within
from ipmclab.page.wire import pack
from ipmclab.rig.process.hub import SUFFIX, Hub, hang_up
from ipmclab.rig.process.messages import Message, decode
from tests.waiting import HANGS, until

PLAN = {"title": "t", "limits": {"voltage": "3.5 V"}, "steps": [], "remarks": [], "rig_proof": ""}
RUN = {"uuid": "u", "signal": "step 1 V", "purpose": "signal", "rate": 10.0, "rows": 100, "place": 1, "of": 1}


def unpack(message: bytes) -> tuple[dict, dict[str, np.ndarray]]:
    """A message as a browser reads it."""
    (length,) = struct.unpack_from("<I", message)
    head = json.loads(message[4 : 4 + length])
    at, arrays = 4 + length, {}
    for name, count in head["arrays"]:
        assert at % 8 == 0  # else JavaScript cannot look at it in place
        arrays[name] = np.frombuffer(message, "<f8", count, at)
        at += 8 * count
    assert at == len(message)
    return head, arrays


def block(first: int, count: int) -> Message:
    rows = first + np.arange(count)
    return Message("block", {"first_row": first}, {"voltage": np.sin(rows / 7), "current": rows / 1000.0})


class Recorder:
    """A recorder that is only a hub: it tells what it is made to tell, and notes what is asked of it."""

    def __init__(self, folder: Path) -> None:
        self.asked: list[Message] = []
        self.folder = folder
        recording = folder / "runs" / "recording"
        recording.mkdir(parents=True, exist_ok=True)
        self.hub = Hub(recording, self.asked.append, {"sample": "strip-1", "rig": "none", "experiment": "x.toml"})

    def tell(self, kind: str, **values: object) -> None:
        self.hub.tell(Message(kind, values))

    @property
    def is_listened_to(self) -> bool:
        """Whether blocks are sent: who comes later is not told those from before."""
        return any(client.wants_blocks for client in self.hub._clients)


class Gate:
    """A lock before which one thread waits until it is let in; others have it meanwhile."""

    def __init__(self, who: str) -> None:
        self._who = who
        self._lock = threading.Lock()
        self.is_reached = threading.Event()
        self.opened = threading.Event()

    def __enter__(self) -> None:
        if threading.current_thread().name == self._who:
            self.is_reached.set()
            assert self.opened.wait(HANGS)
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()


@pytest.fixture(autouse=True)
def patient_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let an answer of the page wait for the recorder for as long as a busy machine takes."""
    monkeypatch.setattr("ipmclab.page.live.routes.PATIENCE", HANGS)


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Recorder]:
    made = Recorder(tmp_path)
    yield made
    made.hub.close()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(Lab.open(tmp_path), "no.such.program", right=0.0)
    made.start()
    yield made
    made.follower.close()


@contextlib.contextmanager
def begun(folder: Path, right: float = 60.0) -> Iterator[Bench]:
    """The bench of a page that was begun anew."""
    made = Bench(Lab.open(folder), "no.such.program", right=right)
    made.start()
    try:
        yield made
    finally:
        made.follower.close()


@given(
    st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), min_size=1, max_size=3000),
    st.integers(16, 400),
)
def test_thinned_curves_keep_extremes_and_show_every_gap(values: list[float], points: int) -> None:
    time_ = np.arange(len(values), dtype=float)
    given_ = np.array(values)
    t, v = thin(time_, given_, points)
    known = given_[np.isfinite(given_)]
    assert set(zip(t[np.isfinite(v)].tolist(), v[np.isfinite(v)].tolist(), strict=True)) <= set(
        zip(time_.tolist(), values, strict=True)
    )
    assert (np.diff(t) > 0).all()
    if len(known):
        assert np.nanmax(v) == known.max()
        assert np.nanmin(v) == known.min()
        assert np.isfinite(v).sum() <= max(points, 4)
    if len(values) <= points - points % 4:
        assert len(t) == len(values)


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=500), st.integers(1, 40))
def test_an_envelope_holds_all_values_between_its_two(values: list[float], rows: int) -> None:
    t, (v,) = envelope(np.arange(len(values), dtype=float), [np.array(values)], rows)
    for bunch, pair in enumerate(v.reshape(-1, 2)):
        those = values[bunch * rows : (bunch + 1) * rows]
        assert sorted(pair) == [min(those), max(those)]
    assert len(t) == len(v) == 2 * (len(values) // rows)


def test_a_stretch_of_time_has_a_row_more_at_either_side() -> None:
    t = np.arange(10.0)
    assert t[within(t, 2.5, 4.5)].tolist() == [2.0, 3.0, 4.0, 5.0]
    assert len(t[within(t, None, None)]) == 10


def test_columns_stay_bounded_and_keep_every_extreme() -> None:
    columns = Columns(["voltage"], rate=100.0, most=10_000)
    rng = np.random.default_rng(20261121)
    values = rng.normal(size=100_000)
    for first in range(0, len(values), 250):
        columns.append(first, {"voltage": values[first : first + 250]})
        assert len(columns) <= 10_250
    t, held = columns.snapshot()
    assert columns.rows_received == len(values)
    assert t[-1] == pytest.approx((len(values) - 1) / 100.0)
    assert (np.diff(t) > 0).all()
    assert held["voltage"].max() == values.max()
    assert held["voltage"].min() == values.min()
    assert np.array_equal(held["voltage"][-1000:], values[-1000:])  # what a window shows is whole


def test_a_channel_that_comes_later_was_not_read_before() -> None:
    columns = Columns(["voltage"], rate=1.0)
    columns.append(0, {"voltage": np.array([1.0, 2.0])})
    columns.append(2, {"voltage": np.array([3.0]), "temperature": np.array([22.0])})
    _, held = columns.snapshot()
    assert held["temperature"][2] == 22.0
    assert np.isnan(held["temperature"][:2]).all()


def test_a_window_brings_every_row_once_and_a_new_run_begins_anew() -> None:
    columns = Columns(["voltage"], rate=10.0)
    view = View()
    view.choose({"view": "window", "seconds": 3})
    seen: list[float] = []
    for first in range(0, 200, 7):
        columns.append(first, {"voltage": np.arange(first, first + 7, dtype=float)})
        for frame in asyncio.run(view.frames(columns, 1, first)):
            head, arrays = unpack(frame)
            assert head["generation"] == 1
            assert head["fresh"] == (not seen)
            seen += arrays["voltage"].tolist()
    assert seen == [float(k) for k in range(203)]
    other = Columns(["voltage"], rate=10.0)
    other.append(0, {"voltage": np.zeros(50)})
    (frame,) = asyncio.run(view.frames(other, 2, 0.0))
    head, arrays = unpack(frame)
    assert (head["generation"], head["fresh"], len(arrays["time"])) == (2, True, 31)


def test_a_fast_run_is_sent_as_its_extremes_and_a_whole_run_thinned() -> None:
    columns = Columns(["voltage"], rate=10_000.0)
    values = np.random.default_rng(20261121).normal(size=700_000)
    columns.append(0, {"voltage": values})
    view = View()
    view.choose({"view": "window", "seconds": 60})
    (frame,) = asyncio.run(view.frames(columns, 1, 0.0))
    _, arrays = unpack(frame)
    assert len(arrays["voltage"]) <= 6002
    assert arrays["voltage"].max() == values[-600_001:].max()
    view.choose({"view": "whole", "points": 2000})
    (frame,) = asyncio.run(view.frames(columns, 1, 1.0))
    head, arrays = unpack(frame)
    assert len(arrays["voltage.value"]) <= 2000
    assert arrays["voltage.value"].min() == values.min()
    assert head["end"] == pytest.approx(69.9999)


@pytest.mark.parametrize(
    "wanted",
    [{}, {"view": "window"}, {"view": "window", "seconds": 0}, {"view": "window", "seconds": 1e9},
     {"view": "whole", "begin": "x"}, {"view": "whole", "begin": float("inf")}],
)  # fmt: skip
def test_a_view_that_is_none_is_refused(wanted: dict) -> None:
    with pytest.raises((ValueError, TypeError, KeyError)):
        View().choose(wanted)


def test_one_holds_the_bench_until_it_is_released_or_gone_for_long() -> None:
    now = [0.0]
    seats = Seats(lambda: now[0])
    seats.come("anna")
    seats.come("ben")
    seats.take("anna")
    with pytest.raises(IpmclabError, match="somebody else holds the bench"):
        seats.take("ben")
    seats.leave("anna")  # a reload
    now[0] = 29.0
    assert seats.holds("anna")
    with pytest.raises(IpmclabError, match="somebody else"):
        seats.take("ben")
    now[0] = 31.0
    seats.take("ben")
    assert not seats.holds("anna")
    seats.release("anna")
    assert seats.holds("ben")
    seats.release("ben")
    assert not seats.held
    with pytest.raises(IpmclabError, match="cookies"):
        seats.take("")


def test_a_run_that_goes_on_is_kept_for_who_held_it_when_the_page_is_begun_anew(recorder: Recorder) -> None:
    with begun(recorder.folder) as bench:
        until(lambda: bench.follower.is_joined)
        for what in ("start", "mark"):
            with pytest.raises(IpmclabError, match="who held the bench may take it again first") as refused:
                bench.ask("watcher", what)
            assert refused.value.code == "bench-kept"
        with pytest.raises(IpmclabError, match="started again"):
            bench.take("watcher")
        bench.take("operator", again=True)
        assert bench.seats.holds("operator")
        bench.seats.release("operator")
        bench.take("watcher")  # given up: it is anybody's
    with begun(recorder.folder, right=0.0) as later:
        until(lambda: later.follower.is_joined)
        later.take("watcher")
    recorder.hub.close()
    for file in (recorder.folder / "runs" / "recording").glob(f"*{SUFFIX}"):
        file.unlink(missing_ok=True)
    with begun(recorder.folder) as idle:
        idle.take("watcher")  # nothing runs: nobody waits


@pytest.mark.parametrize("what", ["stop", "abort"])
def test_who_ends_a_run_does_not_wait_for_who_held_the_bench(recorder: Recorder, what: str) -> None:
    with begun(recorder.folder) as bench:
        until(lambda: bench.follower.is_joined)
        bench.ask("watcher", what)
        until(lambda: [one.kind for one in recorder.asked] == [what])


def test_the_time_to_come_back_counts_from_when_the_page_listens(
    recorder: Recorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr("ipmclab.page.live.bench.time", SimpleNamespace(monotonic=lambda: now[0]))
    bench = Bench(Lab.open(recorder.folder), "no.such.program", right=30.0)
    now[0] += 40.0  # it takes long to begin
    bench.start()
    until(lambda: bench.follower.is_joined)
    for later in (0.0, 29.0):
        now[0] += later
        with pytest.raises(IpmclabError, match="started again"):
            bench.take("watcher")
    now[0] += 2.0
    bench.take("watcher")
    bench.follower.close()


def test_steps_are_ticked_in_their_order_and_what_comes_again_is_noted() -> None:
    state = State()
    steps = [{"name": name, "text": "", "seconds": 0, "asks": False} for name in ("clamp", "zero", "apply", "zero")]
    state.take(Message("plan", {**PLAN, "steps": steps}))
    for name in ("clamp", "zero", "apply", "zero"):
        state.take(Message("step", {"name": name, "text": "", "seconds": 0, "asks": False}))
    assert [one["state"] for one in state.document()["steps"]] == ["done", "done", "done", "now"]
    state.take(Message("step", {"name": "clamp", "text": "again", "seconds": 0, "asks": True}))
    assert "clamp once more: again" in [note["text"] for note in state.document()["notes"]]
    state.take(Message("ended", {"how": "done", "error": None}))
    assert {one["state"] for one in state.document()["steps"]} == {"done"}


def test_that_a_run_is_being_ended_is_known_to_all(recorder: Recorder, bench: Bench) -> None:
    """Who asks is believed at once; that the output is at 0 V, and what is left of the run, the recorder says."""
    recorder.tell("plan", **PLAN)
    recorder.tell("run", **RUN)
    recorder.tell("progress", rows=40, acknowledged=30, of=100)
    until(lambda: bench.follower.is_joined and bench.follower.state.readings()["progress"])
    assert bench.document("anna")["ending"] is None
    bench.ask("anna", "stop")
    assert bench.document("ben")["ending"] == {"how": "stop", "at_zero": False}
    recorder.tell("event", event="stop", time=4.1, text="stopped by the operator at 4.1 s", ending="stop")
    recorder.tell("progress", rows=41, acknowledged=30, of=46)
    until(lambda: bench.document("ben")["ending"]["at_zero"])
    bench.ask("ben", "zero")
    with begun(recorder.folder) as again:  # the recorder tells it to who comes later
        until(lambda: (again.document("ben")["ending"] or {}).get("at_zero"))
        until(lambda: again.document("ben")["progress"] == {"rows": 41, "acknowledged": 30, "of": 46})
    assert bench.document("anna")["ending"] == {"how": "zero", "at_zero": True}
    recorder.tell("recorded", path="a.nc", state="complete", signal="step 1 V", purpose="signal", findings=[])
    recorder.tell("ended", how="stop", error=None)
    until(lambda: bench.document("anna")["bench"] == "ended")
    told = bench.document("anna")
    assert (told["ending"], told["run"], told["progress"]) == (None, None, None)
    bench.follower.state.asked_here("stop")  # it ended in that moment
    assert bench.document("anna")["ending"] is None


def test_a_limit_that_ends_a_run_is_known_until_the_experiment_has_ended() -> None:
    """A limit that warns ends nothing; what is asked while the strip discharges takes nothing back but by an abort."""
    state = State()
    state.take(Message("run", RUN))
    state.take(Message("event", {"event": "limit", "time": 2.0, "text": "the energy is 26 J"}))
    state.asked_here("limit")  # nobody can ask for that
    assert state.document()["ending"] is None
    state.take(Message("event", {"event": "limit", "time": 4.0, "text": "the current is 0.3 A", "ending": "limit"}))
    limit = {"how": "limit", "at_zero": True}
    assert state.document()["ending"] == limit
    state.asked_here("stop")
    assert state.document()["ending"] == limit
    state.asked_here("abort")
    assert state.document()["ending"] == {"how": "abort", "at_zero": True}
    state.take(Message("ended", {"how": "abort", "error": None}))
    assert state.document()["ending"] is None


def test_what_is_known_of_a_long_run_stays_bounded() -> None:
    """A browser is sent all of it at each event."""
    state = State()
    state.take(Message("run", RUN))
    for k in range(2000):
        state.take(Message("event", {"time": k / 10.0, "text": f"mark {k}", "kind": "mark"}))
    told = state.document()
    assert "mark 1999" in told["notes"][-1]["text"]
    assert max(len(one) for one in told.values() if isinstance(one, list)) <= 60


def test_who_comes_in_the_middle_of_a_run_is_shown_its_beginning(recorder: Recorder, bench: Bench) -> None:
    """The rows that were told before come from the journal."""
    from ipmclab.store.journal.journal import Journal, JournalHeader

    folder = recorder.hub.file.parents[1]
    header = JournalHeader("00000000-0000-4000-8000-000000000000", 10.0, ("voltage", "current"))
    journal = Journal.create(folder, header)
    rows = np.arange(40)
    journal.append(0, np.column_stack([np.sin(rows / 7), rows / 1000.0]))
    path = journal.end("complete")
    recorder.tell("run", **RUN)
    recorder.tell("begun", uuid="u", journal=str(path))
    until(lambda: recorder.is_listened_to and bench.follower.state.journal)
    recorder.hub.tell(block(40, 10))
    until(lambda: bench.follower.columns is not None and len(bench.follower.columns) == 50)
    t, held = bench.follower.columns.snapshot()
    assert np.allclose(t, np.arange(50) / 10.0)
    assert np.allclose(held["voltage"], np.sin(np.arange(50) / 7))


def test_rows_that_the_journal_has_not_yet_leave_no_hole(recorder: Recorder, bench: Bench) -> None:
    """It is written twice a second: who joins between two writes finds it behind the blocks that come."""
    from ipmclab.store.journal.journal import Journal, JournalHeader
    from ipmclab.store.journal.record import read_journal

    folder = recorder.hub.file.parents[1]
    header = JournalHeader("00000000-0000-4000-8000-000000000000", 10.0, ("voltage", "current"))
    journal = Journal.create(folder, header)
    rows = np.column_stack([np.sin(np.arange(60) / 7), np.arange(60) / 1000.0])
    journal.append(0, rows[:25].tolist())
    recorder.tell("run", **RUN)
    recorder.tell("begun", uuid="u", journal=str(journal.path))
    until(lambda: recorder.is_listened_to and bench.follower.state.journal)
    recorder.hub.tell(block(40, 10))
    until(lambda: bench.follower.columns is not None)
    journal.append(25, rows[25:50].tolist())
    until(lambda: read_journal(journal.path).n_rows == 50)
    recorder.hub.tell(block(50, 10))
    until(lambda: len(bench.follower.columns) == 60)
    t, held = bench.follower.columns.snapshot()
    assert np.allclose(t, np.arange(60) / 10.0)
    assert np.allclose(held["voltage"], rows[:, 0])
    journal.end("complete")


def test_what_happened_keeps_its_times_for_who_comes_later(recorder: Recorder, bench: Bench) -> None:
    """A server that was killed and started anew tells what was told before it with the times of then."""
    began = time.time()
    recorder.tell("note", text="before")
    until(lambda: bench.follower.state.document()["notes"])
    heard = time.time()
    time.sleep(0.1)
    with begun(recorder.folder) as second:
        until(lambda: second.follower.state.document()["notes"])
        (told,) = second.follower.state.document()["notes"]
    assert began <= told["at"] <= heard


def test_only_the_operator_steers_and_anybody_may_zero(recorder: Recorder, bench: Bench) -> None:
    until(lambda: bench.follower.is_joined)
    app = FastAPI()
    app.include_router(routes(bench))
    anna, ben = (TestClient(app, cookies={"ipmclab-seat": name}) for name in ("anna", "ben"))
    assert anna.post("/bench/hold").status_code == 200
    assert anna.post("/bench/start").json()["message"] == "started"
    assert ben.post("/bench/stop").status_code == 409
    assert ben.post("/bench/answer", json={"number": 1, "value": "done"}).status_code == 409
    assert ben.post("/bench/zero", content=b"[" * 200_000).status_code == 200  # whatever else is said
    assert anna.post("/bench/mark", json={"text": "fan on"}).status_code == 200
    until(lambda: [one.kind for one in recorder.asked] == ["start", "zero", "mark"])
    assert recorder.asked[-1].values["text"] == "fan on"
    assert recorder.asked[1].values["text"] == "emergency zero by somebody who watched the page"
    assert anna.post("/bench/zero").status_code == 200
    until(lambda: len(recorder.asked) == 4)
    assert "text" not in recorder.asked[3].values  # the recorder says that it was the operator
    assert anna.post("/bench/explode").status_code == 404
    assert anna.post("/bench/mark", content=b"not json").status_code == 400
    assert anna.post("/bench/release").status_code == 200
    assert ben.post("/bench/stop").status_code == 200  # it was free


@pytest.mark.parametrize("number", ["x" * 70_000, 10**4000, -1, 1.5, True, None, {}, float("nan")])
def test_an_answer_that_is_none_does_not_reach_the_recorder(recorder: Recorder, bench: Bench, number: object) -> None:
    until(lambda: bench.follower.is_joined)
    app = FastAPI()
    app.include_router(routes(bench))
    anna = TestClient(app, cookies={"ipmclab-seat": "anna"})
    for body in (
        json.dumps({"number": number, "value": "done"}),
        "[" * 200_000,
        '{"number": 1, "x": "' + "x" * 300_000,
    ):
        assert anna.post("/bench/answer", content=body.encode()).status_code == 400
    half = json.dumps({"number": 1, "value": "\ud800"}).encode()
    for body in (half, b'{"number": 1, "value": "\xff"}', b'{"number": 1, "\\udfff": ""}'):
        for what in ("answer", "mark"):
            refused = anna.post(f"/bench/{what}", content=body)
            assert (refused.status_code, "UTF-8" in refused.json()["message"]) == (400, True)
    long = json.dumps({"number": 1, "value": "\U0001d400" * 9000})
    assert anna.post("/bench/answer", content=long.encode()).status_code == 200
    until(lambda: [one.kind for one in recorder.asked] == ["answer"])
    assert recorder.hub.clients == 1


def test_a_recorder_that_hung_up_and_runs_on_is_joined_again(
    recorder: Recorder, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever it was that it could not understand: STOP and ZERO reach it, and nobody is told that it is gone."""
    recorder.tell("run", **RUN)
    until(lambda: bench.follower.state.bench == "recording")
    time.sleep(1.1)
    version = bench.follower.state.version
    bench.follower.request("answer", number="x" * 70_000)
    until(lambda: bench.follower.state.version > version)  # it has told everything once more
    until(lambda: bench.follower.is_joined and recorder.hub.clients == 1)
    assert bench.follower.state.bench in ("starting", "recording")
    monkeypatch.setattr("ipmclab.page.live.follower._AGAIN", 60.0)
    bench.follower.request("answer", number="x" * 70_000)  # again: by itself it is not joined for that long
    until(lambda: not bench.follower.is_joined)
    app = FastAPI()
    app.include_router(routes(bench))
    anna = TestClient(app, cookies={"ipmclab-seat": "anna"})
    assert anna.post("/bench/zero").status_code == 200
    assert anna.post("/bench/stop").status_code == 200
    until(lambda: [one.kind for one in recorder.asked] == ["zero", "stop"])
    until(lambda: bench.follower.state.bench == "recording")


@contextlib.contextmanager
def handed_over(folder: Path) -> Iterator[tuple[Bench, Callable[[], None]]]:
    """A bench whose recorder was joined by who asks, and is about to be taken over: it is when that is called."""
    bench = Bench(Lab.open(folder), "no.such.program", right=0.0)
    gate = Gate("taking over")
    bench.follower._sending = gate
    bench.follower.reach()
    taking = threading.Thread(target=bench.follower._joined, name="taking over", daemon=True)
    taking.start()
    assert gate.is_reached.wait(HANGS)

    def take_over() -> None:
        gate.opened.set()
        taking.join(HANGS)
        assert not taking.is_alive()

    try:
        yield bench, take_over
    finally:
        gate.opened.set()
        with gate:
            for one in {bench.follower._recorder, bench.follower._next} - {None}:
                one.close()


def test_what_is_asked_while_a_recorder_is_handed_over_reaches_it(recorder: Recorder) -> None:
    with handed_over(recorder.folder) as (bench, take_over):
        assert bench.follower.request("zero")
        take_over()
        assert bench.follower.is_joined
        assert bench.follower.request("stop")
        until(lambda: [one.kind for one in recorder.asked] == ["zero", "stop"])
        assert recorder.hub.clients == 1


def test_a_recorder_that_was_given_up_while_it_was_handed_over_is_joined_anew(recorder: Recorder) -> None:
    """Who found that its connection takes nothing in asks once more, and must not be left with the same one."""
    with handed_over(recorder.folder) as (bench, take_over):
        hang_up(bench.follower._next._connection)
        assert not bench.follower.request("zero")
        take_over()
        bench.follower.reach()
        assert bench.follower.request("zero")
        until(lambda: [one.kind for one in recorder.asked] == ["zero"])


def test_who_cannot_reach_a_recorder_does_not_say_that_nothing_drives(
    recorder: Recorder, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    until(lambda: bench.follower.is_joined)

    def refuse(file: Path) -> None:
        raise IpmclabError("it is crowded", code="no-recorder", where="bench", repair="wait")

    monkeypatch.setattr("ipmclab.page.live.follower.Recorder", refuse)
    bench.follower.request("answer", number="x" * 70_000)
    until(lambda: bench.follower.state.bench == "lost")
    assert "may be driving" in bench.follower.state.document()["text"]
    with pytest.raises(IpmclabError, match="may be driving the output") as told:
        bench.ask("anna", "zero")
    assert told.value.code == "recorder-unreached"


class Deaf:
    """A recorder that lets clients in, and of which the first is never listened to: what it sends piles up."""

    def __init__(self, folder: Path) -> None:
        self.asked: list[Message] = []
        self.first, self.may_hear = threading.Event(), threading.Event()
        self.door = Listener(("127.0.0.1", 0), authkey=b"t" * 32)
        host, port = self.door.address
        recording = folder / "runs" / "recording"
        recording.mkdir(parents=True)
        told = {"address": f"{host}:{port}", "token": (b"t" * 32).hex(), "process": 1}
        (recording / f"deaf{SUFFIX}").write_text(json.dumps(told))
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        with contextlib.suppress(OSError, EOFError):
            silent = self.door.accept()
            self.first.set()
            self.may_hear.wait(HANGS)
            with self.door.accept() as heard:
                while True:
                    self.asked.append(decode(heard.recv_bytes()))
            silent.close()


@pytest.mark.skipif(os.name != "posix", reason="the socket of a connection is had by a copy of its descriptor")
def test_a_recorder_that_takes_nothing_in_freezes_nobody_and_zero_reaches_it(tmp_path: Path, bench: Bench) -> None:
    """Its connection is given up and it is joined anew; meanwhile the page answers others."""
    deaf = Deaf(tmp_path)
    assert deaf.first.wait(HANGS)
    until(lambda: bench.follower.is_joined)
    fill(bench.follower._recorder._connection)
    app = FastAPI()
    app.include_router(routes(bench))
    order: list[str] = []

    async def ask(client: httpx.AsyncClient, what: str) -> int:
        answer = await client.post(f"/bench/{what}")
        order.append(what)
        return answer.status_code

    async def both() -> list[int]:
        more = {"transport": httpx.ASGITransport(app=app), "cookies": {"ipmclab-seat": "anna"}}
        async with httpx.AsyncClient(base_url="http://127.0.0.1", **more) as client:
            zero = asyncio.create_task(ask(client, "zero"))
            await asyncio.sleep(0.1)  # zero is under way
            held = await ask(client, "hold")
            deaf.may_hear.set()
            return [held, await zero]

    assert asyncio.run(both()) == [200, 200]
    assert order == ["hold", "zero"]
    until(lambda: "zero" in [one.kind for one in deaf.asked])
    deaf.door.close()


def test_a_recorder_that_hangs_altogether_is_told_in_time(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    released = threading.Event()
    monkeypatch.setattr("ipmclab.page.live.routes.PATIENCE", 0.1)
    monkeypatch.setattr(bench.follower, "reach", released.wait)
    app = FastAPI()
    app.include_router(routes(bench))
    answer = TestClient(app).post("/bench/zero")
    released.set()
    assert answer.status_code == 503
    assert "may be driving the output" in answer.json()["message"]


def fill(connection: Connection) -> None:
    """Send until nothing more goes in, also a moment later."""
    with socket.socket(fileno=os.dup(connection.fileno())) as there:
        there.setblocking(False)
        refused = 0
        while refused < 30:
            try:
                there.send(b" " * 65536)
                refused = 0
            except BlockingIOError:
                refused += 1
                time.sleep(0.05)
        there.setblocking(True)


def test_who_asked_in_vain_does_not_hold_the_bench(bench: Bench) -> None:
    bench.seats.come("anna")
    with pytest.raises(IpmclabError, match="no recorder is at the bench"):
        bench.ask("anna", "stop")
    assert not bench.seats.held


def test_readings_are_saved_under_any_name(bench: Bench) -> None:
    app = FastAPI()
    app.include_router(routes(bench))
    assert TestClient(app).get("/live/readings", params={"csv": "步 1"}).status_code == 200


def test_zero_reaches_the_recorder_while_a_fit_holds_the_worker(
    recorder: Recorder, bench: Bench, tmp_path: Path
) -> None:
    from ipmclab.page.jobs.jobs import Jobs

    run = simulate(load_actuator("friend-2"), "square 1 V 0.1 Hz", duration=400.0, rate=100.0)
    write_run(run, tmp_path / "long.nc")
    app = FastAPI()
    app.include_router(routes(bench))
    client = TestClient(app, cookies={"ipmclab-seat": "anna"})
    until(lambda: bench.follower.is_joined)
    arguments = {
        "actuator": "friend-2",
        "runs": [str(tmp_path / "long.nc")],
        "free": ["electrical"],
        "labels": ["long"],
    }
    with Jobs() as jobs:
        job = jobs.submit("identify", {**arguments, "free": ["electrical"], "out": str(tmp_path / "out.toml")})
        until(lambda: job.state == "running" and jobs._lanes["work"]._child is not None)
        worker = jobs._lanes["work"]._child
        assert worker is not None
        if hasattr(signal, "SIGSTOP"):
            os.kill(worker.pid, signal.SIGSTOP)  # it holds the worker for as long as the rest takes
        assert client.post("/bench/zero").status_code == 200
        until(lambda: recorder.asked and recorder.asked[-1].kind == "zero")
        assert not job.is_over
        if hasattr(signal, "SIGCONT"):
            os.kill(worker.pid, signal.SIGCONT)
        jobs.cancel(job)


def test_the_link_tells_the_state_and_the_readings(recorder: Recorder, bench: Bench) -> None:
    app = FastAPI()
    app.include_router(routes(bench))
    recorder.tell("plan", **PLAN)
    recorder.tell("run", **RUN)
    until(lambda: recorder.is_listened_to and bench.follower.state.run)
    recorder.hub.tell(block(0, 30))
    until(lambda: bench.follower.columns is not None)
    client = TestClient(app, cookies={"ipmclab-seat": "anna"})
    with client.websocket_connect("/live") as socket:
        socket.send_text('{"view": "window", "seconds": 60}')
        texts, frames = [], []
        while not frames:
            message = socket.receive()
            (texts if message.get("text") else frames).append(message.get("text") or message["bytes"])
        state = json.loads(texts[0])
        assert (state["kind"], state["bench"], state["sample"], state["mine"]) == (
            "state",
            "recording",
            "strip-1",
            False,
        )
        head, arrays = unpack(frames[0])
        assert [panel["key"] for panel in head["panels"]] == ["voltage", "current"]
        assert np.allclose(arrays["current"], np.arange(30) / 1000.0)
        socket.send_text("not json")  # changes nothing
        recorder.hub.tell(Message("air", {"time": 0.5, "temperature": 22.5}))
        recorder.hub.tell(block(30, 1))
        pulse: dict = {}
        while pulse.get("latest", {}).get("temperature") is None:
            message = socket.receive()
            pulse = json.loads(message["text"]) if message.get("text") else {}
        assert pulse["latest"]["temperature"] == 22.5
    until(lambda: bench.seats.watching == 0)


def test_a_recorder_that_dies_is_told_and_the_next_is_followed(tmp_path: Path, bench: Bench) -> None:
    first = Recorder(tmp_path)
    first.tell("run", **RUN)
    until(lambda: bench.follower.state.bench == "recording")
    first.hub.close()
    until(lambda: bench.follower.state.bench == "lost")
    assert "recover" in bench.follower.state.document()["text"]
    until(lambda: not bench.follower.is_joined)
    second = Recorder(tmp_path)
    second.tell("ended", status=0, how="done", error=None, runs=[])
    until(lambda: bench.follower.state.bench == "ended")
    second.hub.close()


def test_whether_somebody_could_answer_is_told(recorder: Recorder, bench: Bench) -> None:
    until(lambda: bench.follower.is_joined)
    until(lambda: recorder.hub.answerers == 0)
    app = FastAPI()
    app.include_router(routes(bench))
    with TestClient(app, cookies={"ipmclab-seat": "anna"}) as client, client.websocket_connect("/live"):
        time.sleep(0.2)
        assert recorder.hub.answerers == 0  # they only watch
        client.post("/bench/hold")
        until(lambda: recorder.hub.answerers == 1)
    until(lambda: recorder.hub.answerers == 0)


def test_a_message_may_be_empty() -> None:
    head, arrays = unpack(pack({"kind": "rows"}, {}))
    assert (head["kind"], arrays) == ("rows", {})


def test_a_recorder_that_is_started_here_is_followed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its file is there before its start has returned: it must not be found in the meantime as well."""
    from ipmclab.page.live import follower as module
    from ipmclab.rig.process.client import Recorder as Client

    made: list[Recorder] = []

    def launch(program: str, job: dict[str, object]) -> Client:
        made.append(Recorder(tmp_path))
        time.sleep(1.0)  # the follower looks every 0.3 s
        return Client(made[0].hub.file)

    monkeypatch.setattr(module, "launch", launch)
    bench = Bench(Lab.open(tmp_path), "a.program")
    bench.start()
    bench.seats.come("anna")
    bench.prepare("anna", {"experiment": "x.toml"})
    with pytest.raises(IpmclabError, match="at the bench already"):
        bench.prepare("anna", {"experiment": "x.toml"})
    until(lambda: bench.follower.is_joined)
    assert made[0].hub.clients == 1
    bench.follower.close()
    made[0].hub.close()
