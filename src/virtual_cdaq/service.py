"""The calls of NI's service, each a few lines on the model."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from virtual_cdaq import attributes, creation
from virtual_cdaq.attributes.device import find_device, find_physical
from virtual_cdaq.attributes.task import set_input_size, set_output_size, set_trigger_type
from virtual_cdaq.model import transfer
from virtual_cdaq.model.chassis import Chassis
from virtual_cdaq.model.converters import Codes, Floats
from virtual_cdaq.model.errors import OWN_TEXT, ChassisError
from virtual_cdaq.model.names import expand
from virtual_cdaq.model.task import Task
from virtual_cdaq.protocol import AttributeCall, Session, message, packed_doubles
from virtual_cdaq.sessions import Sessions

BY_CHANNEL = 0  # DAQmx_Val_GroupByChannel

Call = Callable[["Service", Any], Any]
CALLS: dict[str, Call] = {}


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

    def task(self, request: Any) -> Task:
        """The task that a request is about."""
        return self.sessions.task(request.task.name)

    def attribute(self, wanted: AttributeCall, request: Any, response: Any) -> Any:
        """Get, set or reset a property: one function for all of them."""
        number = request.attribute_raw or request.attribute
        name = wanted.names.get(number, f"0x{number:X}")
        table = attributes.TABLES.get(wanted.scope, {})
        things = self._things(wanted.scope, request)
        if wanted.verb == "Reset":
            for thing in things:
                attributes.reset(table, name, thing)
            return response()
        if wanted.verb == "Set":
            for thing in things:
                attributes.put(table, name, thing, _value(request))
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
            return [find_physical(self.chassis, name) for name in expand(request.physical_channel)[:1] or [""]]
        if not hasattr(request, "task"):
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


# Tasks


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
    return message("GetNthTaskDeviceResponse")(buffer=_nth(service.task(request).devices, request.index))


@call("GetNthTaskChannel")
def _nth_channel(service: Service, request: Any) -> Any:
    names = [channel.name for channel in service.task(request).channels]
    return message("GetNthTaskChannelResponse")(buffer=_nth(names, request.index))


def _nth(names: list[str], index: int) -> str:
    if not 1 <= index <= len(names):
        raise ChassisError(-200077, f"Requested index: {index}\nAllowed: 1 to {len(names)}")
    return names[index - 1]


# Channels


@call("CreateAIVoltageChan")
def _create_voltage_input(service: Service, request: Any) -> Any:
    creation.voltage_input(service.task(request), request)
    return message("CreateAIVoltageChanResponse")()


@call("CreateAIRTDChan")
def _create_rtd(service: Service, request: Any) -> Any:
    creation.rtd(service.task(request), request)
    return message("CreateAIRTDChanResponse")()


@call("CreateAIResistanceChan")
def _create_resistance(service: Service, request: Any) -> Any:
    creation.resistance(service.task(request), request)
    return message("CreateAIResistanceChanResponse")()


@call("CreateAOVoltageChan")
def _create_voltage_output(service: Service, request: Any) -> Any:
    creation.voltage_output(service.task(request), request)
    return message("CreateAOVoltageChanResponse")()


# Timing, triggers, buffers


@call("CfgSampClkTiming")
def _sample_clock(service: Service, request: Any) -> Any:
    mode = request.sample_mode_raw or request.sample_mode
    service.task(request).set_sample_clock(request.rate, request.source, mode, request.samps_per_chan)
    return message("CfgSampClkTimingResponse")()


@call("CfgDigEdgeStartTrig")
def _start_trigger(service: Service, request: Any) -> Any:
    task = service.task(request)
    attributes.put(attributes.TABLES["Trig"], "DIG_EDGE_START_TRIG_SRC", task, request.trigger_source)
    edge = request.trigger_edge_raw or request.trigger_edge
    attributes.put(attributes.TABLES["Trig"], "DIG_EDGE_START_TRIG_EDGE", task, edge)
    return message("CfgDigEdgeStartTrigResponse")()


@call("DisableStartTrig")
def _no_start_trigger(service: Service, request: Any) -> Any:
    set_trigger_type(service.task(request), 10230)
    return message("DisableStartTrigResponse")()


@call("DisableRefTrig")
def _no_reference_trigger(service: Service, request: Any) -> Any:
    service.task(request)
    return message("DisableRefTrigResponse")()


@call("CfgInputBuffer")
def _input_buffer(service: Service, request: Any) -> Any:
    set_input_size(service.task(request), request.num_samps_per_chan)
    return message("CfgInputBufferResponse")()


@call("CfgOutputBuffer")
def _output_buffer(service: Service, request: Any) -> Any:
    set_output_size(service.task(request), request.num_samps_per_chan)
    return message("CfgOutputBufferResponse")()


# Reading


def _selected(task: Task, codes: Codes) -> tuple[list[int], Codes]:
    """The channels that the task's reads return."""
    wanted = expand(attributes.TABLES["Read"]["CHANNELS_TO_READ"].get(task))
    names = [channel.name for channel in task.channels]
    rows = [names.index(name) for name in wanted if name in names]
    return rows, codes if rows == list(range(len(names))) else codes[rows]


