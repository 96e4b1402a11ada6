"""Calls that write."""

from __future__ import annotations

from typing import Any

import numpy as np

from virtual_cdaq.model import transfer
from virtual_cdaq.model.chassis import HostedTask
from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.protocol import message
from virtual_cdaq.service import BY_CHANNEL, Service, call


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


def _put(task: HostedTask, table: Any, request: Any) -> int:
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


@call("WriteBinaryU16")
def _write_u16(service: Service, request: Any) -> Any:
    values = np.array(request.write_array, dtype=np.uint32).astype(np.uint16).view(np.int16).astype(np.int32)
    return _written(service, request, values, "WriteBinaryU16Response")


@call("WriteBinaryU32")
def _write_u32(service: Service, request: Any) -> Any:
    values = np.array(request.write_array, dtype=np.uint32).view(np.int32)
    return _written(service, request, values, "WriteBinaryU32Response")


@call("WriteRaw")
def _write_raw(service: Service, request: Any) -> Any:
    task = service.task(request)
    data = np.frombuffer(request.write_array, dtype="<i2").astype(np.int32)
    channels = data.size // request.num_samps if request.num_samps > 0 else 0
    if not channels:
        raise ChassisError(-200524, f"Values: {data.size}, samples per channel: {request.num_samps}", done=0)
    put = _put(task, data[: channels * request.num_samps].reshape(request.num_samps, channels).T, request)
    return message("WriteRawResponse")(samps_per_chan_written=put)
