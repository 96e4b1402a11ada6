"""A witness of the machine's own pauses: a process that only sleeps, and notes when it is woken late.

What a test holds to fractions of a second, such as the guard's 100 ms, a virtual machine that stands still for half a
second breaks as well, and no program can prevent it. The witness tells the two apart: a busy test or a slow program
does not keep it from waking.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PAUSE = 0.05
"""So much later [s] than it asked for the witness must be woken for a pause of the machine."""

_SLEEPER = """
import os, sys, time
parent, late = int(sys.argv[2]), float(sys.argv[3])
with open(sys.argv[1], "a", buffering=1) as notes:
    last = time.monotonic()
    while os.getppid() == parent:
        time.sleep(0.005)
        now = time.monotonic()
        if now - last > late:
            notes.write(f"{now}\\n")
        last = now
"""


class Witness:
    """Notes every pause of the machine while it is there.

    Parameters
    ----------
    late : float [s]
        From when on it is a pause.
    """

    def __init__(self, late: float = PAUSE) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self._notes = Path(self._folder.name, "pauses")
        self._notes.touch()
        command = [sys.executable, "-I", "-S", "-c", _SLEEPER, str(self._notes), str(os.getpid()), str(late)]
        self._process = subprocess.Popen(command)
        self._since = time.monotonic()

    @property
    def pid(self) -> int:
        """Of the process that sleeps."""
        return self._process.pid

    def begin(self) -> None:
        """Forget what was before."""
        self._since = time.monotonic()

    def saw_a_pause(self) -> bool:
        """Whether the machine paused since ``begin``."""
        time.sleep(4.0 * PAUSE)  # for a witness that is still asleep with everybody else
        lines = self._notes.read_text(encoding="utf-8").splitlines()
        return any(float(line) >= self._since for line in lines)

    def end(self) -> None:
        """Let it go."""
        self._process.kill()
        self._process.wait()
        self._folder.cleanup()
