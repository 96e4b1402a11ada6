"""What the guardian's process does and when, by a clock of its own: words of a recorder, resets, and what it tells."""

from __future__ import annotations

import io
import json
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import pytest

from ipmclab.errors import IpmclabError
from ipmclab.rig.safety import guardian_process
from ipmclab.rig.safety.guarded_output import Connection, Target, connect
from ipmclab.rig.safety.guardian_process import Watch
from ipmclab.rig.safety.readback import TOLERANCE
from tests.waiting import HANGS

START: Final = 100.0


class Clock:
    """A time that passes only where the guardian waits, and where a test says so."""

    def __init__(self) -> None:
        self.now = START
        self.answer: Answer
        self._hangs = time.monotonic() + HANGS / 6.0

    def monotonic(self) -> float:
        assert time.monotonic() < self._hangs, "it goes on, and its time does not"
        return self.now

    def time(self) -> float:
        return 1.8e9 + self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


class Answer(queue.SimpleQueue[Any]):
    """Of an attempt, however slow this machine is: the time for it is over when the attempt says so itself."""

    def __init__(self, clock: Clock) -> None:
        clock.answer = self

    def get(self, block: bool = True, timeout: float | None = None) -> Any:
        found = super().get(block, HANGS / 6.0)
        if found is queue.Empty:
            raise queue.Empty
        return found


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(guardian_process, "time", made)
    queues = SimpleNamespace(SimpleQueue=lambda: Answer(made), Empty=queue.Empty)
    monkeypatch.setattr(guardian_process, "queue", queues)
    return made


@dataclass(frozen=True)
class Pause:
    """The machine stands still for so long [s]: nobody wakes, whatever time it asked for."""

    seconds: float


class Words:
    """What the recorder says: words, its silence for some seconds between them, and its end (``None``)."""

    def __init__(self, clock: Clock, *left: str | float | Pause | None) -> None:
        self._clock, self._left = clock, list(left)

    def get(self, timeout: float | None = None) -> str | None:
        if timeout is not None and timeout < 0.0:
            raise ValueError("'timeout' must be a non-negative number")
        while not isinstance(silent := self._left[0], str | None):
            if isinstance(silent, Pause):
                self._clock.now += silent.seconds
                self._left.pop(0)
                if timeout is None or silent.seconds <= timeout:
                    continue
                raise queue.Empty
            if timeout is not None and silent > timeout:
                self._clock.now += timeout
                self._left[0] = silent - timeout
                raise queue.Empty
            self._clock.now += silent
            self._left.pop(0)
        return self._left.pop(0)  # type: ignore[return-value]

    def put(self, word: str | None) -> None:
        self._left.insert(0, word)


class Told(io.StringIO):
    """What reaches the recorder, and when; each word that it does not take at once takes so long [s]."""

    def __init__(self, clock: Clock, takes: float = 0.0) -> None:
        super().__init__()
        self.heard: list[tuple[float, str]] = []
        self._clock, self._takes = clock, takes

    def flush(self) -> None:
        self._clock.now += self._takes
        self.heard.append((self._clock.now - START, self.getvalue().strip()))
        self.seek(0)
        self.truncate()


@dataclass(frozen=True)
class Watched:
    """What a guardian came to."""

    code: int
    heard: list[tuple[float, str]]
    states: list[dict[str, Any]]
    status: Path
    log: list[str]
    output: Path

    @property
    def said(self) -> list[str]:
        return [word for _, word in self.heard if word != "alive"]

    def when(self, begin: str) -> list[float]:
        return [at for at, word in self.heard if word.startswith(begin)]

    @property
    def resets(self) -> int:
        return len(self.output.read_text().splitlines()) if self.output.exists() else 0


Watching = Callable[..., Watched]


@pytest.fixture
def watched(tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch) -> Watching:
    """A guardian that hears these words, until it ends."""
    states: list[dict[str, Any]] = []
    replace_file = guardian_process.replace_file

    def replace(new: Path, path: Path) -> None:
        replace_file(new, path)
        states.append(json.loads(path.read_text()))

    monkeypatch.setattr(guardian_process, "replace_file", replace)

    def watch(*words: str | float | Pause | None, connection: Connection | None = None, takes: float = 0.0) -> Watched:
        output, status, log = (tmp_path / name for name in ("output.txt", "status.json", "guardian.log"))
        target, told = Target("file", str(output)), Told(clock, takes)
        one = Watch(target, log, told, connection or connect(target), status)
        one._words = Words(clock, *words)  # type: ignore[assignment]
        code = one.run()
        lines = log.read_text().splitlines()
        assert all(datetime.fromisoformat(line.split()[0]).tzinfo for line in lines)
        return Watched(code, told.heard, states, status, [line.partition(" ")[2] for line in lines], output)

    return watch


