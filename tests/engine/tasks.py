"""Tasks of tests, which other processes find by name."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from ipmclab import InputError


def power(base: int, exponent: int) -> int:
    """A task that says what is wrong with what it was given."""
    if exponent < 0:
        raise InputError("too small", code="small", where=f"{exponent}", repair="give more")
    return int(base**exponent)


def dies_once(folder: str, number: int) -> int:
    """A task whose worker is killed the first time that some numbers come."""
    mark = Path(folder) / str(number)
    if number % 5 == 0 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(60)
    return number**2


def dies(shared: None, number: int) -> None:
    """A task on which every worker dies."""
    os._exit(3)
