"""A recorder and its clients: several at once, late ones, slow ones, strangers."""

from __future__ import annotations

import json
import os
import socket
import stat
import time
from collections.abc import Iterator
from multiprocessing import AuthenticationError
from multiprocessing.connection import Client
from pathlib import Path

import numpy as np
import pytest

from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.process import client as client_module
from ipmclab.rig.process.aftermath import failures, fate
from ipmclab.rig.process.client import Recorder, attach, forget_dead_recorders, others
from ipmclab.rig.process.hub import Hub
from ipmclab.rig.process.messages import Message
from tests.waiting import HANGS, in_background, until


@pytest.fixture
def laboratory(tmp_path: Path) -> Path:
    (tmp_path / "recording").mkdir()
    return tmp_path


@pytest.fixture
def asked() -> list[Message]:
    return []


@pytest.fixture
def hub(laboratory: Path, asked: list[Message]) -> Iterator[Hub]:
    hub = Hub(laboratory / "recording", asked.append)
    yield hub
    hub.close()


def test_two_clients_hear_the_same_and_both_may_ask(hub: Hub, asked: list[Message]) -> None:
    first, second = Recorder(hub.file), Recorder(hub.file)
    until(lambda: hub.clients == 2)
    hub.tell(Message("note", {"text": "hello"}))
    for client in (first, second):
        told = client.next(HANGS)
        assert told is not None
        assert told["text"] == "hello"
    first.request("mark", text="fan on")
    second.request("stop")
    until(lambda: len(asked) == 2)
    assert {request.kind for request in asked} == {"mark", "stop"}
    first.close()
    until(lambda: hub.clients == 1)
    hub.tell(Message("note", {"text": "still there"}))
    assert second.next(HANGS) is not None
    second.close()


def test_who_comes_late_is_told_what_happened_but_not_what_was_read(hub: Hub, laboratory: Path) -> None:
    hub.tell(Message("plan", {"title": "x"}))
    hub.tell(Message("progress", {"rows": 1}))
    hub.tell(Message("progress", {"rows": 2}))
    hub.tell(Message("block", {"first_row": 0}, {"voltage": np.ones(2)}))
    hub.tell(Message("air", {"time": 0.5, "temperature": 22.0}))
    late = attach(laboratory)
    told = [late.next(HANGS), late.next(HANGS)]
    assert [(one.kind, dict(one.values)) for one in told if one] == [
        ("plan", {"title": "x"}),
        ("progress", {"rows": 2}),
    ]
    assert late.next(0.05) is None
    late.close()


def test_blocks_come_to_those_who_asked_for_them(hub: Hub) -> None:
    client = Recorder(hub.file)
    client.request("subscribe", blocks=True)
    until(lambda: hub._clients and hub._clients[0].wants_blocks)
    hub.tell(Message("block", {"first_row": 4}, {"voltage": np.array([1.0, 2.0])}))
    told = client.next(HANGS)
    assert told is not None
    assert told.arrays["voltage"].tolist() == [1.0, 2.0]
    client.close()


def test_a_client_that_does_not_read_holds_nothing_up(hub: Hub) -> None:
    client = Recorder(hub.file)
    client.request("subscribe", blocks=True)
    until(lambda: hub._clients and hub._clients[0].wants_blocks)
    block = Message("block", {"first_row": 0}, {"voltage": np.zeros(10_000)})
    # 160 MB are to be sent to a client that takes nothing; what is kept for it is bounded.
    in_background(lambda: [hub.tell(block) for _ in range(2000)]).result(HANGS)
    assert hub._clients[0].queue.qsize() <= 201
    client.close()


def test_nobody_waits_at_the_door_of_a_hub_that_was_closed(hub: Hub) -> None:
    """Its thread would go on at the next socket of the same number, and answer with the wrong token."""
    assert hub._door.is_alive()
    hub.close()
    assert not hub._door.is_alive()


def test_strangers_are_not_let_in(hub: Hub, asked: list[Message]) -> None:
    told = json.loads(hub.file.read_text())
    host, port = told["address"].split(":")
    assert host == "127.0.0.1"
    silent = socket.create_connection((host, int(port)))  # says nothing, for ever
    with pytest.raises((AuthenticationError, OSError, EOFError)):
        Client((host, int(port)), authkey=b"guess")
    honest = Recorder(hub.file)  # is let in all the same
    honest.request("mark", text="x")
    honest.request("format the disk")
    until(lambda: asked)
    assert [request.kind for request in asked] == ["mark"]
    silent.close()
    honest.close()


