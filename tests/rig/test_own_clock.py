"""A program that was held up finds its deadlines passed: it says so, and does not blame the chassis."""

import ctypes
import re
import sys
import time
from collections.abc import Iterator
from typing import Any

import pytest

from ipmclab import load_actuator
from ipmclab.errors import IpmclabError
from ipmclab.rig.bench import BenchError, Block
from ipmclab.rig.recording.recorder import record
from ipmclab.rig.recording.zeroing import read_rest, read_tare
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
