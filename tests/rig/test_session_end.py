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
from types import SimpleNamespace
from typing import Any

import pytest

from ipmclab.rig.safety import session_end
from ipmclab.rig.safety.guarded_output import Target, connect
from ipmclab.rig.safety.guardian_process import Watch
from ipmclab.rig.safety.session_end import SESSION_ENDS, SLEEP, answer, on_session_end
from tests.waiting import HANGS, Started
from tests.waiting import threads_of as threads_of

WM_PAINT, WM_CLOSE, WM_QUERYENDSESSION, WM_ENDSESSION, WM_POWERBROADCAST = 0x000F, 0x0010, 0x0011, 0x0016, 0x0218
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


class Function:
    """A function of Windows: of what it declares that it takes, it takes neither more nor less."""

    argtypes: tuple[Any, ...] | None = None
    restype: Any = None

    def __init__(self, act: Any) -> None:
        self.act = act

    def __call__(self, *given: Any) -> Any:
        if self.argtypes is not None:
            assert len(given) == len(self.argtypes)
            for kind, one in zip(self.argtypes, given, strict=True):
                kind.from_param(one)
        return self.act(*given)


class Windows:
    """What the window asks of Windows: messages are a queue, and a handler is called by whoever takes them."""

    def __init__(self, window: int | None = 7) -> None:
        self.messages: queue.SimpleQueue[tuple[int, int] | None] = queue.SimpleQueue()
        self.answers: list[int] = []
        self.asked: list[tuple[Any, ...]] = []
        self.made: tuple[Any, ...] = ()
        self.posted: list[tuple[int, ...]] = []
        self.status: int | None = None
        self.window = window
        for name in ("SetThreadExecutionState", "SetProcessShutdownParameters"):
            setattr(self, name, self._noting(name))
        self.GetModuleHandleW = Function(lambda _: 4)
        self.CreateWindowExW = Function(self._make)
        self.DefWindowProcW = Function(lambda *_: -1)

    def _noting(self, name: str) -> Any:
        return lambda *given: self.asked.append(
            (name, *(getattr(one, "value", one) for one in given), threading.current_thread().name)
        )

    def RegisterClassW(self, told: Any) -> None:  # the names of Windows
        self.named = (told._obj.name, told._obj.instance)
        self.procedure = told._obj.procedure

    def _make(self, *given: Any) -> int | None:
        assert (given[1], given[10]) == self.named
        self.made = given
        return self.window

    def PostMessageW(self, handle: Any, message: int, *details: int) -> None:
        self.posted.append((handle.value, message, *details))
        self.messages.put((message, details[0]))

    def PostQuitMessage(self, status: int) -> None:
        self.status = status
        self.messages.put(None)

    def GetMessageW(self, told: Any, *of: object) -> int:
        assert of == (None, 0, 0)  # of every window of the thread, every message
        found = self.messages.get()
        if found is not None:
            told._obj.message, told._obj.wParam = found
        return found is not None

    def DispatchMessageW(self, told: Any) -> None:
        self.answers.append(self.procedure(7, told._obj.message, told._obj.wParam, 0))


@pytest.fixture
def waited(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, bool]]:
    """On Windows, and what a run waited for there: whether it came to pass, or the run's patience ended."""
    found: list[tuple[str, bool]] = []

    class Event(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            found.append(("window", super().wait(timeout)))
            return found[-1][1]

    class Thread(threading.Thread):
        def join(self, timeout: float | None = None) -> None:
            super().join(timeout)
            found.append(("end", not self.is_alive()))

    of_threads = SimpleNamespace(Event=Event, Thread=Thread, get_ident=threading.get_ident)
    monkeypatch.setattr(session_end, "threading", of_threads)
    monkeypatch.setattr(session_end, "_PATIENCE", 30.0)  # a machine may pause
    monkeypatch.setattr(session_end.sys, "platform", "win32")
    monkeypatch.setattr(ctypes, "WINFUNCTYPE", ctypes.CFUNCTYPE, raising=False)
    return found


@pytest.mark.parametrize("options", [{}, {"last": True}])
def test_windows_tells_a_window_of_its_own_and_stays_awake_as_long_as_it_is_there(
    threads_of: Started, monkeypatch: pytest.MonkeyPatch, waited: list[tuple[str, bool]], options: dict[str, bool]
) -> None:
    windows = Windows()
    monkeypatch.setattr(ctypes, "WinDLL", lambda _: windows, raising=False)
    acted: list[tuple[str, str]] = []
    with on_session_end(lambda why: acted.append((why, threading.current_thread().name)), **options):
        assert waited == [("window", True)]
        [thread] = threads_of("end of session")
        assert thread.daemon  # were Windows not to let go of it, the program would end all the same
        # Windows lets a computer sleep again when the thread that asked it not to has ended.
        awake = ("SetThreadExecutionState", 0x80000001, thread.name)
        late = ("SetProcessShutdownParameters", 0x100, 0, thread.name)
        assert windows.asked == ([late, awake] if options else [awake])
        # Nobody sees it: it has neither a style nor a size.
        name = f"ipmclab {os.getpid()} {thread.ident}"
        assert windows.made == (0, name, name, 0, 0, 0, 0, 0, None, None, 4, None)
        for message in (
            (WM_PAINT, 0),
            (WM_QUERYENDSESSION, 0),
            (WM_ENDSESSION, 1),
            (WM_POWERBROADCAST, PBT_APMSUSPEND),
        ):
            windows.messages.put(message)
    assert waited == [("window", True), ("end", True)]
    assert windows.posted == [(7, WM_CLOSE, 0, 0)]
    assert windows.answers == [-1, 1, 0, 1, 0]
    assert windows.status == 0
    assert acted == [(SESSION_ENDS, thread.name), (SLEEP, thread.name)]


def test_without_a_window_a_run_is_recorded_all_the_same(
    threads_of: Started, monkeypatch: pytest.MonkeyPatch, waited: list[tuple[str, bool]]
) -> None:
    windows = Windows(window=None)
    windows.messages.put((WM_PAINT, 0))
    windows.messages.put(None)
    monkeypatch.setattr(ctypes, "WinDLL", lambda _: windows, raising=False)
    with on_session_end(lambda why: None):
        threads = threads_of("end of session")
    for thread in threads:
        thread.join(HANGS)
    assert waited[0] == ("window", True)
    assert (windows.posted, windows.answers) == ([], [])


def test_a_mac_is_kept_awake_as_long_as_a_run_is_recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    real, done, started = subprocess.Popen, [], []

    class Helper(real):  # type: ignore[valid-type,misc]
        def __init__(self, command: list[str], **more: Any) -> None:
            done.append(command)
            started.append(self)
            super().__init__([sys.executable, "-c", "import time; time.sleep(60)"], **more)

        def terminate(self) -> None:
            done.append("told to end")
            super().terminate()

        def wait(self, timeout: float | None = None) -> int:
            done.append("waited for")
            return super().wait(timeout)

    monkeypatch.setattr(session_end.subprocess, "Popen", Helper)
    monkeypatch.setattr(session_end.sys, "platform", "darwin")
    awake = ["/usr/bin/caffeinate", "-i", "-w", str(os.getpid())]
    with on_session_end(lambda why: None):
        [process] = started
        assert process.poll() is None
        assert done == [awake]
    assert process.poll() is not None
    assert done == [awake, "told to end", "waited for"]

    def missing(command: list[str], **more: Any) -> None:
        raise FileNotFoundError(command[0])

    monkeypatch.setattr(session_end.subprocess, "Popen", missing)
    with on_session_end(lambda why: None):
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
