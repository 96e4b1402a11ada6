"""Those who want to be informed when something happens to a task."""

from __future__ import annotations

from collections.abc import Sequence

from virtual_cdaq.model.task import Task


def tell(tasks: Sequence[Task]) -> None:
    """Call those who listen to tasks."""
    for task in tasks:
        if not task.listeners or not task.running:
            continue
        for listener in list(task.listeners):
            if listener.kind == "done":
                finished = task.failure is not None or (task.hardware_timed and task.ended)
                if finished and not listener.reported:
                    listener.reported = 1
                    listener.call(task.failure.code if task.failure else 0)
                continue
            if listener.kind == "transferred":
                count = task.output_buffer.generated if task.output_buffer is not None else 0
            else:
                count = task.input_buffer.acquired if task.input_buffer is not None else 0
            while (listener.reported + 1) * listener.every <= count:
                listener.reported += 1
                listener.call(0)


def next_event(tasks: Sequence[Task]) -> int | None:
    """When somebody who listens has to be called next [ticks]; None if not known or if the program must read first."""
    found = None
    for task in tasks:
        if not task.running or task.done:
            continue
        for listener in task.listeners:
            tick: int | None = None
            if listener.kind == "done":
                tick = task.done_tick() if not listener.reported else None
            else:
                last = (listener.reported + 1) * listener.every
                buffer = task.input_buffer
                room = (
                    listener.kind == "transferred"
                    or task.finite
                    or buffer is None
                    or last - buffer.position <= buffer.size
                )
                tick = task.edge_tick(last - 1) if room else None
            if tick is not None:
                found = tick if found is None else min(found, tick)
    return found
