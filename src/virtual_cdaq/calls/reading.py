"""Calls that read."""

from __future__ import annotations

from typing import Any

import numpy as np

from virtual_cdaq import attributes
from virtual_cdaq.model import transfer
from virtual_cdaq.model.chassis import HostedTask
from virtual_cdaq.model.converters import Codes, Floats
from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.model.names import expand
from virtual_cdaq.protocol import message, packed_doubles
from virtual_cdaq.service import BY_CHANNEL, Service, call


def _selected(task: HostedTask, codes: Codes) -> tuple[list[int], Codes]:
    """The channels that the task's reads return."""
    wanted = expand(attributes.TABLES["Read"]["CHANNELS_TO_READ"].get(task))
    names = [channel.name for channel in task.channels]
    rows = [names.index(name) for name in wanted if name in names]
    return rows, codes if rows == list(range(len(names))) else codes[rows]


def read_scaled(task: HostedTask, count: int, timeout: float) -> tuple[list[int], Floats, int]:
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


def _read_integers(service: Service, request: Any, response: str, bits: int, *, signed: bool) -> Any:
    """Codes as whole numbers of so many bits; without a sign the same bits are read as a number from 0 on."""
    task = service.task(request)
    codes, status = transfer.read(task, request.num_samps_per_chan, request.timeout)
    _, codes = _selected(task, codes)
    by_channel = (request.fill_mode_raw or request.fill_mode) == BY_CHANNEL
    whole = np.clip(codes.astype(np.int64), -(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    if not signed:
        whole &= 2**bits - 1
    flat = _laid_out(whole, request.num_samps_per_chan, request.array_size_in_samps, by_channel=by_channel)
    return message(response)(status=status, samps_per_chan_read=codes.shape[1], read_array=flat.tolist())


@call("ReadBinaryI16")
def _read_i16(service: Service, request: Any) -> Any:
    return _read_integers(service, request, "ReadBinaryI16Response", 16, signed=True)


@call("ReadBinaryI32")
def _read_i32(service: Service, request: Any) -> Any:
    return _read_integers(service, request, "ReadBinaryI32Response", 32, signed=True)


@call("ReadBinaryU16")
def _read_u16(service: Service, request: Any) -> Any:
    return _read_integers(service, request, "ReadBinaryU16Response", 16, signed=False)


@call("ReadBinaryU32")
def _read_u32(service: Service, request: Any) -> Any:
    return _read_integers(service, request, "ReadBinaryU32Response", 32, signed=False)


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
        read_array=data.ljust(
            request.array_size_in_bytes, b"\0"
        ),  # the whole of the caller's room, as NI's server sends it
        samps_read=codes.shape[1],
        num_bytes_per_samp=(4 if wide else 2) * codes.shape[0],
    )
