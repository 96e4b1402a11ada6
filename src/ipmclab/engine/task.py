"""One task, as a worker does it."""

from __future__ import annotations

import hashlib
import pickle
import platform
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

from ipmclab.errors import InputError

_PACKAGES: Final = ("numpy", "scipy", "numba")
_SOURCES: Final = Path(__file__).resolve().parents[1]

_one_at_a_time: Final = threading.Lock()
"""A fit sets how many threads the linear algebra of its process has: two at once would set it for each other."""


@dataclass(frozen=True)
class Outcome:
    """What became of a task.

    Parameters
    ----------
    value : object
        What the function returned.
    error : Exception or None
        What it raised.
    differs : str
        What this worker has otherwise than the program that asked; then the task was not done.
    """

    value: Any = None
    error: Exception | None = None
    differs: str = ""


def packed(function: Callable[..., Any], task: Any) -> bytes:
    """A function of a module and its task, as they travel."""
    return pickle.dumps((function, task), protocol=pickle.HIGHEST_PROTOCOL)


def perform(shared: Any, work: bytes) -> Outcome:
    """Do a task, and keep what it raises separate from what happens to workers.

    Examples
    --------
    >>> perform(2, packed(pow, 3)).value
    8
    >>> perform(2, packed(pow, "three")).error
    TypeError("unsupported operand type(s) for ** or pow(): 'int' and 'str'")
    """
    try:
        function, task = pickle.loads(work)
    except (AttributeError, ImportError) as error:
        return Outcome(error=_not_found(error))
    with _one_at_a_time:
        try:
            return Outcome(function(shared, task))
        except Exception as error:
            return Outcome(error=error)


def _not_found(error: Exception) -> InputError:
    return InputError(
        f"a worker does not find what it is to do: {error}",
        code="function-not-found",
        where="engine",
        repair="give a function of a module that is installed for the workers too, not of the script itself",
    )


@cache
def software() -> dict[str, str]:
    """What the digits of a result may depend on: Python, packages, and the text of ipmclab itself.

    Examples
    --------
    >>> list(software())
    ['ipmclab', 'python', 'numpy', 'scipy', 'numba']
    """
    digest = hashlib.sha256()
    for source in sorted(_SOURCES.rglob("*.py")):
        digest.update(source.relative_to(_SOURCES).as_posix().encode() + b"\0" + source.read_bytes())
    found = {"ipmclab": f"{_version('ipmclab')}, sources {digest.hexdigest()[:8]}", "python": platform.python_version()}
    return found | {name: _version(name) for name in _PACKAGES}


def differences(mine: dict[str, str], theirs: dict[str, str]) -> str:
    """In words what one has otherwise than the other; empty where nothing.

    Examples
    --------
    >>> differences({"numpy": "2.4.6", "scipy": "1.17.1"}, {"numpy": "2.3.0", "scipy": "1.17.1"})
    'numpy is 2.3.0 there and 2.4.6 here'
    """
    names = [name for name in mine if mine[name] != theirs.get(name)]
    return "; ".join(f"{name} is {theirs.get(name, 'not')} there and {mine[name]} here" for name in names)


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"
