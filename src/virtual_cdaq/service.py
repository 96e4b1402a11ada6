"""What the calls of NI's service work on, and the one function for all properties."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from virtual_cdaq import attributes
from virtual_cdaq.attributes.device import PhysicalChannel, find_device, find_physical
from virtual_cdaq.model.chassis import Chassis, HostedTask
from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.model.names import expand
from virtual_cdaq.model.scales import find_scale
from virtual_cdaq.protocol import AttributeCall
from virtual_cdaq.sessions import Sessions

BY_CHANNEL = 0  # DAQmx_Val_GroupByChannel

Call = Callable[["Service", Any], Any]
CALLS: dict[str, Call] = {}
# The stand-in saves no tasks, channels and scales; what the driver says of one that does not exist.
NOTHING_SAVED = {"PersistedTask": -200485, "PersistedChan": -200882, "PersistedScale": -200378}


def call(name: str) -> Callable[[Call], Call]:
    """Answer the call `name` of the service."""

    def keep(function: Call) -> Call:
        CALLS[name] = function
        return function

    return keep


class Service:
    """What the calls work on.

    Parameters
    ----------
    chassis : Chassis
    """

    def __init__(self, chassis: Chassis) -> None:
        self.chassis = chassis
        self.sessions = Sessions(chassis)

    def task(self, request: Any) -> HostedTask:
        """The task that a request is about."""
        return self.sessions.task(request.task.name)

    def attribute(self, wanted: AttributeCall, request: Any, response: Any) -> Any:
        """Get, set or reset a property: one function for all of them."""
        number = request.attribute_raw or request.attribute
        name = wanted.names.get(number, f"0x{number:X}")
        named = getattr(request, "device_names", "")
        if named and name not in attributes.OF_A_MODULE:
            raise ChassisError(-201118, f"Property: {name}\nDevices: {named}")
        table = attributes.TABLES.get(wanted.scope, {})
        things = self._things(wanted.scope, request)
        if wanted.verb == "Reset":
            for thing in things:
                attributes.reset(table, name, thing)
            return response()
        if wanted.verb == "Set":
            for thing in things:
                try:
                    attributes.put(table, name, thing, _value(request))
                except ChassisError as error:
                    raise _as_property(error) from None
            return response()
        if not things:
            raise ChassisError(-200478)
        return _fill(response, attributes.get(table, name, things[0]))

    def _things(self, scope: str, request: Any) -> list[Any]:
        """What a property belongs to."""
        if scope == "SystemInfo":
            return [self.chassis]
        if scope == "Device":
            return [find_device(self.chassis, request.device_name)]
        if scope == "PhysicalChan":
            return [_find_physical(self.chassis, (expand(request.physical_channel) or [""])[0])]
        if scope == "Scale":
            return [find_scale(self.chassis.scales, request.scale_name)]
        if scope in NOTHING_SAVED:
            raise ChassisError(NOTHING_SAVED[scope])
        if "task" not in request.DESCRIPTOR.fields_by_name:
            raise ChassisError(-200452)
        task = self.task(request)
        if scope != "Chan":
            return [task]
        names = expand(request.channel)
        channels = {channel.name: channel for channel in task.channels}
        for name in names:
            if name not in channels:
                raise ChassisError(-200486, f"Channel: {name}\nTask: {task.name}")
        return [channels[name] for name in names] if names else list(task.channels)


def _find_physical(chassis: Chassis, name: str) -> PhysicalChannel:
    """A physical channel whose properties are asked for: here an unknown device is an unknown channel."""
    try:
        return find_physical(chassis, name)
    except ChassisError as error:
        raise ChassisError(-200170, f"Physical channel: {name}") from error


def _as_property(error: ChassisError) -> ChassisError:
    """A change that is refused while the task runs has a code of its own for properties."""
    return ChassisError(-200557, error.text.partition("\n\n")[2]) if error.code == -200479 else error


def _value(request: Any) -> Any:
    """The value that a request sets: numbers of an enumeration come raw or by name."""
    fields = {field.name for field in request.DESCRIPTOR.fields}
    if "value_raw" in fields:
        raw = request.value_raw
        if hasattr(raw, "__len__"):
            return list(raw)
        return raw if request.WhichOneof("value_enum") == "value_raw" else request.value
    value = request.value
    return list(value) if hasattr(value, "extend") else value


def _fill(response: Any, value: Any) -> Any:
    fields = {field.name for field in response.DESCRIPTOR.fields}
    if "value_raw" not in fields:
        return response(value=value)
    answer = response(value_raw=value)
    # The named value is left out where the enumeration does not list the number.
    known = answer.DESCRIPTOR.fields_by_name["value"].enum_type
    if known is not None and not isinstance(value, list) and value in known.values_by_number:
        answer.value = value
    return answer
