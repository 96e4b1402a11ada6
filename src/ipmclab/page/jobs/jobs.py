"""Jobs: what the page asks its workers to do, and what became of it."""

from __future__ import annotations

import contextlib
import itertools
import os
import subprocess
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from typing import IO, Any, Final, Literal

from ipmclab.errors import InputError, IpmclabError
from ipmclab.page.jobs.frames import Frame, pack, read_frame
from ipmclab.page.jobs.tasks import LOOK, SIMULATE, TASKS, WORK
from ipmclab.platform import detached, python_child

State = Literal["waiting", "running", "done", "failed", "cancelled"]

_GRACE: Final = 1.0
"""How long [s] a cancelled job may take to come to its next word of progress before its worker is ended."""


class JobCancelled(Exception):
    """What waiting for a job raises that was cancelled, or that a newer one took the place of."""


class Job:
    """One piece of work. Read it at any time; ``future`` shows when it is over.

    Attributes
    ----------
    task, title : str
    state : "waiting", "running", "done", "failed" or "cancelled"
    sentence : str
        What it is doing.
    fraction : float or None
        The part that is done, where it is known.
    first : list of dict or None
        The rows of its first answer, as soon as that is there.
    is_kept : bool
        Whether it was asked to end soon with what it has.
    future : Future of Frame
        Raises the ``IpmclabError`` of a job that failed, and ``JobCancelled``.
    """

    def __init__(self, number: int, task: str, arguments: Mapping[str, Any], title: str, replaces: str | None) -> None:
        self.number = number
        self.task = task
        self.arguments = dict(arguments)
        self.title = title
        self.replaces = replaces
        self.state: State = "waiting"
        self.sentence = ""
        self.fraction: float | None = None
        self.first: list[dict[str, Any]] | None = None
        self.is_kept = False
        self.future: Future[Frame] = Future()
        self.future.set_running_or_notify_cancel()  # who waits for it may go away; that does not cancel the job
        self.started: float | None = None
        self.ended: float | None = None
        self.is_cancelled = threading.Event()
        self.is_late = False

    @property
    def is_over(self) -> bool:
        """Whether nothing more will come of it."""
        return self.future.done()

    @property
    def seconds(self) -> float:
        """How long it has been worked on."""
        if self.started is None:
            return 0.0
        return (self.ended or time.monotonic()) - self.started

    @property
    def error(self) -> IpmclabError | None:
        """Why it failed."""
        failed = self.future.exception() if self.state == "failed" else None
        return failed if isinstance(failed, IpmclabError) else None

    def _end(self, state: State, result: Frame | None = None, error: Exception | None = None) -> None:
        self.state, self.ended = state, time.monotonic()
        if error is not None:
            self.future.set_exception(error)
        elif result is not None:
            self.future.set_result(result)


class Jobs:
    """Three lanes with a worker each, started when it is first needed.

    A lane does its jobs in their order. Workers are processes of their own: the server imports no compiler, and a fault
    or an endless computation ends one worker, never the server.

    Examples
    --------
    >>> with Jobs() as jobs:
    ...     job = jobs.submit("simulate", {"actuator": "friend-2", "signal": "step 1 V"})
    ...     job.future.result(timeout=60).document["rows"]
    2000
    """

    def __init__(self) -> None:
        self._numbers = itertools.count(1)
        self._lanes = {name: _Lane(name) for name in (SIMULATE, LOOK, WORK)}

    def __enter__(self) -> Jobs:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def submit(self, task: str, arguments: Mapping[str, Any], *, title: str = "", replaces: str | None = None) -> Job:
        """Let a worker do a task.

        Parameters
        ----------
        task : str
            One of ``TASKS``.
        arguments : mapping
            JSON values.
        title : str
            What people call it.
        replaces : str, optional
            A job under the same name that still waits is dropped: only the newest position of a slider counts.
        """
        job = Job(next(self._numbers), task, arguments, title, replaces)
        self._lanes[TASKS[task].lane].put(job)
        return job

    def cancel(self, job: Job) -> None:
        """Let a job go: at its next word of progress, or with its worker a second later."""
        self._lanes[TASKS[job.task].lane].cancel(job)

    def keep(self, job: Job) -> None:
        """Let a job that has a first answer end with what stands, at its next word of progress."""
        self._lanes[TASKS[job.task].lane].keep(job)

    def close(self) -> None:
        """End all workers."""
        for lane in self._lanes.values():
            lane.close()


