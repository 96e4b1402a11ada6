"""An engine that does to tasks what a cluster may do to them, in this process."""

from __future__ import annotations

import pickle
import random
from collections.abc import Callable, Iterable, Iterator
from typing import Any


class Awkward:
    """Everything goes through bytes, is done in any order, and comes back in any other."""

    workers = 3

    def map(self, function: Callable[..., Any], shared: Any, tasks: Iterable[Any]) -> Iterator[tuple[int, Any]]:
        """The place and the result of each task, in an order of their own."""
        shuffle = random.Random(20261123)
        sent = pickle.dumps((function, shared))
        waiting: list[tuple[int, bytes]] = []
        for place, task in enumerate(tasks):
            waiting.append((place, pickle.dumps(task)))
            if len(waiting) == 2 * self.workers:
                yield self._done(sent, waiting.pop(shuffle.randrange(len(waiting))))
        shuffle.shuffle(waiting)
        for one in waiting:
            yield self._done(sent, one)

    def _done(self, sent: bytes, one: tuple[int, bytes]) -> tuple[int, Any]:
        function, shared = pickle.loads(sent)
        place, task = one
        return place, pickle.loads(pickle.dumps(function(shared, pickle.loads(task))))
