"""The engine that somebody asks for by name."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ipmclab.engine.engine import Engine, Here
from ipmclab.errors import InputError
from ipmclab.kinds import tell_kinds


@tell_kinds
@contextmanager
def opened(*, scheduler: str | None = None, workers: int | None = None) -> Iterator[Engine]:
    """The engine that was asked for, until the work is done; this process where nothing was.

    Parameters
    ----------
    scheduler : str, optional
        Address of a Dask scheduler, such as ``tcp://127.0.0.1:8786``. It needs the extra ``cluster``.
    workers : int, optional
        Processes on this machine.

    Raises
    ------
    InputError
        Both were asked for; fewer than one worker; no scheduler answers, or another version of ipmclab.

    Examples
    --------
    >>> with opened() as engine:
    ...     list(engine.map(pow, 2, [3, 4]))
    [(0, 8), (1, 16)]
    """
    if scheduler is not None and workers is not None:
        raise InputError(
            "a cluster has the workers that it has",
            code="usage",
            where="--workers",
            repair="give --scheduler or --workers, not both",
        )
    if scheduler is not None:
        from ipmclab.engine.cluster import cluster

        with cluster(scheduler) as found:
            yield found
    elif workers is not None:
        from ipmclab.engine.processes import processes

        with processes(workers) as started:
            yield started
    else:
        yield Here()
