"""Workers of a Dask cluster that somebody runs (extra ``cluster``); we start none, so that nothing of ours listens.

Dask gives the task of a worker that dies to another one. What tasks share is the result of a task itself: a worker
takes it from another worker, and where all that had it died it is made again.
"""

from __future__ import annotations

import itertools
import logging
import pickle
import queue
import re
import time
import uuid
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from typing import Any, Final

from ipmclab.engine.engine import Result, Shared, Task
from ipmclab.engine.task import Outcome, differences, packed, perform, software
from ipmclab.errors import InputError
from ipmclab.extras import package

PATIENCE: Final = 60.0
"""Seconds without any worker after which the work is given up."""

ANSWER: Final = 30.0
"""Seconds in which a scheduler has to answer."""

_ADDRESS: Final = re.compile(r"(tcp|tls|ws|wss)://[^/\s]+:\d+")

_EACH: Final = 2
"""Tasks on the way to each worker: one that it does, and the next."""

_LOOK: Final = 1.0  # s between two looks at which workers there are
_SAME: Final = ("python", "dask", "distributed", "cloudpickle")  # what has to be the same before any task travels


class Cluster:
    """The workers of a Dask scheduler.

    Parameters
    ----------
    client : distributed.Client
    patience : float [s]
        How long to wait where there is no worker.
    """

    def __init__(self, client: Any, patience: float) -> None:
        self._client = client
        self._patience = patience
        self._shared: tuple[Any, Any] = (None, None)
        self._seen = (0.0, 0)

    @property
    def workers(self) -> int:
        """How many workers there are, or were a moment ago."""
        now = time.monotonic()
        if now - self._seen[0] > _LOOK:
            self._seen = now, len(self._client.nthreads())
        return self._seen[1]

    def map(
        self, function: Callable[[Shared, Task], Result], shared: Shared, tasks: Iterable[Task]
    ) -> Iterator[tuple[int, Result]]:
        """The place and the result of each task, in the order in which they are done."""
        given, name = self._given(shared), f"ipmclab-{uuid.uuid4().hex}"
        done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        under_way: dict[str, tuple[int, Any]] = {}
        left = enumerate(tasks)
        try:
            while True:
                with self._told():
                    wanted = max(_EACH * self.workers, 1) - len(under_way)
                for place, task in itertools.islice(left, max(wanted, 0)):
                    future = self._submit(f"{name}-{place}", _at_worker, given, packed(function, task), software())
                    under_way[future.key] = place, future
                    future.add_done_callback(done.put)
                if not under_way:
                    return
                with self._told():
                    place, future = under_way.pop(self._next(done).key)
                    outcome = future.result()
                yield place, _value(outcome)
        finally:
            if under_way:
                with suppress(*_lost()):
                    self._client.cancel([future for _, future in under_way.values()])

    def _given(self, shared: Any) -> Any:
        """What tasks share, as a future; the last one is kept."""
        if shared is not self._shared[0]:
            blob = pickle.dumps(shared, protocol=pickle.HIGHEST_PROTOCOL)
            self._shared = shared, self._submit(f"ipmclab-shared-{uuid.uuid4().hex}", pickle.loads, blob)
        return self._shared[1]

    def _submit(self, key: str, function: Callable[..., Any], *arguments: Any) -> Any:
        with self._told(), warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Sending large graph", category=UserWarning)
            return self._client.submit(function, *arguments, key=key, pure=False)

    def _told(self) -> AbstractContextManager[None]:
        return _told(self._client.scheduler.address)

    def _next(self, done: queue.SimpleQueue[Any]) -> Any:
        """The next future that is done, while there are workers to do it."""
        since = time.monotonic()
        while True:
            try:
                return done.get(timeout=_LOOK)
            except queue.Empty:
                now = time.monotonic()
                since = now if self.workers else since
                if now - since > self._patience:
                    raise InputError(
                        f"there was no worker for {self._patience:.0f} s",
                        code="no-workers",
                        where=f"--scheduler {self._client.scheduler.address}",
                        repair=f"start workers (dask worker {self._client.scheduler.address} --nthreads 1), and give "
                        "the same command again",
                    ) from None


