"""Waiting for what will happen, and acting in the middle of a run: by events and rows, never by a time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Final

import pytest

from ipmclab.rig.daqmx import driver, link
from ipmclab.rig.process.messages import Message
from ipmclab.rig.recording.keeping import Rows

HANGS: Final = 180.0
"""After so long [s] it is taken to hang, on whatever machine. How long something may take is a test of its own."""

Started = Callable[[str], list[threading.Thread]]


def until(condition: Callable[[], object], seconds: float = HANGS) -> None:
    """Wait until something is so.

    Parameters
    ----------
    condition : callable
    seconds : float
        Where it is held to a time, which only a test in real time may do; otherwise it only must not hang.
    """
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"it did not happen within {seconds:g} s"
        time.sleep(0.005)


@pytest.fixture(autouse=True)
def patient_calls(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let calls to a chassis wait out a machine that pauses, where a test is not held to time."""
    if not request.node.get_closest_marker("real_time"):
        monkeypatch.setattr(link, "MARGIN", HANGS)
        monkeypatch.setattr(driver.Driver, "be_patient", lambda *_: None)  # as patient as while a bench is opened


@pytest.fixture
def threads_of() -> Started:
    """The living threads of a name that started in this test: a thread of a test before may still be about to end."""
    before = set(threading.enumerate())
    return lambda name: [one for one in threading.enumerate() if name in one.name and one not in before]


def in_background(action: Callable[[], Any]) -> Future[Any]:
    """What something that waits comes to: ``result(HANGS)`` once it is there."""
    found: Future[Any] = Future()

    def act() -> None:
        try:
            found.set_result(action())
        except BaseException as error:
            found.set_exception(error)

    threading.Thread(target=act, daemon=True).start()
    return found


class AtRow:
    """Do something once, as soon as a row has been read, whatever the speed of its bench.

    It listens to a recording as ``on_block``, or to what an experiment tells its desk.

    Parameters
    ----------
    row : int
        It acts behind the block that holds the row before it.
    act : callable
    """

    def __init__(self, row: int, act: Callable[[], object]) -> None:
        self._row = row
        self._act = act
        self._has_acted = False

    def __call__(self, told: Rows | Message) -> None:
        """Look at a block; other messages are none."""
        if isinstance(told, Rows):
            stop = told.first_row + len(told)
        elif told.kind == "block":
            stop = told["first_row"] + len(next(iter(told.arrays.values())))
        else:
            return
        if stop >= self._row and not self._has_acted:
            self._has_acted = True
            self._act()
