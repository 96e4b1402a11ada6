"""Calls that make, start and end tasks."""

from __future__ import annotations

from typing import Any

from virtual_cdaq.model import transfer
from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.protocol import Session, message
from virtual_cdaq.service import Service, call


@call("CreateTask")
def _create_task(service: Service, request: Any) -> Any:
    session, made = service.sessions.create(request.session_name, request.initialization_behavior)
    return message("CreateTaskResponse")(task=Session(name=session), new_session_initialized=made)


@call("ClearTask")
def _clear_task(service: Service, request: Any) -> Any:
    task = service.task(request)
    service.sessions.remove(request.task.name)
    service.chassis.clear(task)
    return message("ClearTaskResponse")()


@call("StartTask")
def _start_task(service: Service, request: Any) -> Any:
    service.task(request).start()
    return message("StartTaskResponse")()


@call("StopTask")
def _stop_task(service: Service, request: Any) -> Any:
    return message("StopTaskResponse")(status=service.task(request).stop())


@call("TaskControl")
def _task_control(service: Service, request: Any) -> Any:
    transfer.control(service.task(request), request.action_raw or request.action)
    return message("TaskControlResponse")()


@call("IsTaskDone")
def _is_task_done(service: Service, request: Any) -> Any:
    return message("IsTaskDoneResponse")(is_task_done=transfer.is_done(service.task(request)))


@call("WaitUntilTaskDone")
def _wait_until_task_done(service: Service, request: Any) -> Any:
    transfer.wait_until_done(service.task(request), request.time_to_wait)
    return message("WaitUntilTaskDoneResponse")()


@call("GetNthTaskDevice")
def _nth_device(service: Service, request: Any) -> Any:
    return message("GetNthTaskDeviceResponse")(buffer=_nth(service.task(request).all_devices, request.index))


@call("GetNthTaskChannel")
def _nth_channel(service: Service, request: Any) -> Any:
    names = [channel.name for channel in service.task(request).channels]
    return message("GetNthTaskChannelResponse")(buffer=_nth(names, request.index))


def _nth(names: list[str], index: int) -> str:
    if not 1 <= index <= len(names):
        raise ChassisError(-200077, f"Requested index: {index}\nAllowed: 1 to {len(names)}")
    return names[index - 1]
