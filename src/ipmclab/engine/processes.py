"""Processes of this machine: each has a pipe to us and does one task at a time.

Nothing listens on a port. A process that dies is replaced, and its task is done again: Python's own pools, and those
built on them, give all their tasks up when one process dies.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any, Final

from ipmclab.engine.engine import Result, Shared, Task
from ipmclab.engine.task import Outcome, packed, perform
from ipmclab.errors import InputError
from ipmclab.platform import PROCESSORS, processors

_TRIES: Final = 4
"""How often a task is begun: one on which every worker dies is no accident."""

_Work = tuple[int, bytes]


@dataclass(eq=False)
class _Worker:
    process: SpawnProcess
    pipe: Connection
    shared: int = 0
    work: _Work | None = None


class Processes:
    """Workers on this machine.

    Parameters
    ----------
    workers : int
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._all: list[_Worker] = []
        self._shared: tuple[int, Any, bytes] = (0, None, b"")
        self._last_status: int | None = None

    def map(
        self, function: Callable[[Shared, Task], Result], shared: Shared, tasks: Iterable[Task]
    ) -> Iterator[tuple[int, Result]]:
        """The place and the result of each task, in the order in which they are done."""
        if shared is not self._shared[1]:
            self._shared = (self._shared[0] + 1, shared, pickle.dumps(shared, protocol=pickle.HIGHEST_PROTOCOL))
        left = ((place, packed(function, task)) for place, task in enumerate(tasks))
        again: deque[_Work] = deque()
        begun: dict[int, int] = {}
        self._all += [self._started() for _ in range(self.workers - len(self._all))]
        try:
            while True:
                self._hand_out(left, again, begun)
                busy = {worker.pipe: worker for worker in self._all if worker.work is not None}
                if not busy:
                    return
                for ready in wait(list(busy)):
                    worker = busy[ready]  # type: ignore[index]  # wait returns what it was given
                    assert worker.work is not None
                    try:
                        outcome: Outcome = worker.pipe.recv()
                    except (EOFError, OSError):
                        again.append(worker.work)
                        self._replace(worker)
                        continue
                    (place, _), worker.work = worker.work, None
                    if outcome.error is not None:
                        raise outcome.error
                    yield place, outcome.value
        finally:
            self._stop([worker for worker in self._all if worker.work is not None])

    def close(self) -> None:
        """End all workers."""
        self._stop(list(self._all))

    def _hand_out(self, left: Iterator[_Work], again: deque[_Work], begun: dict[int, int]) -> None:
        """Give each worker that has nothing to do the next task."""
        token, _, blob = self._shared
        for worker in list(self._all):
            while worker.work is None:
                work = again.popleft() if again else next(left, None)
                if work is None:
                    return
                begun[work[0]] = begun.get(work[0], 0) + 1
                if begun[work[0]] > _TRIES:
                    raise _died(self._last_status)
                worker.work = work
                try:
                    worker.pipe.send((token, None if worker.shared == token else blob, work[1]))
                    worker.shared = token
                except OSError:  # it died before it had anything to do
                    again.append(work)
                    worker = self._replace(worker)

    def _started(self) -> _Worker:
        context = multiprocessing.get_context("spawn")  # a copy of a process with threads may never wake up
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs, share(self.workers)), daemon=True)
        process.start()
        theirs.close()  # so that its end ends the pipe
        return _Worker(process, ours)

    def _replace(self, worker: _Worker) -> _Worker:
        worker.pipe.close()
        worker.process.join()
        self._last_status = worker.process.exitcode
        self._all[self._all.index(worker)] = new = self._started()
        return new

    def _stop(self, workers: list[_Worker]) -> None:
        for worker in workers:
            worker.process.terminate()
        for worker in workers:
            worker.process.join()
            worker.pipe.close()
            self._all.remove(worker)


def share(workers: int) -> int:
    """How many processors each of so many workers may use; more workers than processors have one each."""
    return max(1, processors() // workers)


@contextmanager
def processes(workers: int) -> Iterator[Processes]:
    """Workers on this machine, until the work is done.

    Raises
    ------
    InputError
        Fewer than one, or more than 1,000.
    """
    if not 1 <= workers <= 1000:
        raise InputError(
            f"{workers} workers on this machine",
            code="out-of-range",
            where="--workers",
            repair=f"give 1 to 1000; this machine has {processors()} processors",
        )
    engine = Processes(workers)
    try:
        yield engine
    finally:
        engine.close()


def _serve(pipe: Connection, share: int) -> None:
    """What a worker process does until its pipe ends: also when the program that started it was killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program, which ends us
    os.environ[PROCESSORS] = str(share)
    shared: Any = None
    with suppress(EOFError, OSError):
        while True:
            _, blob, work = pipe.recv()
            if blob is not None:
                shared = pickle.loads(blob)
            outcome = perform(shared, work)
            try:
                pipe.send(outcome)
            except (pickle.PicklingError, TypeError, AttributeError) as error:  # an error that cannot travel
                pipe.send(Outcome(error=RuntimeError(f"{outcome.error or 'the result'!r} cannot travel: {error}")))


def _died(status: int | None) -> InputError:
    return InputError(
        f"{_TRIES} workers died over the same task, the last with exit status {status}",
        code="workers-died",
        where="--workers",
        repair="see that the memory holds so many workers, or give fewer; in a script of your own, call it below "
        'if __name__ == "__main__"',
    )