class Reading:
    """An output that every reset succeeds for, and that gives these voltages, or fails to tell, when it is read."""

    def __init__(self, clock: Clock, *told: float | IpmclabError, takes: float = 0.0) -> None:
        self.told, self.clock, self.takes = list(told), clock, takes
        self.resets: list[float] = []

    def reset(self) -> None:
        self.resets.append(self.clock.now - START)
        self.clock.now += self.takes

    def read(self) -> float:
        told = self.told.pop(0) if len(self.told) > 1 else self.told[0]
        if isinstance(told, IpmclabError):
            raise told
        return told

    def close(self) -> None:
        """Nothing is held."""


class Refusing(Reading):
    """An output that no reset succeeds for."""

    def reset(self) -> None:
        super().reset()
        raise failure("bench-lost")

    def read(self) -> float:
        raise AssertionError("what was not reset is not read")


def failure(code: str) -> IpmclabError:
    return IpmclabError("no reading", code=code, where="voltage", repair="see")


def test_what_is_not_armed_is_left_alone(watched: Watching) -> None:
    seen = watched(3600.0, "beat", "sleep", 3600.0, None)
    assert (seen.code, seen.heard, seen.states, seen.resets) == (0, [(0.0, "ready")], [], 0)
    assert seen.log == ["the recorder has ended"]


def test_while_it_is_armed_it_shows_twice_a_second_that_it_lives(watched: Watching) -> None:
    """Whether the recorder beats or not: one that hears nothing for seconds gives nothing out any more."""
    waiting = watched("arm 60", 1.25, "beat", 0.5, "disarm", 9.0, None)
    assert waiting.when("alive") == [0.0, 0.5, 1.0, 1.5]
    assert waiting.when("disarmed") == [1.75]


def test_beats_do_not_keep_it_from_showing_that_it_lives(watched: Watching) -> None:
    assert watched("arm 60", *(6 * (0.25, "beat")), "disarm", None).when("alive") == [0.0, 0.5, 1.0, 1.5]


def test_who_asks_is_answered_after_all_that_was_said_before(watched: Watching) -> None:
    """Whether it has acted or not. To ask is no beat: a recorder that failed may ask why, and has no more time."""
    seen = watched("ask 1", "arm 0.5", 0.25, "ask 2", 0.25, "ask 3", 9.0, "ask 4", "disarm", None)
    assert seen.said == [
        "ready", "heard 1", "armed", "heard 2", "heard 3",
        "acted the recorder was silent for 0.5 s", "zero", "heard 4", "disarmed",
    ]  # fmt: skip
    assert seen.when("acted") == [pytest.approx(0.5 + 0.03, abs=0.04)]


def test_it_acts_when_the_recorder_has_been_silent_for_so_long(watched: Watching) -> None:
    """And once: a silence that goes on changes nothing."""
    seen = watched("arm 0.5", 0.25, "beat", 60.0, None)
    assert seen.said == ["ready", "armed", "acted the recorder was silent for 0.5 s", "zero"]
    assert seen.when("acted") == [pytest.approx(0.25 + 0.5 + 0.03)]  # with a moment for what may still be unread
    assert (seen.code, seen.resets) == (0, 1)
    assert [state["state"] for state in seen.states] == ["armed", "zero"]


def test_a_word_that_came_late_is_a_sign_of_life(watched: Watching) -> None:
    """It came while the guardian was about to act; from then on the recorder has its time again."""
    seen = watched("arm 0.5", 0.51, "beat", 0.45, "disarm", None)
    assert seen.said == ["ready", "armed", "disarmed"]
    assert (seen.code, seen.resets, seen.status.exists()) == (0, 0, False)


def test_a_recorder_that_ends_just_as_it_is_looked_for_once_more_is_gone(watched: Watching) -> None:
    seen = watched("arm 0.5", 0.51, None)
    assert seen.said[2:] == ["acted the recorder is gone", "zero"]
    assert (seen.code, seen.resets) == (0, 1)


