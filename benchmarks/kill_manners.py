"""How recorders and their guardians are killed: at a moment, or as they enter a system call that is named."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np

from benchmarks.kill_points import Point, attach
from ipmclab.rig.process.client import Recorder

SEED: Final = 20261121
LATEST: Final = 3.0
"""A kill comes at most so long after the first rows [s]."""

# How often a thread makes such a call, within two seconds of recording, at the end, of watching and of acting.
RECORDING_CALLS: Final = {
    "write": 40,
    "fsync": 5,
    "sendmsg": 20,
    "recvmsg": 20,
    "openat": 60,
    "pwrite64": 60,
    "close": 40,
}
END_CALLS: Final = {"write": 30, "fsync": 2, "sendmsg": 60, "openat": 60, "unlink": 6, "close": 50, "pwrite64": 40}
WATCHING_CALLS: Final = {"write": 4, "futex": 20}
ACTING_CALLS: Final = {"write": 6, "openat": 4, "close": 3, "rename": 1, "sendmsg": 3, "recvmsg": 10, "futex": 20}

Victim = Literal["recorder", "guardian", "both"]


@dataclass(frozen=True)
class Manner:
    """How one is killed.

    Parameters
    ----------
    after : float [s]
        Since its first rows, or its journal was begun.
    early : bool
        Since its journal was begun.
    victim : "recorder", "guardian" or "both"
        Both: the recorder, and its guardian while it acts.
    point : Point, optional
        The call before which the victim is killed; without one it is killed at that moment. Of both, the guardian is.
    stop : bool
        The recorder is told to stop at that moment, so that the call is one of its end.
    lag : float [s]
        By so much the guardian is killed after the recorder, of both.
    """

    after: float
    early: bool = False
    victim: Victim = "recorder"
    point: Point | None = None
    stop: bool = False
    lag: float = 0.0

    def __str__(self) -> str:
        where = f" {self.point}{' of its end' if self.stop else ''}" if self.point else ""
        return f"{self.victim}{where}, after {self.after:.2f} s"


class Strike:
    """What is done to a recorder at its moment, and when its victim was gone."""

    def __init__(self, recorder: Recorder, manner: Manner) -> None:
        self.done = 0.0
        self.killed = math.nan
        self._tracer: subprocess.Popen[bytes] | None = None
        self._watcher: threading.Thread | None = None
        self._recorder, self._manner = recorder, manner
        self._guardian = guardian_of(recorder.process) if manner.victim != "recorder" else 0

    def strike(self) -> None:
        """Kill, or let a call kill."""
        manner, first = self._manner, self._recorder.process
        victim = first if manner.victim == "recorder" else self._guardian
        watched = first if manner.victim == "both" else victim
        self._watcher = threading.Thread(target=self._watch, args=(watched,), daemon=True)
        self._watcher.start()
        if manner.point is not None:
            self._tracer = attach(victim, manner.point)
        if manner.stop:
            self._recorder.request("stop")
        if manner.victim == "both":
            kill_process(first)
            time.sleep(manner.lag)
        if manner.point is None:
            kill_process(victim)
        self.done = time.monotonic()

    def _watch(self, process: int) -> None:
        while is_alive(process):
            time.sleep(0.003)
        self.killed = time.time()

    def when(self) -> float:
        """When the victim was gone [s since 1970]; nan where nothing was done to it."""
        if self._watcher is not None:
            self._watcher.join(10.0)
        return self.killed

    def end(self) -> None:
        """Leave nothing behind: a guardian that still acts would disturb the next one."""
        if self._manner.victim == "both":
            kill_process(self._guardian)
        if self._tracer is not None:
            with suppress(subprocess.TimeoutExpired):
                self._tracer.wait(0.5)
            self._tracer.kill()
            self._tracer.wait()


def kill_process(process: int) -> None:
    """By the signal that nobody can catch."""
    with suppress(ProcessLookupError):
        os.kill(process, signal.SIGKILL)  # noqa: TID251  # the point of it


def is_alive(process: int) -> bool:
    """Whether it runs; one whose end nobody has taken note of does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(") ")[2][0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def guardian_of(recorder: int) -> int:
    """The process of the guardian that a recorder has started."""
    for place in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            parent = int((place / "stat").read_text(encoding="utf-8").rpartition(") ")[2].split()[1])
            if parent == recorder and b"guardian_process" in (place / "cmdline").read_bytes():
                return int(place.name)
    raise AssertionError("the recorder has no guardian")


def manners(kills: int, seed: int = SEED) -> list[Manner]:
    """Recorders at random moments."""
    rng = np.random.default_rng(seed)
    return [Manner(float(rng.uniform(0.0, LATEST)), number % 10 == 0) for number in range(kills)]


def other_manners(recorders: int, guardians: int, seed: int = SEED) -> list[Manner]:
    """Recorders before a call, and guardians in all four ways."""
    rng = np.random.default_rng(seed + 1)

    def point(calls: dict[str, int]) -> Point:
        call = str(rng.choice(sorted(calls)))
        return Point(call, int(rng.integers(1, calls[call] + 1)))

    made = []
    for number in range(recorders):
        stop = number % 2 == 1
        after = float(rng.uniform(0.3, LATEST if not stop else 1.5))
        made.append(Manner(after, point=point(END_CALLS if stop else RECORDING_CALLS), stop=stop))
    for number in range(guardians):
        victim: Victim = "both" if number % 2 else "guardian"
        calls = ACTING_CALLS if victim == "both" else WATCHING_CALLS
        at = point(calls) if number % 4 < 2 else None
        made.append(Manner(float(rng.uniform(0.3, 1.5)), victim=victim, point=at, lag=float(rng.uniform(0.0, 0.1))))
    return made
