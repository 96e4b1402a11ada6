"""What is done before a session ends, and before sleep: the messages of Windows, and the helper of a Mac."""

from __future__ import annotations

import ctypes
import io
import os
import queue
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from ipmclab.rig.safety import session_end
from ipmclab.rig.safety.guarded_output import Target, connect
from ipmclab.rig.safety.guardian_process import Watch
from ipmclab.rig.safety.session_end import SESSION_ENDS, SLEEP, answer, told_of_the_end

WM_PAINT, WM_QUERYENDSESSION, WM_ENDSESSION, WM_POWERBROADCAST = 0x000F, 0x0011, 0x0016, 0x0218
PBT_APMSUSPEND, PBT_APMRESUMEAUTOMATIC = 0x0004, 0x0012


@pytest.mark.parametrize(
    ("message", "detail", "answered", "done"),
    [
        (WM_QUERYENDSESSION, 0, 1, []),  # another program may still refuse it
        (WM_ENDSESSION, 1, 0, [SESSION_ENDS]),
        (WM_ENDSESSION, 0, 0, []),  # one did
        (WM_POWERBROADCAST, PBT_APMSUSPEND, 1, [SLEEP]),
        (WM_POWERBROADCAST, PBT_APMRESUMEAUTOMATIC, None, []),
        (WM_PAINT, 0, None, []),
    ],
)
def test_windows_is_answered_after_the_output_is_at_0_v(
    message: int, detail: int, answered: int | None, done: list[str]
) -> None:
    acted: list[str] = []
    assert answer(message, detail, acted.append) == answered
    assert acted == done


def test_windows_gets_its_answer_whatever_fails() -> None:
    def fail(why: str) -> None:
        raise RuntimeError(why)

    assert answer(WM_ENDSESSION, 1, fail) == 0


class Windows:
    """What the window asks of Windows: messages are a queue, and a handler is called by whoever takes them."""

    def __init__(self) -> None:
        self.messages: queue.SimpleQueue[tuple[int, int] | None] = queue.SimpleQueue()
        self.answers: list[int] = []
        self.asked: list[tuple[str, int, str]] = []
        self.procedure: Any = None
        for name in ("SetThreadExecutionState", "SetProcessShutdownParameters"):
            setattr(self, name, self._noting(name))
        self.GetModuleHandleW = self._giving(4)
        self.CreateWindowExW = self._giving(7)
        self.DefWindowProcW = self._giving(-1)

    def _noting(self, name: str) -> Any:
        return lambda value, *_: self.asked.append(
            (name, getattr(value, "value", value), threading.current_thread().name)
        )

    @staticmethod
    def _giving(value: int) -> Any:
        def function(*_: object) -> int:
            return value

        return function

    def RegisterClassW(self, told: Any) -> None:  # the names of Windows
        self.procedure = told._obj.procedure

    def PostMessageW(self, handle: Any, message: int, detail: int, _: int) -> None:
        assert handle.value == 7
        self.messages.put((message, detail))

    def PostQuitMessage(self, _: int) -> None:
        self.messages.put(None)

    def GetMessageW(self, told: Any, *_: object) -> int:
        found = self.messages.get()
        if found is not None:
            told._obj.message, told._obj.wParam = found
        return found is not None

    def DispatchMessageW(self, told: Any) -> None:
        self.answers.append(self.procedure(7, told._obj.message, told._obj.wParam, 0))


@pytest.mark.parametrize("last", [False, True])
def test_windows_tells_a_window_of_its_own_and_stays_awake_as_long_as_it_is_there(
    monkeypatch: pytest.MonkeyPatch, last: bool
) -> None:
    windows = Windows()
    monkeypatch.setattr(session_end.sys, "platform", "win32")
    monkeypatch.setattr(ctypes, "WinDLL", lambda _: windows, raising=False)
    monkeypatch.setattr(ctypes, "WINFUNCTYPE", ctypes.CFUNCTYPE, raising=False)
    acted: list[tuple[str, str]] = []
    with told_of_the_end(lambda why: acted.append((why, threading.current_thread().name)), last=last):
        [thread] = [one for one in threading.enumerate() if one.name == "end of session"]
        # Windows lets a computer sleep again when the thread that asked it not to has ended.
        awake = ("SetThreadExecutionState", 0x80000001, thread.name)
        assert windows.asked == [*([("SetProcessShutdownParameters", 0x100, thread.name)] if last else []), awake]
        for message in (
            (WM_PAINT, 0),
            (WM_QUERYENDSESSION, 0),
            (WM_ENDSESSION, 1),
            (WM_POWERBROADCAST, PBT_APMSUSPEND),
        ):
            windows.messages.put(message)
    assert not thread.is_alive()
    assert windows.answers[:4] == [-1, 1, 0, 1]
    assert acted == [(SESSION_ENDS, thread.name), (SLEEP, thread.name)]


def test_a_mac_is_kept_awake_as_long_as_a_run_is_recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    real, started = subprocess.Popen, []

    def start(command: list[str], **more: Any) -> subprocess.Popen[bytes]:
        process = real([sys.executable, "-c", "import time; time.sleep(60)"], **more)
        started.append((command, process))
        return process

    monkeypatch.setattr(session_end.subprocess, "Popen", start)
    monkeypatch.setattr(session_end.sys, "platform", "darwin")
    with told_of_the_end(lambda why: None):
        [(command, process)] = started
        assert command == ["/usr/bin/caffeinate", "-i", "-w", str(os.getpid())]
        assert process.poll() is None
    assert process.poll() is not None

    def missing(command: list[str], **more: Any) -> None:
        raise FileNotFoundError(command[0])

    monkeypatch.setattr(session_end.subprocess, "Popen", missing)
    with told_of_the_end(lambda why: None):
        pass


def test_an_armed_guardian_brings_the_output_to_0_v_before_sleep_and_one_that_is_not_leaves_it(tmp_path: Path) -> None:
    said, output = io.StringIO(), tmp_path / "output.txt"
    target = Target("file", str(output))
    watch = Watch(target, None, said, connect(target))
    for word in ("sleep", "arm 60", "sleep", None):
        watch.hear(word)
    assert watch.run() == 0
    assert said.getvalue().split("\n")[:4] == ["ready", "armed", "alive", f"acted {SLEEP}"]
    assert len(output.read_text().splitlines()) == 1
