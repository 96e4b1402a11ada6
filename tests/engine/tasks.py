"""Tasks of tests, which other processes find by name."""

from __future__ import annotations

import os
from pathlib import Path

from ipmclab import InputError


def power(base: int, exponent: int) -> int:
    """A task that says what is wrong with what it was given."""
    if exponent < 0:
        raise InputError("it is below 0", code="small", where=f"exponent {exponent}", repair="give 0 or more")
    return int(base**exponent)


def dies_once(folder: str, number: int) -> int:
    """A task whose worker dies the first time that every fifth number comes."""
    mark = Path(folder) / str(number)
    if number % 5 == 0 and not mark.exists():
        mark.touch()
        os._exit(9)
    return number**2


def dies(status: int, _: int) -> None:
    """A task on which every worker dies."""
    os._exit(status)


def no_way_back(_: None, __: int) -> object:
    """A task whose result cannot be sent."""
    return lambda: None


def processors_there(_: None, __: int) -> int:
    """How many processors a worker may use."""
    from ipmclab.platform import processors

    return processors()