def test_a_guardian_that_was_held_up_itself_reads_first_what_came_meanwhile(watched: Watching) -> None:
    assert watched("arm 0.5", "beat", "disarm", None, takes=0.75).said == ["ready", "armed", "disarmed"]


@pytest.mark.parametrize("silent", [0.0, 0.25, 0.45])
def test_a_recorder_that_the_same_pause_held_up_has_a_moment_to_go_on(watched: Watching, silent: float) -> None:
    """A machine that stood still for 0.6 s holds both up: the recorder reads its rows first, then it beats."""
    seen = watched("arm 0.5", silent, Pause(0.6), 0.2, "beat", 0.45, "disarm", None)
    assert seen.said == ["ready", "armed", "disarmed"]
    assert (seen.code, seen.resets) == (0, 0)


def test_after_a_pause_a_recorder_that_hangs_is_waited_for_no_more_than_that_moment(watched: Watching) -> None:
    seen = watched("arm 0.5", Pause(0.6), 60.0, None)
    assert seen.said[2:] == ["acted the recorder was silent for 0.5 s", "zero"]
    assert seen.when("acted") == [pytest.approx(0.6 + 0.25)]  # within a second of its last word


def test_a_pause_excuses_no_silence_after_the_next_beat(watched: Watching) -> None:
    seen = watched("arm 0.5", Pause(0.6), 0.2, "beat", 60.0, None)
    assert seen.when("acted") == [pytest.approx(0.6 + 0.2 + 0.5 + 0.03)]


def test_a_run_that_ends_well_is_told_in_the_log_and_leaves_no_word(watched: Watching) -> None:
    seen = watched("arm 60", "beat", "disarm", None)
    assert seen.log == ["armed", "disarmed", "the recorder has ended"]
    assert [(state["state"], state["text"]) for state in seen.states] == [("armed", ""), ("disarmed", "")]
    assert not seen.status.exists()


def test_what_it_has_come_to_stays_to_be_read_once_it_acted(watched: Watching, clock: Clock) -> None:
    seen = watched("arm 60", "beat", None, connection=Reading(clock, 0.0, takes=0.25))
    assert seen.said[2:] == ["acted the recorder is gone", "zero"]
    assert json.loads(seen.status.read_text()) == {
        "state": "zero",
        "text": "the recorder is gone",
        "time": clock.time(),
    }
    assert seen.log == [
        "armed",
        f"the recorder is gone: bringing the output {seen.output} to 0 V",
        f"the output {seen.output} is at 0 V, 0.250 s after that",
        "the recorder has ended",
    ]


def test_the_next_run_is_watched_as_the_one_before(watched: Watching) -> None:
    """It acted in the first; the second ends well, so that no word of it is left."""
    seen = watched("arm 0.5", 9.0, "disarm", "arm 0.5", 0.25, "beat", "disarm", None)
    assert (seen.code, seen.resets, seen.status.exists()) == (0, 1, False)
    assert [state["state"] for state in seen.states] == ["armed", "zero", "disarmed", "armed", "disarmed"]


@pytest.mark.parametrize(("left", "resets"), [(TOLERANCE, 1), (-TOLERANCE, 1), (0.11, 2), (-0.11, 2), (-3.0, 2)])
def test_0_v_is_what_is_read_as_that(watched: Watching, clock: Clock, left: float, resets: int) -> None:
    """An amplifier that holds its output takes a reset without an error; offsets of a converter are 0 V."""
    output = Reading(clock, left, 0.0)
    seen = watched("arm 60", None, connection=output)
    assert (seen.code, len(output.resets), seen.said[-1]) == (0, resets, "zero")
    assert seen.states[-1]["state"] == "zero"
    assert [line for line in seen.log if "failed" in line] == (
        [f"it failed: it was reset, but {left:.3g} V are still read"] if resets > 1 else []
    )


def test_it_tries_ten_times_a_second_then_once_a_second_for_ten_minutes(watched: Watching, clock: Clock) -> None:
    stuck = Refusing(clock, 0.0)
    assert watched("arm 60", None, connection=stuck).code == 1
    gaps = [after - before for before, after in zip(stuck.resets, stuck.resets[1:], strict=False)]
    often = sum(gap < 0.5 for gap in gaps)
    assert often in (30, 31)  # for three seconds
    assert gaps == [pytest.approx(0.1)] * often + [pytest.approx(1.0)] * (len(gaps) - often)
    assert 600.0 < stuck.resets[-1] <= 601.1


