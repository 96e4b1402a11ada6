"""Event streams: what a client registers for."""

from __future__ import annotations

import queue
from collections.abc import Callable, Iterator
from typing import Any

from virtual_cdaq.model.chassis import HostedTask
from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.model.task import Listener
from virtual_cdaq.protocol import message
from virtual_cdaq.service import Service, call

SAMPLE_CLOCK, SAMPLE_COMPLETE = 12487, 12530  # DAQmx_Val_SampleClock, _SampleCompleteEvent
ACQUIRED, TRANSFERRED = 1, 2  # DAQmx_Val_Acquired_Into_Buffer, _Transferred_From_Buffer


class Stream:
    """The messages of one registration, until it is taken back or its client goes.

    Parameters
    ----------
    service : Service
    task : HostedTask
    listener : Listener
    make : callable
        Takes a status, gives the message.
    """

    def __init__(self, service: Service, task: HostedTask, listener: Listener, make: Callable[[int], Any]) -> None:
        self._service = service
        self._task = task
        self._listener = listener
        self._make = make
        self._waiting: queue.SimpleQueue[int | None] = queue.SimpleQueue()
        listener.call = self._waiting.put
        listener.close = lambda: self._waiting.put(None)
        task.listeners.append(listener)

    def __iter__(self) -> Iterator[Any]:
        while (status := self._waiting.get()) is not None:
            yield self._make(status)

    def close(self) -> None:
        """End; whoever registered is gone."""
        with self._service.chassis.lock:
            if self._listener in self._task.listeners:
                self._task.listeners.remove(self._listener)
        self._waiting.put(None)


def _register(task: HostedTask, kind: Any, every: int, taken: int) -> Listener:
    if any(listener.kind == kind for listener in task.listeners):
        raise ChassisError(taken, f"Task: {task.name}")
    if task.running:
        raise ChassisError(-200960, f"Task: {task.name}")
    return Listener(kind, every, lambda _: None)


def _unregister(task: HostedTask, kind: str) -> None:
    for listener in [each for each in task.listeners if each.kind == kind]:
        task.listeners.remove(listener)
        listener.close()


def _every_n(service: Service, request: Any) -> Stream:
    task = service.task(request)
    kind = request.every_n_samples_event_type_raw or request.every_n_samples_event_type
    count = request.n_samples
    if kind == ACQUIRED:
        if task.kind == "ao":
            raise ChassisError(-200981, f"Task: {task.name}")
        listener = _register(task, "acquired", count, -200966)
    else:
        if task.kind == "ai":
            raise ChassisError(-200980, f"Task: {task.name}")
        listener = _register(task, "transferred", count, -200967)

    def make(status: int) -> Any:
        return message("RegisterEveryNSamplesEventResponse")(
            status=status, every_n_samples_event_type_raw=kind, every_n_samples_event_type=kind, n_samples=count
        )

    return Stream(service, task, listener, make)


def _done(service: Service, request: Any) -> Stream:
    task = service.task(request)
    listener = _register(task, "done", 1, -200950)
    return Stream(service, task, listener, lambda status: message("RegisterDoneEventResponse")(status=status))


def _signal(service: Service, request: Any) -> Stream:
    """Of the signals only the sample clock and the end of a sample are there: an input task's own samples."""
    task = service.task(request)
    signal = request.signal_id_raw or request.signal_id
    if signal not in (SAMPLE_CLOCK, SAMPLE_COMPLETE) or task.kind == "ao":
        raise ChassisError(-200452, f"Signal: {signal}\nTask: {task.name}")
    listener = _register(task, "signal", 1, -200949)
    return Stream(
        service,
        task,
        listener,
        lambda status: message("RegisterSignalEventResponse")(status=status, signal_id=signal),
    )


STREAMS: dict[str, Callable[[Service, Any], Stream]] = {
    "RegisterDoneEvent": _done,
    "RegisterEveryNSamplesEvent": _every_n,
    "RegisterSignalEvent": _signal,
}


@call("UnregisterEveryNSamplesEvent")
def _unregister_every_n(service: Service, request: Any) -> Any:
    kind = request.every_n_samples_event_type_raw or request.every_n_samples_event_type
    _unregister(service.task(request), "acquired" if kind == ACQUIRED else "transferred")
    return message("UnregisterEveryNSamplesEventResponse")()


@call("UnregisterDoneEvent")
def _unregister_done(service: Service, request: Any) -> Any:
    _unregister(service.task(request), "done")
    return message("UnregisterDoneEventResponse")()


@call("UnregisterSignalEvent")
def _unregister_signal(service: Service, request: Any) -> Any:
    _unregister(service.task(request), "signal")
    return message("UnregisterSignalEventResponse")()