def test_its_file_is_for_its_owner_and_goes_with_it(laboratory: Path) -> None:
    hub = Hub(laboratory / "recording", lambda _: None)
    if os.name == "posix":
        assert stat.S_IMODE(hub.file.stat().st_mode) == 0o600
    client = Recorder(hub.file)
    until(lambda: hub.clients == 1)
    hub.tell(Message("ended", {"status": 0}))
    hub.close()
    told = client.next(HANGS)
    assert told is not None
    assert told.kind == "ended"
    with pytest.raises(IpmclabError, match="process is gone"):
        client.next(HANGS)
    assert not hub.file.exists()
    with pytest.raises(InputError, match="no recorder is running here"):
        attach(laboratory)


def test_a_file_that_a_killed_recorder_left(laboratory: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    left = laboratory / "recording" / "dead.recorder"
    left.write_text(json.dumps({"address": f"127.0.0.1:{port}", "token": "00", "process": 1}))
    with pytest.raises(IpmclabError, match="no recorder answers"):
        Recorder(left)
    left.with_suffix(".log").touch()
    living = Hub(left.parent, lambda _: None)
    forget_dead_recorders(laboratory)
    assert [path.suffix for path in left.parent.iterdir()] == [".recorder"]
    assert living.file.exists()
    living.close()


def test_a_recorder_that_hangs_lets_nobody_wait_for_ever(laboratory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(client_module, "LOGIN", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as server:  # takes who comes, and says nothing
        told = {"address": f"127.0.0.1:{server.getsockname()[1]}", "token": "00", "process": 4711}
        hangs = laboratory / "recording" / "hangs.recorder"
        hangs.write_text(json.dumps(told))
        with pytest.raises(IpmclabError, match=r"its process 4711 hangs; no guardian was watching") as caught:
            attach(laboratory)
        assert caught.value.code == "recorder-hangs"
        assert hangs.exists()
        monkeypatch.setattr(client_module, "LOGIN", 10.0)
        living = Hub(laboratory / "recording", lambda _: None, {"sample": "friend-2", "rig": "bench 2"})
        for folder in (laboratory, living.file):
            joined = attach(folder)
            assert joined.file == living.file
            assert others(joined) == [(hangs, "sample ? on ?")]
            joined.close()
        living.close()


def test_what_a_guardian_says_of_the_output(tmp_path: Path) -> None:
    """Nobody is told of 0 V that no guardian has brought."""
    recorder = tmp_path / "recording" / "a.recorder"
    recorder.parent.mkdir()
    assert "no guardian was watching" in fate(recorder, 0.0)
    status = recorder.with_suffix(".guardian")
    for state, words in (
        ("zero", "brought the output to 0 V"),
        ("disarmed", "was at 0 V"),
        ("unread", "a guardian reset the output, but could not read back that it is at 0 V (ao0: no answer)"),
        ("armed", "SWITCH THE AMPLIFIER OFF: its guardian has not said"),
        ("failed", "SWITCH THE AMPLIFIER OFF: its guardian could NOT"),
    ):
        status.write_text(json.dumps({"state": state, "text": "ao0: no answer"}))
        assert words in fate(recorder, 0.0)
    assert [file for file, _ in failures(tmp_path)] == [status]
    status.write_text("{")
    assert "has not said" in fate(recorder, 0.0)


def test_who_stops_answering_leaves_the_question_alone_from_then_on(hub: Hub) -> None:
    client = Recorder(hub.file)
    until(lambda: hub.answerers == 1)
    before = time.monotonic()
    client.request("subscribe", blocks=True, answers=False)
    until(lambda: hub.answerers == 0)
    assert hub.alone_since >= before
    hub.tell(Message("air", {"time": 0.5, "temperature": 22.0}))
    told = client.next(HANGS)
    assert told is not None
    assert told["temperature"] == 22.0
    client.close()


def test_a_recorder_that_ends_meanwhile_is_none(laboratory: Path) -> None:
    """Between the name and the look at it the file is gone: a link to nothing stands for that."""
    (laboratory / "recording" / "gone.recorder").symlink_to(laboratory / "nowhere")
    forget_dead_recorders(laboratory)
    with pytest.raises(InputError, match="no recorder is running here"):
        attach(laboratory)
