"""What the header says of the output, at 0 V only where the recorder or its guardian said so, and of silence."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ipmclab.errors import IpmclabError
from ipmclab.page.lab import Lab
from ipmclab.page.live.bench import Bench
from ipmclab.page.live.state import State
from ipmclab.rig.bench import BenchError
from ipmclab.rig.ni import _not_zeroed
from ipmclab.rig.process.hub import Hub
from ipmclab.rig.process.messages import Message
from tests.page.test_live import PLAN, RUN, block
from tests.waiting import until

REAL = {**PLAN, "rig_proof": "not proven"}
SWITCH = "output may not be at 0 V: switch the amplifier off"
FROZEN = BenchError("no reading within 7 s", code="bench-frozen", where="cDAQ1", repair="see to it")
RESET = IpmclabError("no answer", code="daq-1", where="cDAQ1")


def told(known: State, kind: str, **values: object) -> dict:
    known.take(Message(kind, values))
    return known.document()


def recording(plan: dict = REAL, name: str = "a.recorder", state: State | None = None) -> State:
    """A recorder that gives a voltage out."""
    state = state or State()
    state.joined({"rig": "the rig"}, name)
    told(state, "plan", **plan)
    told(state, "run", **RUN)
    told(state, "begun", journal="j")
    state.guarded("armed")
    assert told(state, "progress", rows=40, acknowledged=30, of=100)["alarm"] == ""
    return state


def recorded(state: State, how: str) -> dict:
    return told(state, "recorded", path="a.nc", state=how, signal="step 1 V", purpose="signal", findings=[])


def failed() -> dict:
    """The last word of a recorder whose chassis froze, and whose reset found no answer."""
    error = BenchError(FROZEN.message, code=FROZEN.code, where=FROZEN.where, repair=FROZEN.repair)
    first = _not_zeroed(error, RESET)
    assert first is not None
    return {**first.as_dict(), "exit_status": 1}


def test_an_output_that_could_not_be_brought_to_0_v_is_not_said_to_be() -> None:
    """From the first word of its guardian, over the end of the recorder, until the guardian has done it."""
    state = recording()
    state.guarded("failed", "cDAQ1Mod2/ao0: no answer within 1.5 s")
    during = state.document()
    assert (during["bench"], during["alarm"], during["guard"]) == ("recording", SWITCH, "guardian: failed")
    assert recorded(state, "aborted")["alarm"] == SWITCH
    after = told(state, "ended", how=None, error=failed())
    assert (after["alarm"], after["guard"]) == (SWITCH, "guardian: failed")
    assert after["text"].startswith("the guardian could not bring it to 0 V so far (cDAQ1Mod2/ao0: no answer")
    assert after["old"]
    state.guarded("zero", "the recorder is gone")
    done = state.document()
    assert (done["alarm"], done["text"]) == ("", "the guardian brought the output to 0 V")
    assert done["guard"] == "guardian: acted"
    assert done["old"]


def test_a_guardian_that_has_said_nothing_yet_has_not_confirmed_0_v() -> None:
    state = recording()
    assert recorded(state, "aborted")["alarm"] == SWITCH
    assert "guardian has not said" in told(state, "ended", how=None, error=failed())["text"]
    state.guarded("disarmed")  # of before: the recorder said that it could not
    assert state.document()["text"] == "the recorder could not bring it to 0 V"


def test_a_voltage_that_is_still_read_is_believed_more_than_a_reset() -> None:
    state = recording()
    told(state, "ended", how=None, error={"code": "output-stuck", "message": "0.8 V are still read"})
    state.guarded("zero", "the recorder is gone")
    assert state.document()["alarm"] == SWITCH
    assert "still read" in state.document()["text"]
    again = recording(name="b.recorder", state=State())  # of another page, which knows nothing of it
    assert again.document()["alarm"] == ""
    state.joined({"rig": "the rig"}, "b.recorder")
    told(state, "plan", **REAL)
    told(state, "begun", journal="j")
    assert state.document()["alarm"] == SWITCH  # its reset would say no more than the other
    state.guarded("disarmed")
    assert recorded(state, "complete")["alarm"] == ""


@pytest.mark.parametrize("guardian", ["disarmed", ""], ids=["disarmed", "ended"])
def test_a_run_that_ended_as_it_should_is_at_0_v(guardian: str) -> None:
    state = recording()
    state.guarded(guardian)
    assert recorded(state, "complete")["text"] == "output at 0 V"
    told(state, "step", name="zero", text="", seconds=0, asks=True)
    assert told(state, "question", number=1, step="zero", text="?", choices=["done"], default="done")["text"] == (
        "waits for the operator, output at 0 V"
    )
    after = told(state, "ended", how="done", error=None)
    assert (after["text"], after["alarm"], after["guard"], after["old"]) == ("output at 0 V", "", "guard: off", True)


def test_a_simulated_strip_needs_no_guardian() -> None:
    state = recording(plan=PLAN)
    state.guarded("")
    assert state.document()["guard"] == "guard: simulated strip"
    assert recorded(state, "aborted")["text"] == "output at 0 V"
    state = recording(plan=PLAN)
    state.guarded("")
    state.lost("the recorder's process is gone", is_gone=True)
    assert (state.document()["alarm"], state.document()["text"]) == ("", "the recorder's process is gone")


def test_before_the_first_volt_nothing_is_confirmed() -> None:
    """Whoever is asked to clamp the strip is told what is known: that this recorder gave nothing out."""
    state = State()
    state.joined({"rig": "the rig"}, "a.recorder")
    told(state, "plan", **REAL)
    assert told(state, "step", name="clamp", text="", seconds=0, asks=True)["text"] == "no voltage given out"
    assert told(state, "ended", how="stop", error=None)["text"] == "no voltage given out"


def test_a_guardian_that_was_killed_leaves_the_word_to_the_recorder() -> None:
    state = recording()
    error = {"code": "guardian-lost", "message": "there is no guardian: it has ended"}
    assert told(state, "ended", how=None, error=error)["alarm"] == ""


def test_the_doubt_outlives_the_recorder_until_a_later_one_has_the_output() -> None:
    state = recording()
    state.guarded("failed", "no answer")
    told(state, "ended", how=None, error=failed())
    for rig, plan in (("another rig", REAL), ("the rig", PLAN)):  # another output, and a simulated one
        state.joined({"rig": rig}, f"{rig}.recorder")
        told(state, "plan", **plan)
        told(state, "begun", journal="j")
        assert recorded(state, "complete")["alarm"] == SWITCH
    assert state.document()["text"].endswith("(an earlier recorder)")
    state.joined({"rig": "the rig"}, "later.recorder")
    assert told(state, "plan", **REAL)["alarm"] == SWITCH  # it has not touched the output yet
    assert told(state, "begun", journal="j")["alarm"] == ""


def test_a_recorder_that_died_leaves_its_output_to_its_guardian() -> None:
    for guardian, alarm, words in (
        ("zero", "", "the guardian brought the output to 0 V; the recorder's process is gone"),
        ("armed", SWITCH, "the guardian has not said that it is at 0 V; the recorder's process is gone"),
        ("failed", SWITCH, "the guardian could not bring it to 0 V so far (no answer); the recorder's process is gone"),
        ("", SWITCH, "no guardian was watching it; the recorder's process is gone"),
    ):
        state = recording()
        state.guarded(guardian, "no answer")
        state.lost("the recorder's process is gone", is_gone=True)
        assert (state.document()["alarm"], state.document()["text"]) == (alarm, words)
        assert state.document()["old"]
        assert state.document()["notes"][-1]["text"] == "; ".join(filter(None, (alarm, words)))


def test_one_that_cannot_be_reached_may_have_begun_a_run() -> None:
    state = recording()
    state.guarded("disarmed")
    recorded(state, "complete")
    state.guarded("armed")
    state.lost("it does not answer", is_gone=False)
    assert state.document()["text"] == "the recorder may be driving the output; it does not answer"


def test_what_a_silent_recorder_and_its_guardian_come_to_is_said() -> None:
    state = recording()
    assert not state.document()["old"]
    state.read_nothing(2)
    silent = state.document()
    assert (silent["trouble"], silent["old"]) == (True, True)
    assert silent["text"] == "no reading has come from the recorder for 2 s"
    state.guarded("zero", "the recorder was silent for 0.5 s")
    assert state.document()["text"] == "the guardian brought the output to 0 V (no reading for 2 s)"
    assert state.trouble == state.document()["text"]
    state.guarded("failed", "no answer")
    assert state.document()["alarm"] == SWITCH
    state.guarded("armed")
    state.read_nothing(None)
    assert (state.document()["trouble"], state.document()["old"], state.trouble) == (False, False, "")


class Recorder:
    """A recorder that is only a hub, with a guardian that is only its file."""

    def __init__(self, folder: Path) -> None:
        recording = folder / "runs" / "recording"
        recording.mkdir(parents=True, exist_ok=True)
        self.hub = Hub(recording, lambda _: None, {"sample": "strip-1", "rig": "the rig", "experiment": "x.toml"})
        self.status = self.hub.file.with_suffix(".guardian")

    def tell(self, kind: str, **values: object) -> None:
        self.hub.tell(Message(kind, values))

    def guard(self, state: str, text: str = "") -> None:
        write(self.status, state, text)

    def begin(self) -> None:
        self.tell("plan", **REAL)
        self.tell("run", **RUN)
        self.tell("begun", journal="none")
        self.guard("armed")


def write(file: Path, state: str, text: str = "") -> None:
    new = file.with_suffix(".new")
    new.write_text(json.dumps({"state": state, "text": text, "time": time.time()}), encoding="utf-8")
    new.replace(file)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(Lab.open(tmp_path), "no.such.program", right=0.0)
    made.start()
    yield made
    made.follower.close()


def document(bench: Bench) -> dict:
    return bench.document("anna")


def test_silence_is_counted_where_readings_came_and_others_should(tmp_path: Path, bench: Bench) -> None:
    recorder = Recorder(tmp_path)
    recorder.begin()
    until(lambda: bench.follower.state.bench == "recording")
    time.sleep(2.0)  # longer than a run may be silent
    assert document(bench)["silent"] is None  # its zeros are read, which takes as long as it takes
    until(lambda: any(client.wants_blocks for client in recorder.hub._clients))
    recorder.hub.tell(block(0, 10))
    until(lambda: (document(bench)["silent"] or 0) >= 1)
    recorder.tell("progress", rows=10, acknowledged=10, of=100)  # the disk goes on where a chassis hangs
    until(lambda: (document(bench)["silent"] or 0) >= 2)
    until(lambda: (document(bench)["progress"] or {}).get("acknowledged") == 10)
    recorder.guard("zero", "the recorder was silent for 0.5 s")
    until(lambda: document(bench)["text"].startswith("the guardian brought the output to 0 V (no reading for "))
    assert "the guardian brought the output to 0 V" in bench.ask("anna", "zero")
    recorder.guard("armed")
    recorder.hub.tell(block(10, 90))  # it goes on, to its last row
    until(lambda: document(bench)["silent"] is None)
    time.sleep(2.0)
    assert document(bench)["silent"] is None
    recorder.guard("disarmed")
    recorder.tell("recorded", path="a.nc", state="complete", signal="step 1 V", purpose="signal", findings=[])
    until(lambda: document(bench)["text"] == "output at 0 V")
    recorder.hub.close()


def test_a_page_that_is_begun_anew_knows_what_guardians_left(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    recorder.guard("failed", "cDAQ1Mod2/ao0: no answer")
    recorder.hub.close()
    log = tmp_path / "runs" / "guardian.log"
    bench = Bench(Lab.open(tmp_path), "no.such.program", right=0.0)
    bench.start()
    until(lambda: document(bench)["alarm"] == SWITCH)
    assert document(bench)["bench"] == "idle"
    assert document(bench)["guard"] == "guardian: failed"
    with pytest.raises(IpmclabError, match=SWITCH):
        bench.ask("anna", "zero")
    recorder.guard("zero")
    until(lambda: document(bench)["alarm"] == "")
    recorder.guard("armed")  # no recorder, and no guardian that says more: a computer that lost its power
    until(lambda: document(bench)["alarm"] == SWITCH)
    before = time.time() - 100.0
    os.utime(recorder.status, (before, before))
    log.write_text("2026-11-22T10:00:00.000+01:00 armed\n2099-01-01T00:00:00.000+01:00 disarmed\n", encoding="utf-8")
    bench.follower.close()
    bench = Bench(Lab.open(tmp_path), "no.such.program", right=0.0)
    bench.start()
    other = Recorder(tmp_path)  # of a rig that runs, and is followed
    other.begin()
    until(lambda: bench.follower.state.bench == "recording")
    third = Recorder(tmp_path)  # of one that runs, and is not
    third.begin()
    until(lambda: bench.follower._looked[1] > time.monotonic() - 0.2)
    looked = bench.follower._looked[1]
    until(lambda: bench.follower._looked[1] > looked)
    assert document(bench)["alarm"] == ""
    bench.follower.close()
    for one in (other, third):
        one.hub.close()


def test_a_recorder_that_was_killed_is_lost_with_what_matters_first(tmp_path: Path, bench: Bench) -> None:
    recorder = Recorder(tmp_path)
    recorder.begin()
    until(lambda: bench.follower.is_joined and bench.follower.state.bench == "recording")
    recorder.guard("zero", "the recorder is gone")
    recorder.hub.close()
    until(lambda: document(bench)["bench"] == "lost")
    assert document(bench)["text"].startswith("the guardian brought the output to 0 V; the recorder's process is gone")
    assert document(bench)["alarm"] == ""


def test_rows_that_are_marked_as_old_are_those_of_a_run_that_is_over() -> None:
    state = recording()
    state.read({"voltage": float(np.float64(-1.0))})
    assert not state.document()["old"]
    state.guarded("disarmed")
    assert recorded(state, "complete")["old"]
    told(state, "run", **RUN)
    assert not state.document()["old"]
