"""A record that is given twice, refused."""

from __future__ import annotations

from collections.abc import Sequence

from ipmclab.errors import InputError
from ipmclab.run import Run


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
