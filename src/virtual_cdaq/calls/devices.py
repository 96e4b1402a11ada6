"""Calls on the chassis and its modules."""

from __future__ import annotations

from typing import Any

from virtual_cdaq.attributes.device import find_device
from virtual_cdaq.model.errors import OWN_TEXT, ChassisError
from virtual_cdaq.protocol import message
from virtual_cdaq.service import Service, call


@call("SelfTestDevice")
def _self_test(service: Service, request: Any) -> Any:
    find_device(service.chassis, request.device_name)
    if service.chassis.faults.unplugged:
        raise ChassisError(-201003, f"Device: {request.device_name}")
    return message("SelfTestDeviceResponse")()


@call("ResetDevice")
def _reset_device(service: Service, request: Any) -> Any:
    device = find_device(service.chassis, request.device_name)
    chassis = service.chassis
    if chassis.faults.unplugged:
        raise ChassisError(-201003, f"Device: {request.device_name}")
    chassis.reset(device.devices)
    return message("ResetDeviceResponse")()


@call("GetErrorString")
def _error_string(_: Service, request: Any) -> Any:
    return message("GetErrorStringResponse")(error_string=OWN_TEXT.get(request.error_code, ""))
