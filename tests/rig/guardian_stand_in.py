"""A guardian without a process of its own, and a clock of the recorder that a test moves: fixtures."""

from __future__ import annotations

import os
import queue
import subprocess
import threading
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from ipmclab.rig.safety import guardian as guardian_module
from ipmclab.rig.safety import own_clock
from ipmclab.rig.safety.guarded_output import Target
from ipmclab.rig.safety.guardian import Guardian
from tests.waiting import HANGS


class Turn(threading.Event):
    """What the thread that beats waits for: a test lets it look at the clock, and go on waiting."""

    def __init__(self, clock: Clock) -> None:
        super().__init__()
        self._clock = clock
        self._waits, self._may_look = threading.Semaphore(0), queue.SimpleQueue[bool]()

    def set(self) -> None:
        super().set()
        self._may_look.put(False)

    def wait(self, timeout: float | None = None) -> bool:
        self._clock.periods.add(timeout)
        self._waits.release()
        return not self._may_look.get()

    def is_awaited(self) -> None:
        assert self._waits.acquire(timeout=HANGS / 6.0), "no thread waits"
        self._waits.release()

    def pass_by(self) -> None:
        self.is_awaited()
        self._waits.acquire()
        self._may_look.put(True)
        self.is_awaited()


class Clock:
    """The time of the recorder, which stands until a test moves it, and what is done while something is waited for."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.now, self.used = 100.0, 5.0
        self.periods: set[float | None] = set()
        self.patience: list[float | None] = []
        self.is_patient = True
        self.meanwhile: Callable[[], object] = lambda: None
        time = SimpleNamespace(monotonic=lambda: self.now, thread_time=lambda: self.used)
        patch.setattr(guardian_module, "time", time)
        patch.setattr(own_clock, "time", time)
        threads = SimpleNamespace(Thread=threading.Thread, Event=self._turn, Condition=lambda: Told(self))
        patch.setattr(guardian_module, "threading", threads)

    def _turn(self) -> Turn:
        self.turn = Turn(self)
        return self.turn

    def let_it_wake(self) -> None:
        """The thread looks at the clock as it is now."""
        self.turn.pass_by()

    def goes_on(self, seconds: float) -> None:
        """While this program has the processor."""
        for _ in range(round(seconds / 0.125)):
            self.now += 0.125
            self.let_it_wake()

    def jumps(self, seconds: float) -> None:
        """While this program is held up."""
        self.turn.is_awaited()
        self.now += seconds


class Told(threading.Condition):
    """What the recorder waits at for a word of its guardian."""

    def __init__(self, clock: Clock) -> None:
        super().__init__()
        self._clock = clock

    def wait_for(self, predicate: Callable[[], Any], timeout: float | None = None) -> Any:
        self._clock.patience.append(timeout)
        self._clock.meanwhile()
        return super().wait_for(predicate, HANGS / 6.0 if self._clock.is_patient else 0.0)

    def wait(self, timeout: float | None = None) -> bool:
        was_told = super().wait(timeout)
        assert was_told or not self._clock.is_patient, "nobody told it"
        return was_told


class Process:
    """The process of a guardian: it says what a test lets it say, and keeps what it hears."""

    pid = 4711

    def __init__(self) -> None:
        read, write = os.pipe()
        self.stdin, self.stdout = self, os.fdopen(read, "rb", buffering=0)
        self._said = os.fdopen(write, "wb", buffering=0)
        self.answers = {"arm": "armed", "disarm": "disarmed"}
        self.heard: list[str] = []
        self._unsaid: list[str] = []
        self.waited: list[float | None] = []
        self.ends = self.hears = True

    def start(self, command: list[str], **how: Any) -> Process:
        self.command, self.how = command, how
        return self

    def say(self, *words: str) -> None:
        if words:
            self._said.write("".join(f"{word}\n" for word in words).encode())

    def write(self, words: bytes) -> None:
        self.heard.append(words.decode().strip())
        word, _, value = self.heard[-1].partition(" ")
        answer = f"heard {value}" if word == "ask" and self.hears else self.answers.get(word)
        self._unsaid += [answer] if answer else []

    def answer(self) -> None:
        """Not before the recorder waits for it."""
        unsaid, self._unsaid = self._unsaid, []
        self.say(*unsaid)

    def close(self) -> None:
        """The recorder lets go: an armed guardian acts, and ends; one that cannot goes on."""
        if self.ends:
            self.end()

    def end(self) -> None:
        if self.heard and self.heard[-1] != "disarm" and not self._said.closed:
            self.say("acted the recorder is gone", "zero")
        self._said.close()

    def wait(self, timeout: float | None = None) -> int:
        self.waited.append(timeout)
        if timeout is not None and not self.ends:
            raise subprocess.TimeoutExpired("guardian", timeout)
        return 0


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


@pytest.fixture
def process(monkeypatch: pytest.MonkeyPatch, clock: Clock) -> Process:
    made = Process()
    clock.meanwhile = made.answer
    system = SimpleNamespace(Popen=made.start, PIPE=-1, TimeoutExpired=subprocess.TimeoutExpired)
    monkeypatch.setattr(guardian_module, "subprocess", system)
    return made


@pytest.fixture
def guardian(process: Process, clock: Clock) -> Iterator[Guardian]:
    with Guardian(Target("file", "output.txt"), silence=1.0) as made:
        process.say("ready")
        yield made
