"""What ``ipmclab record`` does as a client of a recorder, with a hub that tells it what a recorder would."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from ipmclab.rig.process.hub import Hub
from ipmclab.rig.process.messages import Message

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
        assert client.wait(20.0) == 0
        assert client.stderr.read() == ""
