"""Questions and requests at a recorder with its clients."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from ipmclab.errors import InputError, IpmclabError
from ipmclab.rig.experiments.archive import Recorded
from ipmclab.rig.experiments.steps import Question
from ipmclab.rig.process.client import Recorder
from ipmclab.rig.process.hub import Hub
from ipmclab.rig.process.messages import Message
from ipmclab.rig.process.server import ClientOperator, ended
from tests.waiting import HANGS, in_background, until

CLAMP = Question("clamp", "clamp the strip", ("done", "kept"), "done")


class Steered:
    """Remembers what it was asked for."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def stop(self) -> None:
        self.asked.append("stop")

    def abort(self, reason: str = "") -> None:
        self.asked.append(f"abort: {reason}")

    def zero(self, reason: str = "") -> None:
        self.asked.append(f"zero: {reason}")

    def mark(self, text: str) -> None:
        self.asked.append(f"mark: {text}")


@pytest.fixture
def operator(tmp_path: Path) -> Iterator[ClientOperator]:
    operator = ClientOperator(patience=0.3)
    hub = operator.hub = Hub(tmp_path, operator.on_request)
    yield operator
    hub.close()


def file_of(operator: ClientOperator) -> Path:
    assert operator.hub is not None
    return operator.hub.file


def next_of(client: Recorder, kind: str) -> Message:
    while (message := client.next(HANGS)) is not None:
        if message.kind == kind:
            return message
    raise AssertionError(f"no {kind}")


def test_an_answer_that_was_given_beforehand_asks_nobody(operator: ClientOperator) -> None:
    operator.answer_beforehand({"clamp": "kept"})
    assert operator.ask(CLAMP, lambda: False) == "kept"
    client = Recorder(file_of(operator))
    assert next_of(client, "answered")["by"] == "beforehand"
    client.close()


def test_the_first_client_that_answers_is_heard(operator: ClientOperator) -> None:
    first, second = Recorder(file_of(operator)), Recorder(file_of(operator))
    found = in_background(lambda: operator.ask(CLAMP, lambda: False))
    number = next_of(first, "question")["number"]
    assert next_of(second, "question")["number"] == number
    second.request("answer", number=number, value="perhaps")
    assert "no answer" in next_of(first, "note")["text"]
    second.request("answer", number=number + 1, value="done")  # of another question
    second.request("answer", number=number, value="KEPT ")
    assert next_of(first, "answered")["value"] == "kept"
    first.request("answer", number=number, value="done")  # too late
    assert found.result(HANGS) == "kept"
    first.close()
    second.close()


def test_nobody_is_there(operator: ClientOperator) -> None:
    with pytest.raises(IpmclabError, match=r"nobody has been there for 0\.3 s") as caught:
        operator.ask(CLAMP, lambda: False)
    assert caught.value.code == "nobody-answers"
    assert not operator.wait_for_start()


def test_who_cannot_answer_holds_no_question_open(operator: ClientOperator) -> None:
    """A client without a terminal looks on; the wait is counted from the question, not from who left long before."""
    onlooker = Recorder(file_of(operator))
    onlooker.request("subscribe", blocks=False, answers=False)
    assert operator.hub is not None
    until(lambda: operator.hub.clients and not operator.hub.answerers)
    operator.hub.alone_since -= 100.0
    asked = time.monotonic()
    with pytest.raises(IpmclabError, match="nobody has been there"):
        operator.ask(CLAMP, lambda: False)
    assert time.monotonic() - asked >= 0.3
    assert next_of(onlooker, "question")["step"] == "clamp"
    onlooker.close()


def test_an_experiment_that_ends_leaves_its_question(operator: ClientOperator) -> None:
    client = Recorder(file_of(operator))
    assert operator.ask(CLAMP, lambda: True) == "done"
    client.close()


@pytest.mark.parametrize(("kind", "starts"), [("start", True), ("stop", False), ("abort", False)])
def test_the_start(operator: ClientOperator, kind: str, starts: bool) -> None:
    client = Recorder(file_of(operator))
    client.request(kind)
    assert operator.wait_for_start() is starts
    client.close()


def test_what_is_asked_before_there_is_a_session_is_not_lost(operator: ClientOperator) -> None:
    client = Recorder(file_of(operator))
    client.request("mark", text="early")
    client.request("start")
    assert operator.wait_for_start()
    client.request("abort", text="smoke")
    client.request("zero")
    until(lambda: len(operator._before) == 3)
    steered = Steered()
    operator.steer(steered)
    assert steered.asked == ["mark: early", "abort: smoke", "zero: emergency zero by the operator"]
    client.close()


def test_requests_reach_the_session(operator: ClientOperator) -> None:
    steered = Steered()
    operator.steer(steered)
    client = Recorder(file_of(operator))
    for kind, values in (
        ("mark", {"text": "fan on\ud800"}),
        ("stop", {}),
        ("zero", {"text": "by Ben"}),
        ("abort", {"text": "smoke"}),
    ):
        client.request(kind, **values)
    until(lambda: len(steered.asked) == 4)
    assert steered.asked == ["mark: fan on?", "stop", "zero: by Ben", "abort: smoke"]  # what UTF-8 has not is no text
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
    early = ended((), "abort", None, "the recorder was asked to end (SIGTERM)")
    assert (early["status"], early["error"]["message"]) == (1, "the recorder was asked to end (SIGTERM)")
    failed = ended((), None, IpmclabError("no chassis", code="bench-lost", where="cDAQ1", repair="plug it in"))
    assert (failed["status"], failed["error"]["code"]) == (1, "bench-lost")