REFUSED = "IpmclabError: voltage: no reading; see"
STUCK = "it was reset, but -3 V are still read"


@pytest.mark.parametrize(
    ("kind", "told", "why", "state"),
    [
        (Refusing, 0.0, REFUSED, "failed"),
        (Reading, -3.0, STUCK, "failed"),
        (Reading, failure("bench-lost"), REFUSED, "unread"),
        (Reading, failure("output-unread"), REFUSED, "unread"),
    ],
    ids=["refused", "stuck", "unread so far", "never to be read"],
)
def test_an_output_that_is_not_seen_at_0_v_is_cried_aloud(
    watched: Watching, clock: Clock, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    kind: type[Reading], told: float | IpmclabError, why: str, state: str,
) -> None:  # fmt: skip
    """Once after a while, and once more when it is given up; what can never be read is told at once."""
    monkeypatch.setattr(guardian_process, "_PAUSE", 0.25)
    monkeypatch.setattr(guardian_process, "LOUD", 1.0)
    monkeypatch.setattr(guardian_process, "GIVE_UP", 6.25)
    output = kind(clock, told)
    seen = watched("arm 60", None, connection=output)
    cry = f"SWITCH THE AMPLIFIER OFF, or take the strip off its leads: the output {seen.output} "
    if state == "failed":
        times = [0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 3.75, 6.25, 8.75]
        cries = [f"{cry}could NOT be brought to 0 V so far: {why}", f"{cry}could NOT be brought to 0 V: {why}"]
        words = [(1.25, f"failed the output could not be brought to 0 V: {why}")]
    else:
        is_final = isinstance(told, IpmclabError) and told.code == "output-unread"
        times = [0.0] if is_final else [0.0, 0.25, 0.5, 0.75, 1.0, 1.25]
        cries = [f"{cry}was reset, but could NOT be read back: {why}"]
        words = [(times[-1], f"unread {why}")]
    assert output.resets == times
    assert seen.heard[3:] == [(0.0, "acted the recorder is gone"), *words]
    assert [(one["state"], one["text"]) for one in seen.states] == [("armed", ""), (state, f"{seen.output}: {why}")]
    assert seen.code == 1
    assert [line for line in seen.log if "NOT" in line] == cries
    assert capsys.readouterr().err == "".join(f"\aipmclab guardian: {line}\n" for line in cries)
    assert seen.log.count(f"it failed: {why}") == len(times) - (state == "unread")
    assert seen.status.exists()


@pytest.mark.parametrize("hangs", ["reset", "read"])
def test_after_one_that_hangs_the_next_one_goes_through_a_new_connection(
    watched: Watching, clock: Clock, hangs: str
) -> None:
    asked, never = [], threading.Event()

    class Hanging:
        def reset(self) -> None:
            self.attempt("reset")

        def read(self) -> float:
            self.attempt("read")
            raise AssertionError("it hangs")

        def attempt(self, what: str) -> None:
            asked.append(threading.current_thread())
            if what == hangs:
                clock.answer.put(queue.Empty)
                never.wait(HANGS)

        def close(self) -> None:
            """Nothing is held."""

    seen = watched("arm 60", None, connection=Hanging())
    assert asked[-1].daemon  # it does not keep the process either
    never.set()
    assert (seen.code, len(asked), seen.resets) == (0, 1 if hangs == "reset" else 2, 1)
    assert "it failed: no answer within 1.5 s" in seen.log
    for thread in asked:
        thread.join()


def test_without_a_log_and_without_a_status_it_guards_as_well(tmp_path: Path) -> None:
    target, said = Target("file", str(tmp_path / "output.txt")), io.StringIO()
    for words in (["arm 60", None], ["arm 60", "disarm", None]):
        watch = Watch(target, None, said, connect(target))
        for word in words:
            watch.hear(word)
        assert watch.run() == 0
    assert said.getvalue().split("\n")[4:8] == ["zero", "ready", "armed", "alive"]
    assert [path.name for path in tmp_path.iterdir()] == ["output.txt"]