def read_scaled(task: Task, count: int, timeout: float) -> tuple[list[int], Floats, int]:
    """The next samples in the units of their channels.

    Returns
    -------
    rows : list of int
        The channels of the task that were read.
    values : array of float, shape (len(rows), n)
    status : int
        0 or -200284.
    """
    codes, status = transfer.read(task, count, timeout)
    rows, codes = _selected(task, codes)
    values = np.empty(codes.shape)
    for place, row in enumerate(rows):
        values[place] = task.channels[row].scale(codes[place])
    return rows, values, status


def _laid_out(values: Any, count: int, room: int, *, by_channel: bool) -> Any:
    """Samples as the client's array takes them, flat.

    Channel by channel the client expects each at its full length, also when fewer samples came.
    """
    channels, came = values.shape
    per_channel = count if count > 0 else (room // channels if channels else 0)
    if channels * came > room:
        raise ChassisError(-200229, f"Samples: {channels} x {came}, room: {room}", done=0)
    if not by_channel:
        return values.T.ravel()
    if came == per_channel:
        return values.ravel()
    full = np.zeros((channels, max(per_channel, came)), dtype=values.dtype)
    full[:, :came] = values
    return full.ravel()[:room]


@call("ReadAnalogF64")
def _read_analog(service: Service, request: Any) -> Any:
    _, values, status = read_scaled(service.task(request), request.num_samps_per_chan, request.timeout)
    by_channel = (request.fill_mode_raw or request.fill_mode) == BY_CHANNEL
    flat = _laid_out(values, request.num_samps_per_chan, request.array_size_in_samps, by_channel=by_channel)
    head = message("ReadAnalogF64Response")(status=status, samps_per_chan_read=values.shape[1])
    return head.SerializeToString() + packed_doubles(2, flat.astype("<f8").tobytes())


@call("ReadAnalogScalarF64")
def _read_scalar(service: Service, request: Any) -> Any:
    task = service.task(request)
    _, values, status = read_scaled(task, 1, request.timeout)
    if status:
        raise ChassisError(status, f"Task: {task.name}", done=0)
    return message("ReadAnalogScalarF64Response")(value=float(values[0, 0]))


def _read_integers(service: Service, request: Any, response: str, shift: int, low: int, high: int) -> Any:
    task = service.task(request)
    codes, status = transfer.read(task, request.num_samps_per_chan, request.timeout)
    _, codes = _selected(task, codes)
    by_channel = (request.fill_mode_raw or request.fill_mode) == BY_CHANNEL
    shifted = np.clip(codes.astype(np.int64) + shift, low, high)
    flat = _laid_out(shifted, request.num_samps_per_chan, request.array_size_in_samps, by_channel=by_channel)
    return message(response)(status=status, samps_per_chan_read=codes.shape[1], read_array=flat.tolist())


@call("ReadBinaryI16")
def _read_i16(service: Service, request: Any) -> Any:
    return _read_integers(service, request, "ReadBinaryI16Response", 0, -(2**15), 2**15 - 1)


@call("ReadBinaryI32")
def _read_i32(service: Service, request: Any) -> Any:
    return _read_integers(service, request, "ReadBinaryI32Response", 0, -(2**31), 2**31 - 1)


@call("ReadRaw")
def _read_raw(service: Service, request: Any) -> Any:
    task = service.task(request)
    codes, status = transfer.read(task, request.num_samps_per_chan, request.timeout)
    wide = any(channel.module.bits > 16 for channel in task.channels)
    data = codes.T.astype("<i4" if wide else "<i2").tobytes()
    if len(data) > request.array_size_in_bytes:
        raise ChassisError(-200229, f"Bytes: {len(data)}, room: {request.array_size_in_bytes}", done=0)
    return message("ReadRawResponse")(
        status=status,
        read_array=data,
        samps_read=codes.shape[1],
        num_bytes_per_samp=(4 if wide else 2) * codes.shape[0],
    )


# Writing


def _written(service: Service, request: Any, values: Any, response: str) -> Any:
    task = service.task(request)
    count = request.num_samps_per_chan
    channels = values.size // count if count else 0
    if channels * count != values.size or channels == 0:
        raise ChassisError(-200524, f"Values: {values.size}, samples per channel: {count}", done=0)
    by_channel = (request.data_layout_raw or request.data_layout) == BY_CHANNEL
    table = values.reshape(channels, count) if by_channel else values.reshape(count, channels).T
    put = _put(task, table, request)
    return message(response)(samps_per_chan_written=put)


def _put(task: Task, table: Any, request: Any) -> int:
    if task.kind != "ao":
        codes = np.empty(table.shape, dtype=np.int32)
    else:
        codes = transfer.to_codes(task, table) if table.dtype == np.float64 else table.astype(np.int32)
    return transfer.write(task, codes, auto_start=request.auto_start, timeout=request.timeout)


@call("WriteAnalogF64")
def _write_analog(service: Service, request: Any) -> Any:
    values = np.fromiter(request.write_array, dtype=np.float64, count=len(request.write_array))
    return _written(service, request, values, "WriteAnalogF64Response")


@call("WriteAnalogScalarF64")
def _write_scalar(service: Service, request: Any) -> Any:
    _put(service.task(request), np.array([[request.value]]), request)
    return message("WriteAnalogScalarF64Response")()


@call("WriteBinaryI16")
def _write_i16(service: Service, request: Any) -> Any:
    values = np.array(request.write_array, dtype=np.int32)
    return _written(service, request, values, "WriteBinaryI16Response")


@call("WriteBinaryI32")
def _write_i32(service: Service, request: Any) -> Any:
    values = np.array(request.write_array, dtype=np.int32)
    return _written(service, request, values, "WriteBinaryI32Response")


@call("WriteRaw")
def _write_raw(service: Service, request: Any) -> Any:
    task = service.task(request)
    data = np.frombuffer(request.write_array, dtype="<i2").astype(np.int32)
    if not request.num_samps or data.size % request.num_samps:
        raise ChassisError(-200524, f"Values: {data.size}, samples per channel: {request.num_samps}", done=0)
    put = _put(task, data.reshape(request.num_samps, -1).T, request)
    return message("WriteRawResponse")(samps_per_chan_written=put)


# Devices


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
def _error_string(service: Service, request: Any) -> Any:
    return message("GetErrorStringResponse")(error_string=OWN_TEXT.get(request.error_code, ""))
