"""Questions and requests at a recorder with its clients."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.experiments.session import Recorded
from ipmclab.rig.experiments.steps import Question
from ipmclab.rig.process.client import Recorder
from ipmclab.rig.process.hub import Hub
from ipmclab.rig.process.messages import Message
from ipmclab.rig.process.server import ClientDesk, ended

CLAMP = Question("clamp", "clamp the strip", ("done", "kept"), "done")


class Steered:
    """Remembers what it was asked for."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def stop(self) -> None:
        self.asked.append("stop")

    def abort(self, reason: str = "") -> None:
        self.asked.append(f"abort: {reason}")

    def zero(self) -> None:
        self.asked.append("zero")

    def mark(self, text: str) -> None:
        self.asked.append(f"mark: {text}")


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[ClientDesk]:
    desk = ClientDesk(patience=0.3)
    hub = desk.hub = Hub(tmp_path, desk.on_request)
    yield desk
    hub.close()


def file_of(desk: ClientDesk) -> Path:
    assert desk.hub is not None
    return desk.hub.file


def in_background(action: Callable[[], Any]) -> list[Any]:
    """The result of something that waits, once it is there."""
    found: list[Any] = []
    threading.Thread(target=lambda: found.append(action()), daemon=True).start()
    return found


def next_of(client: Recorder, kind: str) -> Message:
    end = time.monotonic() + 10.0
    while time.monotonic() < end:
        message = client.next(1.0)
        if message is not None and message.kind == kind:
            return message
    raise AssertionError(f"no {kind}")


def test_an_answer_that_was_given_beforehand_asks_nobody(desk: ClientDesk) -> None:
    desk.answer_beforehand({"clamp": "kept"})
    assert desk.ask(CLAMP, lambda: False) == "kept"
    client = Recorder(file_of(desk))
    assert next_of(client, "answered")["by"] == "beforehand"
    client.close()


def test_the_first_client_that_answers_is_heard(desk: ClientDesk) -> None:
    first, second = Recorder(file_of(desk)), Recorder(file_of(desk))
    found = in_background(lambda: desk.ask(CLAMP, lambda: False))
    number = next_of(first, "question")["number"]
    assert next_of(second, "question")["number"] == number
    second.request("answer", number=number, value="perhaps")
    assert "no answer" in next_of(first, "note")["text"]
    second.request("answer", number=number + 1, value="done")  # of another question
    second.request("answer", number=number, value="KEPT ")
    assert next_of(first, "answered")["value"] == "kept"
    first.request("answer", number=number, value="done")  # too late
    assert found == ["kept"]
    first.close()
    second.close()


def test_nobody_is_there(desk: ClientDesk) -> None:
    with pytest.raises(IpmclabError, match=r"nobody has been there for 0\.3 s") as caught:
        desk.ask(CLAMP, lambda: False)
    assert caught.value.code == "nobody-answers"
    assert not desk.wait_for_start()


def test_who_cannot_answer_holds_no_question_open(desk: ClientDesk) -> None:
    """A client without a terminal looks on; the wait is counted from the question, not from who left long before."""
    onlooker = Recorder(file_of(desk))
    onlooker.request("subscribe", blocks=False, answers=False)
    assert desk.hub is not None
    end = time.monotonic() + 5.0
    while not desk.hub.clients or desk.hub.answerers:
        assert time.monotonic() < end
        time.sleep(0.01)
    desk.hub.alone_since -= 100.0
    asked = time.monotonic()
    with pytest.raises(IpmclabError, match="nobody has been there"):
        desk.ask(CLAMP, lambda: False)
    assert time.monotonic() - asked >= 0.3
    assert next_of(onlooker, "question")["step"] == "clamp"
    onlooker.close()


def test_an_experiment_that_ends_leaves_its_question(desk: ClientDesk) -> None:
    client = Recorder(file_of(desk))
    assert desk.ask(CLAMP, lambda: True) == "done"
    client.close()


@pytest.mark.parametrize(("kind", "starts"), [("start", True), ("stop", False), ("abort", False)])
def test_the_start(desk: ClientDesk, kind: str, starts: bool) -> None:
    client = Recorder(file_of(desk))
    client.request(kind)
    assert desk.wait_for_start() is starts
    client.close()


def test_what_is_asked_before_there_is_a_session_is_not_lost(desk: ClientDesk) -> None:
    client = Recorder(file_of(desk))
    client.request("mark", text="early")
    client.request("start")
    assert desk.wait_for_start()
    client.request("abort", text="smoke")
    client.request("zero")
    end = time.monotonic() + 5.0
    while len(desk._before) < 3:
        assert time.monotonic() < end
        time.sleep(0.01)
    steered = Steered()
    desk.steer(steered)
    assert steered.asked == ["mark: early", "abort: smoke", "zero"]
    client.close()


def test_requests_reach_the_session(desk: ClientDesk) -> None:
    steered = Steered()
    desk.steer(steered)
    client = Recorder(file_of(desk))
    for kind, values in (("mark", {"text": "fan on\ud800"}), ("stop", {}), ("zero", {}), ("abort", {"text": "smoke"})):
        client.request(kind, **values)
    end = time.monotonic() + 5.0
    while len(steered.asked) < 4:
        assert time.monotonic() < end
        time.sleep(0.01)
    assert steered.asked == ["mark: fan on?", "stop", "zero", "abort: smoke"]  # what UTF-8 has not is no text
    client.close()


def test_the_last_message(tmp_path: Path) -> None:
    kept = Recorded(tmp_path / "a.nc", "signal", "step 1 V", "complete", "stopped by the operator", ())
    cut = Recorded(tmp_path / "b.nc", "signal", "step 1 V", "aborted", "too much current", ())
    assert ended((kept,), "stop", None)["status"] == 0
    assert ended((kept,), None, None)["how"] == "done"
    refused = ended((), None, InputError("35 V", code="voltage-limit", where="signal", repair="less"))
    assert (refused["status"], refused["how"]) == (2, None)
    last = ended((kept, cut), "abort", None)
    assert (last["status"], last["error"]["message"], len(last["runs"])) == (1, "too much current", 2)
    early = ended((), "abort", None, "the recorder was told to end (SIGTERM)")
    assert (early["status"], early["error"]["message"]) == (1, "the recorder was told to end (SIGTERM)")
    failed = ended((), None, IpmclabError("no chassis", code="bench-lost", where="cDAQ1", repair="plug it in"))
    assert (failed["status"], failed["error"]["code"]) == (1, "bench-lost")
