"""How the process of a guardian starts and ends: signals, the end of a session, sleep, and what it was started with."""

from __future__ import annotations

import io
import json
import queue
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ipmclab.platform import python_child
from ipmclab.rig.safety import guardian_process
from ipmclab.rig.safety.guarded_output import Target
from ipmclab.rig.safety.guardian_process import Watch, main
from ipmclab.rig.safety.session_end import SESSION_ENDS, SLEEP
from tests.waiting import HANGS, Started, in_background, until
from tests.waiting import threads_of as threads_of


class Told(io.StringIO):
    """What reaches the recorder: not what was written only."""

    def __init__(self) -> None:
        super().__init__()
        self.words: list[str] = []

    def flush(self) -> None:
        self.words = self.getvalue().splitlines()


class Process:
    """The process of a guardian, within this one: what starts and ends it is a test's."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, *signals: str) -> None:
        self.output, self.log, self.status = (folder / name for name in ("output.txt", "guardian.log", "status.json"))
        self.handlers: dict[int, Any] = {}
        numbers = {name: getattr(signal, name, 1) for name in signals}
        known = SimpleNamespace(signal=self.handlers.__setitem__, SIG_IGN=signal.SIG_IGN, **numbers)
        monkeypatch.setattr(guardian_process, "signal", known)
        monkeypatch.setattr(guardian_process, "on_session_end", self._told_of_the_end)
        self._words: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        monkeypatch.setattr(guardian_process, "own_stdin", lambda: SimpleNamespace(readline=self._words.get))
        self.told = Told()
        monkeypatch.setattr(sys, "stdout", self.told)
        self.is_last = False
        self.over: Future[int] | None = None

    @contextmanager
    def _told_of_the_end(self, act: Callable[[str], None], *, last: bool) -> Iterator[None]:
        self.leave, self.is_last = act, last
        yield

    def start(self) -> None:
        """Until it is armed."""
        files = [Target("file", str(self.output)).to_json(), str(self.log), str(self.status)]
        self.over = in_background(lambda: main(files))
        self.say("arm 60")
        until(lambda: "alive" in self.said, HANGS / 6.0)

    def say(self, word: str) -> None:
        self._words.put(f"{word}\n".encode())

    def hang_up(self) -> None:
        self._words.put(b"")

    @property
    def said(self) -> list[str]:
        return self.told.words

    def ended(self) -> int:
        assert self.over is not None
        return int(self.over.result(HANGS / 6.0))  # it is told at once


Starting = Callable[..., Process]


@pytest.fixture
def process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Starting]:
    made = []

    def start(*signals: str) -> Process:
        one = Process(tmp_path, monkeypatch, *signals)
        made.append(one)
        one.start()
        return one

    yield start
    for one in made:
        one.hang_up()


@pytest.mark.parametrize("ignored", [["SIGINT", "SIGHUP"], ["SIGINT"]], ids=["Unix", "Windows"])
def test_a_closing_terminal_and_its_keys_do_not_end_it(process: Starting, ignored: list[str]) -> None:
    guardian = process("SIGTERM", *ignored)
    assert guardian.handlers.pop(signal.SIGTERM) is not signal.SIG_IGN
    assert guardian.handlers == {getattr(signal, name): signal.SIG_IGN for name in ignored}
    guardian.say("disarm")
    guardian.hang_up()
    assert guardian.ended() == 0
    assert guardian.said == ["ready", "armed", "alive", "disarmed"]
    assert guardian.log.read_text().endswith("the recorder has ended\n")
    assert not guardian.status.exists()
    assert not guardian.output.exists()


def test_asked_to_end_it_acts_as_if_the_recorder_were_gone(threads_of: Started, process: Starting) -> None:
    guardian = process("SIGTERM", "SIGINT")
    assert json.loads(guardian.status.read_text())["state"] == "armed"
    guardian.handlers[signal.SIGTERM](signal.SIGTERM, None)
    assert guardian.ended() == 0
    assert guardian.said[3:] == ["acted the recorder is gone", "zero"]
    # What waits for the words of a recorder that is still there does not keep the process.
    assert [thread.daemon for thread in threads_of("_read")] == [True]


def test_before_the_session_ends_the_output_is_at_0_v(process: Starting, monkeypatch: pytest.MonkeyPatch) -> None:
    """It keeps the system waiting until then and no longer, after every recorder was told."""
    monkeypatch.setattr(guardian_process, "_LEAVE", HANGS)
    guardian = process("SIGTERM")
    assert guardian.is_last
    asked, go_on = threading.Event(), threading.Event()
    reset = Watch._attempt

    def attempt(watch: Watch, what: Any) -> Any:
        asked.set()
        go_on.wait(HANGS)
        return reset(watch, what)

    monkeypatch.setattr(Watch, "_attempt", attempt)
    leaving = in_background(lambda: guardian.leave(SESSION_ENDS))
    assert asked.wait(HANGS / 6.0)
    with pytest.raises(TimeoutError):
        leaving.result(0.05)
    go_on.set()
    assert guardian.ended() == 0
    leaving.result(HANGS / 6.0)
    assert guardian.said[3:] == ["acted the recorder is gone", "zero"]


def test_before_sleep_it_acts_and_stays(process: Starting, monkeypatch: pytest.MonkeyPatch) -> None:
    assert guardian_process._LEAVE < 2.0  # so long Windows waits
    monkeypatch.setattr(guardian_process, "_LEAVE", 0.01)
    guardian = process("SIGTERM")
    guardian.leave(SLEEP)
    guardian.say("disarm")
    guardian.hang_up()
    assert guardian.ended() == 0
    assert guardian.said[3:] == [f"acted {SLEEP}", "zero", "disarmed"]


def test_one_that_cannot_connect_says_why_and_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    told = Told()
    monkeypatch.setattr(sys, "stdout", told)
    monkeypatch.setattr(guardian_process, "signal", SimpleNamespace())
    unknown = Target("kiosk", "x").to_json()  # type: ignore[arg-type]
    assert main([unknown, "", ""]) == 1
    assert told.words == ["failed guardian: unknown target 'kiosk'; use ni or file"]


def test_its_exit_status_tells_whether_it_ended_well() -> None:
    unknown = Target("kiosk", "x").to_json()  # type: ignore[arg-type]
    command = python_child("ipmclab.rig.safety.guardian_process", unknown, "", "")
    ended = subprocess.run(command, check=False, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (1, "")
    assert re.match("failed .*kiosk", ended.stdout)