@contextmanager
def cluster(address: str, *, patience: float = PATIENCE) -> Iterator[Cluster]:
    """The workers of a scheduler, until the work is done.

    Parameters
    ----------
    address : str
        Such as ``tcp://127.0.0.1:8786``.
    patience : float [s]
        How long to wait where there is no worker.

    Raises
    ------
    InputError
        Dask is not installed, no scheduler answers, or its software is another one.
    """
    distributed = _distributed()
    if not _ADDRESS.fullmatch(address):
        raise _no_scheduler("this is no address", address)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="(?s).*Mismatched versions", category=Warning)  # reported below
        try:
            client = distributed.Client(address, timeout=ANSWER, set_as_default=False)
        except (OSError, ValueError, TypeError, ImportError) as error:
            raise _no_scheduler(str(error).partition("\n")[0] or type(error).__name__, address) from error
    with _quiet(), client:
        with _told(address):
            _same_software(client, address)
        yield Cluster(client, patience)


@contextmanager
def _quiet() -> Iterator[None]:
    """Without Dask's own words and tracebacks: what matters of them is said by our errors."""
    loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client")]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


def _no_scheduler(why: str, address: str) -> InputError:
    return InputError(
        f"no Dask scheduler answers: {why}",
        code="no-scheduler",
        where=f"--scheduler {address}",
        repair="give an address such as tcp://127.0.0.1:8786, or start one: dask scheduler --host 127.0.0.1",
    )


def _same_software(client: Any, address: str) -> None:
    """Refuse a scheduler or workers that cannot read what we send."""
    asked = ("ipmclab", *_SAME)
    found = client.get_versions(packages=["ipmclab"])
    mine = {name: str(found["client"]["packages"][name]) for name in asked}
    for place, versions in {"the scheduler": found["scheduler"], **found["workers"]}.items():
        theirs = {name: str(versions["packages"].get(name) or "not installed") for name in asked}
        if words := differences(mine, theirs):
            raise _other_software(words, f"{address}, {place}")


def _other_software(words: str, where: str) -> InputError:
    return InputError(
        f"this cluster has other software: {words}",
        code="other-software",
        where=f"--scheduler {where}",
        repair="install the same version of ipmclab, with the same packages, for the scheduler and every worker",
    )


@contextmanager
def _told(address: str) -> Iterator[None]:
    """What happens to the cluster itself, as an error that says what to do."""
    distributed = _distributed()
    where = f"--scheduler {address}"
    try:
        yield
    except distributed.KilledWorker as error:
        raise InputError(
            f"several workers died over the same task, the last of them {error.last_worker.address}",
            code="workers-died",
            where=where,
            repair="see that the memory of the workers is enough for their threads, and what their logs say",
        ) from error
    except (ImportError, RuntimeError) as error:  # what was sent could not be read there
        cause = error.__cause__ or error
        raise _other_software(f"{type(cause).__name__} there: {cause}", address) from error
    except _lost() as error:
        raise InputError(
            "the scheduler does not answer any more",
            code="scheduler-lost",
            where=where,
            repair="start it and its workers again, and give the same command again",
        ) from error


def _lost() -> tuple[type[BaseException], ...]:
    distributed = _distributed()
    return distributed.client.CancelledError, distributed.comm.CommClosedError, OSError, TimeoutError


def _at_worker(shared: Any, work: bytes, asked_by: dict[str, str]) -> Outcome:
    """A task, where the software is that of the program that asked."""
    words = differences(asked_by, software())
    if words:
        distributed = _distributed()
        return Outcome(differs=f"worker {distributed.get_worker().address}: {words}")
    return perform(shared, work)


def _value(outcome: Outcome) -> Any:
    if outcome.differs:
        worker, _, words = outcome.differs.partition(": ")
        raise _other_software(words, worker)
    if outcome.error is not None:
        raise outcome.error
    return outcome.value


def _distributed() -> Any:
    return package("distributed", extra="cluster", where="--scheduler", known_as="Dask")
