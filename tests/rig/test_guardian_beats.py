"""What the recorder says to its guardian and when, by a clock that a test moves: no process of its own is there."""

from __future__ import annotations

import os
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from ipmclab.errors import IpmclabError
from ipmclab.rig.bench import BenchError
from ipmclab.rig.safety import guardian as guardian_module
from ipmclab.rig.safety import own_clock
from ipmclab.rig.safety.guarded_output import Target
from ipmclab.rig.safety.guardian import Guardian
from ipmclab.rig.safety.own_clock import Lateness
from tests.waiting import HANGS, in_background, until


class Clock:
    """The time of the recorder, which stands until a test moves it, and how often the thread that beats woke."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        self.wakes = 0
        time = SimpleNamespace(monotonic=lambda: self.now, thread_time=lambda: 0.0)
        woke = Lateness.woke

        def counted(lateness: Lateness) -> None:
            woke(lateness)
            self.wakes += 1

        patch.setattr(guardian_module, "time", time)
        patch.setattr(own_clock, "time", time)
        patch.setattr(Lateness, "woke", counted)

    def let_it_wake(self, times: int = 2) -> None:
        """The thread has looked at the clock as it is now."""
        enough = self.wakes + times
        until(lambda: self.wakes >= enough)


class Process:
    """The process of a guardian: it says what a test lets it say, and keeps what it hears."""

    pid = 0

    def __init__(self) -> None:
        read, write = os.pipe()
        self.stdin, self.stdout = self, os.fdopen(read, "rb", buffering=0)
        self._said = os.fdopen(write, "wb", buffering=0)
        self.answers = {"arm": "armed", "disarm": "disarmed"}
        self.heard: list[str] = []

    def say(self, word: str) -> None:
        self._said.write(f"{word}\n".encode())

    def write(self, words: bytes) -> None:
        self.heard.append(words.decode().strip())
        answer = self.answers.get(self.heard[-1].partition(" ")[0])
        if answer:
            self.say(answer)

    def close(self) -> None:
        self._said.close()

    def wait(self, _: float | None = None) -> int:
        return 0


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


@pytest.fixture
def process(monkeypatch: pytest.MonkeyPatch) -> Process:
    made = Process()
    monkeypatch.setattr(guardian_module, "subprocess", SimpleNamespace(Popen=lambda *_, **__: made, PIPE=-1))
    return made


@pytest.fixture
def guardian(process: Process, clock: Clock) -> Iterator[Guardian]:
    with Guardian(Target("file", "output.txt"), silence=1.0) as made:
        process.say("ready")
        yield made


def beats(process: Process) -> int:
    return process.heard.count("beat")


def test_between_blocks_that_are_close_nothing_beats_for_the_recorder(
    guardian: Guardian, process: Process, clock: Clock
) -> None:
    """A recorder that hangs after its last beat is noticed after the silence, and not a moment later."""
    guardian.arm()
    for _ in range(2):
        clock.let_it_wake()
        assert process.heard == ["arm 1.0"]
        clock.now += 0.5
    guardian.beat()
    assert process.heard == ["arm 1.0", "beat"]


@pytest.mark.parametrize("block_time", [0.0, 1.0])
def test_what_it_is_asked_to_wait_for_ends(
    guardian: Guardian, process: Process, clock: Clock, block_time: float
) -> None:
    """A task that takes two seconds, or three times between two blocks: so long a thread beats, no longer."""
    guardian.arm(block_time)
    if not block_time:
        guardian.hold(2.0)
    lasts = 3.0 * block_time or 2.0
    clock.now += lasts - 0.5
    until(lambda: beats(process))
    clock.now += 0.5
    clock.let_it_wake(1)  # it may have looked at the clock just before
    told = beats(process)
    clock.let_it_wake()
    assert beats(process) == told


def test_only_what_was_late_since_the_last_beat_counts(guardian: Guardian, process: Process, clock: Clock) -> None:
    """A recorder that was held up once, and has beaten since, is not the cause of what comes later."""
    guardian.arm()
    clock.let_it_wake(1)
    clock.now += 0.9
    clock.let_it_wake()
    guardian.beat()
    process.say("acted the recorder was silent for 1 s")
    process.say("zero")
    until(lambda: guardian.outcome)
    with pytest.raises(IpmclabError, match="the chassis gave no readings"):
        guardian.beat()


def test_once_it_is_disarmed_nothing_counts_as_late(
    guardian: Guardian, process: Process, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody wakes any more: a server that freezes then is not excused by it."""
    monkeypatch.setattr(guardian_module, "_ANSWER", 0.05)
    guardian.arm()
    clock.let_it_wake(1)
    process.say("acted the recorder was silent for 1 s")
    until(lambda: guardian.acted)
    del process.answers["disarm"]
    guardian.disarm()
    clock.now += 10.0
    failure = BenchError("the server of the chassis does not answer", code="bench-frozen", repair="restart it")
    guardian.explain(failure)
    assert failure.code == "bench-frozen"


def test_one_that_ends_before_it_is_ready_is_not_waited_for(process: Process, clock: Clock) -> None:
    guardian = Guardian(Target("file", "output.txt"))
    waiting = in_background(lambda: guardian.wait(HANGS))
    until(lambda: guardian._told._waiters)  # type: ignore[attr-defined]
    process.close()
    with pytest.raises(IpmclabError, match="there is no guardian: it has ended"):
        waiting.result(HANGS / 6.0)  # it is told at once, on whatever machine long before the wait would end
    guardian.close()


def test_a_thread_is_late_by_what_it_wakes_too_late(clock: Clock) -> None:
    lateness = Lateness(0.1)
    assert lateness.at(clock.now) == 0.0  # it does not wait yet
    lateness.begin()
    assert lateness.at(clock.now + 0.5) == pytest.approx(0.4)
    clock.now += 1.0
    lateness.woke()
    assert lateness.at(clock.now) == pytest.approx(0.9)
    lateness.forget()
    assert lateness.at(clock.now) == 0.0
    lateness.end()
    assert lateness.at(1e9) == 0.0
