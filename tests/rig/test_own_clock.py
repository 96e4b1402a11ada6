"""A program that was held up finds its deadlines passed: it says so, and does not blame the chassis."""

import ctypes
import re
import sys
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from ipmclab import load_actuator
from ipmclab.errors import IpmclabError
from ipmclab.rig.bench import BenchError, Block
from ipmclab.rig.recording.recorder import record
from ipmclab.rig.recording.zeroing import read_rest, read_tare
from ipmclab.rig.safety import own_clock
from ipmclab.rig.safety.own_clock import OwnClock, own_pauses_reported
from ipmclab.rig.virtual import VirtualBench

CALL = 0.8  # s
TICK = 0.1  # s: the thread that is late would have woken so long after the call began


def held_up() -> None:
    """No thread of this program runs meanwhile, as when it is stopped: the call keeps the interpreter's lock."""
    if sys.platform == "win32":
        ctypes.PyDLL("kernel32").Sleep(round(1e3 * CALL))
    else:
        ctypes.PyDLL(None).usleep(round(1e6 * CALL))


class Late(VirtualBench):
    """A bench of which a call has a deadline, and misses it."""

    def __init__(self, *, stopped: bool, opening: bool = False) -> None:
        super().__init__(load_actuator("friend-2"))
        self._stopped, self._opening = stopped, opening

    def _call(self) -> None:
        held_up() if self._stopped else time.sleep(CALL)
        raise BenchError("the server of the chassis does not answer", code="bench-frozen", repair="restart it")

    def open(self, *arguments: Any) -> None:
        super().open(*arguments)
        if self._opening:
            self._call()

    def apply(self, *arguments: Any, **more: Any) -> Iterator[Block]:
        yield next(iter(super().apply(*arguments, **more)))
        self._call()


def run(bench: Late, what: str) -> None:
    if what == "record":
        record(bench, "step 1 V", duration=2.0, rate=50.0)
    elif what == "tare":
        read_tare(bench, 50.0, when="before")
    else:
        bench.open(["voltage", "current"], 50.0)
        read_rest(bench, ["voltage", "current"], 50.0, when="before")


def failure(bench: Late, what: str) -> IpmclabError:
    with pytest.raises(IpmclabError) as told:
        run(bench, what)
    return told.value


@pytest.mark.parametrize("what", ["record", "rest"])
def test_a_recorder_that_is_held_up_while_zeros_are_read(what: str) -> None:
    told = failure(Late(stopped=True), what)
    assert told.code == "held-up"
    said = re.match(r"this computer held the recording up for (.+) s while the channels were read at 0 V; ", str(told))
    assert said
    assert float(said[1]) >= round(CALL - TICK, 1)
    assert "give this computer less to do" in str(told)
    assert "server" not in str(told)


@pytest.mark.parametrize("what", ["record", "tare"])
def test_a_recorder_that_is_held_up_while_its_bench_is_opened(what: str) -> None:
    told = failure(Late(stopped=True, opening=True), what)
    assert (told.code, "while the bench was opened" in told.message) == ("held-up", True)


@pytest.mark.real_time
def test_a_server_that_does_not_answer_is_blamed_where_the_recorder_was_free() -> None:
    assert str(failure(Late(stopped=False), "rest")) == "the server of the chassis does not answer; restart it"


PERIOD = 0.125  # s: sums of it are exact


class Life:
    """A clock that a test moves, and a thread that lives through its waits, each of so long, when it is started."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.now = 100.0
        self.waits: list[float] = []
        self.daemon: bool | None = None
        self.over = self.ended = False
        patch.setattr(own_clock, "_TICK", PERIOD)
        patch.setattr(own_clock, "time", SimpleNamespace(monotonic=lambda: self.now))
        event = SimpleNamespace(wait=self._wait, set=self._end)
        patch.setattr(own_clock, "threading", SimpleNamespace(Event=lambda: event, Thread=self._thread))

    def _thread(self, *, target: Callable[[], None], name: str, daemon: bool) -> SimpleNamespace:
        self.daemon = daemon
        return SimpleNamespace(start=target)

    def _wait(self, seconds: float) -> bool:
        assert seconds == PERIOD
        assert not self.over, "it waits on"
        self.over = not self.waits
        self.now += 0.0 if self.over else self.waits.pop(0)
        return self.over

    def _end(self) -> None:
        self.ended = True


@pytest.fixture
def life(monkeypatch: pytest.MonkeyPatch) -> Life:
    return Life(monkeypatch)


@pytest.mark.parametrize(
    ("waits", "since", "told"),
    [
        ([], 0.0, 0.0),
        ([], 0.375, 0.0),  # late by 0.25 s: a call may take 0.5 s anyway
        ([], 0.5, 0.375),
        ([0.25, PERIOD], 0.0, 0.0),
        ([0.5, PERIOD], 0.0, 0.375),
        # Late for half of the time, and for more.
        ([PERIOD] * 80, 10.25, 0.0),
        ([PERIOD] * 80, 10.375, 10.25),
        ([PERIOD] * 80, 0.0, 0.0),
    ],
)
def test_a_program_is_held_up_that_was_late_for_most_of_the_time(
    life: Life, waits: list[float], since: float, told: float
) -> None:
    life.waits = waits
    clock = OwnClock()
    life.now += since
    assert clock.held_up() == told


def test_what_was_late_before_something_came_of_it_does_not_count(life: Life) -> None:
    life.waits = [10.0]
    clock = OwnClock()
    assert clock.held_up() == 10.0 - PERIOD
    clock.progress()
    assert clock.held_up() == 0.0
    life.now += 0.5
    assert clock.held_up() == 0.375


@pytest.mark.parametrize("code", ["bench-frozen", "bench-lost", "overloaded"])
@pytest.mark.parametrize("late", [0.0, 2.0])
def test_only_a_deadline_that_passed_while_it_was_held_up_is_explained(life: Life, code: str, late: float) -> None:
    failure = BenchError("no answer", code=code, where="bench", repair="restart it")

    def fail_late() -> None:
        with own_pauses_reported("while a test was run"):
            life.now += PERIOD + late
            raise failure

    with pytest.raises(BenchError):
        fail_late()
    assert life.ended
    if late and code != "overloaded":
        assert failure.code == "held-up"
        assert str(failure).startswith("this computer held the recording up for 2.0 s while a test was run; give this")
    else:
        assert (failure.code, str(failure)) == (code, "bench: no answer; restart it")


def test_its_thread_keeps_no_program_from_ending(life: Life) -> None:
    with own_pauses_reported("while a test was run"):
        assert not life.ended
    assert (life.ended, life.daemon) == (True, True)
