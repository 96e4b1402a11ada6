"""What is asked of an engine, and the plainest one.

Whatever does the tasks, a task is a function of a module, what all tasks share, and what this one has for itself. It
gives the same numbers wherever it is done, and results are put together by the places of their tasks, never by when
they came: so the answer does not depend on the engine.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from itertools import islice
from typing import Protocol, TypeVar

from ipmclab.engine.pace import Pace
from ipmclab.progress import tick

Shared = TypeVar("Shared")
Task = TypeVar("Task")
Result = TypeVar("Result")


class Engine(Protocol):
    """A map over tasks that know nothing of each other."""

    @property
    def workers(self) -> int:
        """How many tasks are done at the same time."""

    def map(
        self, function: Callable[[Shared, Task], Result], shared: Shared, tasks: Iterable[Task]
    ) -> Iterator[tuple[int, Result]]:
        """The place and the result of each task, in the order in which they are done.

        Tasks are drawn when there is a worker for them, a few ahead. What a function raises is raised here; whoever
        stops taking results ends the work.

        Parameters
        ----------
        function : callable
            Of a module, so that another process finds it.
        shared : object
            What all tasks need; it goes once to each worker.
        tasks : iterable
        """


class Here:
    """This process, one task after the other.

    Examples
    --------
    >>> list(Here().map(pow, 2, [3, 4]))
    [(0, 8), (1, 16)]
    """

    workers = 1

    def map(
        self, function: Callable[[Shared, Task], Result], shared: Shared, tasks: Iterable[Task]
    ) -> Iterator[tuple[int, Result]]:
        """The place and the result of each task, in their order."""
        for place, task in enumerate(tasks):
            yield place, function(shared, task)


def in_order(
    engine: Engine,
    function: Callable[[Shared, Task], Result],
    shared: Shared,
    tasks: Iterable[Task],
    count: int | None = None,
) -> list[Result]:
    """The results of all tasks in the order of the tasks, short tasks sent several at once.

    Parameters
    ----------
    engine : Engine
    function, shared, tasks
        As in ``Engine.map``.
    count : int, optional
        How many tasks there are, where ``tasks`` does not know.

    Examples
    --------
    >>> in_order(Here(), pow, 2, [3, 4])
    [8, 16]
    """
    if isinstance(engine, Here):
        return [result for _, result in engine.map(function, shared, tasks)]
    left = len(tasks) if isinstance(tasks, Sized) else count
    pace, drawn = Pace(), iter(tasks)

    def chunks() -> Iterator[tuple[Callable[[Shared, Task], Result], list[Task]]]:
        nonlocal left
        while chunk := list(islice(drawn, pace.size(left, engine.workers) if left is not None else 1)):
            left = None if left is None else left - len(chunk)
            yield function, chunk

    found: dict[int, list[Result]] = {}
    for place, (results, seconds) in engine.map(_each, shared, chunks()):
        pace.learn(len(results), seconds)
        found[place] = results
        for _ in results:
            tick()
    return [result for place in range(len(found)) for result in found[place]]


def _each(shared: Shared, chunk: tuple[Callable[[Shared, Task], Result], Sequence[Task]]) -> tuple[list[Result], float]:
    """The results of several tasks, and how long they took [s]."""
    function, tasks = chunk
    begun = time.perf_counter()
    return [function(shared, task) for task in tasks], time.perf_counter() - begun
