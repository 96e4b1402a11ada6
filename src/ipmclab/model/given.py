"""What was given in place of an actuator or a run, reported by name."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike, fspath
from typing import Any

from ipmclab.errors import InputError
from ipmclab.model.actuator import Actuator
from ipmclab.run import Run


def need_actuator(given: Any) -> None:
    """Refuse what is no actuator.

    Raises
    ------
    InputError
        With the call that reads an actuator, for a name or a path.

    Examples
    --------
    >>> need_actuator("friend-2")
    Traceback (most recent call last):
        ...
    ipmclab.errors.InputError: actuator: 'friend-2' is a str, not an actuator; give load_actuator('friend-2')
    """
    if isinstance(given, Actuator):
        return
    raise _other(
        given, "an actuator", "load_actuator", "one that load_actuator read, or the actuator of a fit", "actuator"
    )


def need_run(given: Any, *, where: str = "run") -> None:
    """Refuse what is no run.

    Raises
    ------
    InputError
        With the call that reads a run, for a path.

    Examples
    --------
    >>> need_run("step.nc")
    Traceback (most recent call last):
        ...
    ipmclab.errors.InputError: run: 'step.nc' is a str, not a run; give read_run('step.nc')
    """
    if not isinstance(given, Run):
        raise _other(given, "a run", "read_run", "one that read_run read, or Run.from_arrays made", where)


def need_each_once(runs: Sequence[Run], labels: Sequence[str]) -> None:
    """Refuse a record that is given twice: counted twice, it would make a fit or a score look surer than it is.

    Parameters
    ----------
    runs : sequence of Run
    labels : sequence of str
        What each is called in the message.

    Raises
    ------
    InputError

    Examples
    --------
    >>> run = Run.from_arrays(time=[0.0, 1.0], voltage=[0.0, 1.0], force=[0.0, 1e-3])
    >>> need_each_once([run, run], ["step.nc", "copy.nc"])
    Traceback (most recent call last):
        ...
    ipmclab.errors.InputError: copy.nc: the same record is given twice, as step.nc too; give each record once
    """
    seen: dict[str, str] = {}
    for run, label in zip(runs, labels, strict=True):
        content = run.content_sha256
        if content in seen:
            raise InputError(
                f"the same record is given twice, as {seen[content]} too",
                code="same-run-twice",
                where=label,
                repair="give each record once",
            )
        seen[content] = label


def _other(given: Any, wanted: str, reader: str, otherwise: str, where: str) -> InputError:
    kind = type(given).__name__
    if isinstance(given, (str, PathLike)):
        path = str(fspath(given))
        message, repair = f"{path!r} is a {kind}, not {wanted}", f"give {reader}({path!r})"
    else:
        article = "an" if kind[0] in "aeiouAEIOU" else "a"
        message, repair = f"this is {article} {kind}, not {wanted}", f"give {otherwise}"
    return InputError(message, code=f"not-{wanted.replace(' ', '-')}", where=where, repair=repair)
