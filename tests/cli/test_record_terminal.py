"""What ``ipmclab record`` does as a client of a recorder, with a hub that tells it what a recorder would."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from ipmclab.cli.app import run
from ipmclab.cli.record import Terminal, _finish
from ipmclab.cli.record_view import View, print_results
from ipmclab.rig.process.hub import Hub
from ipmclab.rig.process.messages import Message
from tests.waiting import HANGS

ENDED = Message("ended", {"status": 0, "how": "stop", "error": None, "runs": []})


def question(number: int, step: str) -> Message:
    return Message(
        "question", {"number": number, "step": step, "text": "by hand", "choices": ["done"], "default": "done"}
    )


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    (tmp_path / "recording").mkdir()
    return tmp_path / "recording"


def test_a_question_where_there_is_no_terminal(recording: Path) -> None:
    """It is said to be for somebody else, once, and only while it is open; who looks on is no answerer."""
    hub = Hub(recording, lambda _: None)
    hub.tell(question(1, "clamp"))
    hub.tell(Message("answered", {"number": 1, "step": "clamp", "value": "done", "by": "here"}))
    hub.tell(question(2, "preload"))
    command = [sys.executable, "-m", "ipmclab", "record", "--attach", str(recording.parent)]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as client:
        assert client.stderr is not None
        line = client.stderr.readline()
        assert line.startswith("preload: by hand: this question cannot be answered here (no terminal)")
        assert (hub.clients, hub.answerers) == (1, 0)
        hub.tell(ENDED)
        hub.close()
        assert client.wait(HANGS) == 0
        assert client.stderr.read() == ""


def test_two_recorders_in_one_folder(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The newest is joined and the other is named, with the words that join it."""
    first, second = (Hub(recording, lambda _: None, {"sample": f"s{n}", "rig": f"bench {n}"}) for n in (1, 2))
    for place, hub in enumerate((first, second)):
        os.utime(hub.file, (1e9 + place, 1e9 + place))
        hub.tell(ENDED)
    assert run(["record", "--attach", str(recording.parent)]) == 0
    told = capsys.readouterr()
    assert told.err.splitlines() == [
        "joined the newest: sample s2 on bench 2",
        f"also recording here: sample s1 on bench 1: ipmclab record --attach {first.file}",
    ]
    assert run(["record", "--attach", str(first.file)]) == 0
    assert capsys.readouterr().err == ""
    first.close()
    second.close()


class Recorder:
    """Remembers what it is asked for."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def request(self, kind: str, **_: Any) -> None:
        self.asked.append(kind)


def terminal(recorder: Any, **change: bool) -> Terminal:
    about = {"ask_first": True, "plan_only": False, "joined": False, **change}
    return Terminal(recorder, View(quiet=False, keys=True), **about)


@pytest.mark.parametrize("key", ["\x04", "\x1b"])
def test_control_d_is_as_control_c_at_a_prompt_and_ends_no_run_at_a_mark(key: str) -> None:
    recorder = Recorder()
    client = terminal(recorder)
    client._key("m")
    client._key("f")
    client._key(key)
    client._key("x")  # not a part of a mark any more
    client._obey_signals()
    assert recorder.asked == []
    client._put({"step": "start", "text": "begin?", "choices": ["yes", "no"], "default": "yes"})
    client._key(key)
    client._obey_signals()
    assert recorder.asked == (["stop"] if key == "\x04" else [])
    assert client.interrupted == (key == "\x04")


def test_typed_text_is_no_key_that_ends_an_experiment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keys at these times [s]: a letter stops or aborts where it stands alone, once there is something to end."""
    now = [100.0]
    monkeypatch.setattr("ipmclab.cli.record.time.monotonic", lambda: now[0])

    def asked(*keys: tuple[float, str], started: bool) -> list[str]:
        recorder = Recorder()
        client = terminal(recorder, joined=started)
        now[0] += 10.0
        begun = now[0]
        for at, key in (*keys, (5.0, "")):
            for now[0] in (begun + at, begun + at + 0.05):
                client._obey_key()
                if key and now[0] == begun + at:
                    client._key(key)
        return recorder.asked

    assert asked((0.0, "a"), started=False) == []
    assert asked((0.0, "a"), started=True) == ["abort"]
    assert asked((0.0, "s"), started=True) == ["stop"]
    assert asked((0.0, "c"), (0.1, "a"), (0.2, "t"), (0.3, "\r"), started=True) == []
    assert asked((0.0, "a"), (0.15, "\r"), started=True) == []
    assert asked((0.0, "x"), (0.5, "a"), started=True) == ["abort"]
    assert asked((0.0, "a"), (0.1, "a"), (0.2, "a"), started=True)[0] == "abort"  # who hammers on a key means it
    assert asked((0.0, "m"), (0.0, "x"), (0.0, "\r"), (0.1, "s"), started=True) == ["mark", "stop"]
    assert asked((0.0, "h"), (0.1, "z"), started=False) == ["zero"]  # 0 V is never wrong


def test_the_last_line_of_what_recorded_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    client = terminal(Recorder())
    client.interrupted = True
    with pytest.raises(SystemExit) as caught:
        _finish(client, ENDED, as_json=False)
    assert caught.value.code == 130
    assert capsys.readouterr().out == "stopped; nothing was recorded\n"
    _finish(terminal(Recorder(), plan_only=True), ENDED, as_json=False)
    assert capsys.readouterr().out == ""


def test_a_run_names_all_that_was_found_in_it(capsys: pytest.CaptureFixture[str]) -> None:
    drift = {"code": "drift-before-step", "severity": "info"}
    told = {"state": "complete", "state_reason": "", "purpose": "signal"}
    print_results([{"path": "a.nc", "findings": [drift], **told}, {"path": "b.nc", "findings": [], **told}])
    first, second = capsys.readouterr().out.splitlines()[-2:]
    assert first.split() == ["a.nc", "signal", "complete", "drift-before-step"]
    assert second.split() == ["b.nc", "signal", "complete", "nothing", "found"]


def test_the_numbers_of_a_fingerprint_are_nothing_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    told = {"state": "complete", "state_reason": "", "purpose": "fingerprint"}
    print_results([{"path": "a.nc", "findings": [{"code": "fingerprint", "severity": "info"}], **told}])
    assert capsys.readouterr().out.splitlines()[-1].split() == ["a.nc", "fingerprint", "complete", "nothing", "found"]


def test_why_a_run_ended_stands_below_the_table(capsys: pytest.CaptureFixture[str]) -> None:
    """A sentence in a column made each line of the table longer than a screen is wide."""
    why = "the output ran out of samples and holds its last voltage: this computer did not feed it in time"
    print_results([{"path": "a.nc", "purpose": "signal", "state": "aborted", "state_reason": why, "findings": []}])
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 100
    assert f"a.nc is aborted: {why}" in " ".join(out.split())