class _Lane:
    """A queue of jobs and the worker that does them; a thread of the server waits for its answers."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._waiting: deque[Job] = deque()
        self._changed = threading.Condition()
        self._child: subprocess.Popen[bytes] | None = None
        self._stderr: IO[bytes] | None = None
        self._thread: threading.Thread | None = None
        self._is_closed = False

    def put(self, job: Job) -> None:
        with self._changed:
            if self._is_closed:
                raise RuntimeError("the workers were ended")
            if job.replaces is not None:
                for other in [one for one in self._waiting if one.replaces == job.replaces]:
                    self._waiting.remove(other)
                    other._end("cancelled", error=JobCancelled())
            self._waiting.append(job)
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name=f"jobs-{self.name}", daemon=True)
                self._thread.start()
            self._changed.notify()

    def cancel(self, job: Job) -> None:
        with self._changed:
            if job.is_over or job.is_cancelled.is_set():
                return
            job.is_cancelled.set()
            if job in self._waiting:
                self._waiting.remove(job)
                job._end("cancelled", error=JobCancelled())
                return
            child = self._child
        if child is not None:
            self._take_back(job, child)

    @staticmethod
    def _take_back(job: Job, child: subprocess.Popen[bytes]) -> None:
        """Signal a worker that a job is not wanted, and end it where it does not heed that."""
        _send(child, {"cancel": job.number})

        def end() -> None:
            if not job.is_over:
                child.kill()

        timer = threading.Timer(_GRACE, end)
        timer.daemon = True
        timer.start()

    def keep(self, job: Job) -> None:
        with self._changed:
            if job.is_over or job.is_kept or job.first is None or self._child is None:
                return
            job.is_kept = True
            _send(self._child, {"keep": job.number})

    def close(self) -> None:
        with self._changed:
            self._is_closed = True
            for job in self._waiting:
                job._end("cancelled", error=JobCancelled())
            self._waiting.clear()
            child, thread = self._child, self._thread
            self._changed.notify()
        if child is not None:
            child.kill()
        if thread is not None and thread is not threading.current_thread():
            thread.join(timeout=5.0)

    def _work(self) -> None:
        while True:
            with self._changed:
                while not self._waiting and not self._is_closed:
                    self._changed.wait()
                if self._is_closed:
                    break
                job = self._waiting.popleft()
                job.state, job.started = "running", time.monotonic()
                job.sentence = "starting a worker" if self._child is None else ""
            try:
                self._do(job)
            except Exception as error:  # a job that fails in a way nobody foresaw must not stop the lane
                from ipmclab.page.jobs.worker import fault

                self._end_child()
                job._end("failed", error=_as_error(fault(error)))
        self._end_child()

    def _do(self, job: Job) -> None:
        child = self._ready()
        if job.is_cancelled.is_set():  # while it was started
            job._end("cancelled", error=JobCancelled())
            return
        assert child.stdout is not None
        _send(child, {"id": job.number, "task": job.task, "arguments": job.arguments})
        if job.is_cancelled.is_set():  # between the two: the worker before this one may have got it
            self._take_back(job, child)
        with self._limited(job, child):
            if self._answered(job, child.stdout):
                return
        last_words = self._end_child()
        if job.is_cancelled.is_set() or self._is_closed:
            job._end("cancelled", error=JobCancelled())
            return
        if job.is_late:
            job._end("failed", error=_too_long(job))
            return
        job._end(
            "failed",
            error=IpmclabError(
                f"its worker ended with status {child.returncode}{f': {last_words}' if last_words else ''}",
                code="worker-died",
                where=job.title or job.task,
                repair="try again with fewer or shorter runs; recordings are not touched by this",
            ),
        )

    @staticmethod
    def _answered(job: Job, stream: IO[bytes]) -> bool:
        """Take what a worker reports of a job; False where the worker ended before the job did."""
        while (frame := read_frame(stream)) is not None:
            document = frame.document
            if document["id"] != job.number:
                continue
            if "progress" in document:
                job.sentence, job.fraction = document["progress"], document["fraction"]
                job.first = document.get("first", job.first)
                continue
            if "done" in document:
                job._end("done", Frame(document["done"], frame.arrays))
            elif "cancelled" in document:
                job._end("cancelled", error=JobCancelled())
            else:
                job._end("failed", error=_as_error(document["error"]))
            return True
        return False

    @staticmethod
    @contextlib.contextmanager
    def _limited(job: Job, child: subprocess.Popen[bytes]) -> Iterator[None]:
        """End the worker of a job that takes longer than it may."""

        def end() -> None:
            job.is_late = True
            child.kill()

        limit = TASKS[job.task].limit
        if limit is None:
            yield
            return
        timer = threading.Timer(limit, end)
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()
            timer.join()  # it must not end what the worker does next

    def _ready(self) -> subprocess.Popen[bytes]:
        """The worker, started where there is none."""
        if self._child is not None and self._child.poll() is None:
            return self._child
        self._end_child()
        command = python_child("ipmclab.page.jobs.worker")
        if self.name == WORK:
            command.append("--aside")
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115  # it lives as long as the worker
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONUTF8": "1"}
        started = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._stderr,
            env=environment,
            **detached(),
        )
        with self._changed:
            self._child = started
            if self._is_closed:
                started.kill()
        return started

    def _end_child(self) -> str:
        """Take the worker away, if there is one; the last line that it wrote to stderr."""
        with self._changed:
            child, self._child = self._child, None
        last = ""
        if child is not None:
            child.kill()
            child.wait()
            for stream in (child.stdin, child.stdout):
                assert stream is not None
                with contextlib.suppress(OSError):
                    stream.close()
        if self._stderr is not None:
            self._stderr.seek(0)
            lines = self._stderr.read().decode(errors="replace").strip().splitlines()
            last = lines[-1] if lines else ""
            self._stderr.close()
            self._stderr = None
        return last


def _send(child: subprocess.Popen[bytes], request: Mapping[str, Any]) -> None:
    """Send a worker a request; one that died shows where it is read."""
    with contextlib.suppress(OSError, ValueError):
        assert child.stdin is not None
        child.stdin.write(pack(request))
        child.stdin.flush()


def _too_long(job: Job) -> IpmclabError:
    return IpmclabError(
        f"it took longer than {TASKS[job.task].limit:g} s, so it was ended",
        code="too-long",
        where=job.title or job.task,
        repair="try a shorter record or fewer runs; at the terminal ipmclab has no such limit",
    )


def _as_error(document: Mapping[str, Any]) -> IpmclabError:
    kind = InputError if document["exit_status"] == 2 else IpmclabError
    return kind(document["message"], code=document["code"], where=document["where"], repair=document["repair"])
