"""Reading and writing waveforms: samples with their start and interval."""

from __future__ import annotations

from typing import Any

import numpy as np

from virtual_cdaq.calls.reading import read_scaled
from virtual_cdaq.model import transfer
from virtual_cdaq.model.channels import DEGREES_C, DEGREES_F, DEGREES_R, KELVINS, OHMS, VOLTS
from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.protocol import message
from virtual_cdaq.service import Service, call

WITH_TIMING, WITH_PROPERTIES = 1, 2
EPOCH = 2_082_844_800  # s from 1904-01-01, where NI's time stamps begin, to 1970-01-01
UNITS = {VOLTS: "Volts", OHMS: "Ohms", DEGREES_C: "°C", DEGREES_F: "°F", KELVINS: "K", DEGREES_R: "°R"}


@call("ReadAnalogWaveforms")
def _read_waveforms(service: Service, request: Any) -> Any:
    task = service.task(request)
    rows, values, status = read_scaled(task, request.num_samps_per_chan, request.timeout)
    mode = request.waveform_attribute_mode_raw or request.waveform_attribute_mode
    response = message("ReadAnalogWaveformsResponse")(status=status, samps_per_chan_read=values.shape[1])
    # Of the first sample: for a clocked task its edge, else the present.
    begin = service.chassis.wall_time(task, values.shape[1])
    for row, data in zip(rows, values, strict=True):
        waveform = response.waveforms.add()
        waveform.y_data.extend(data.tolist())
        if mode & WITH_TIMING:
            whole = int(begin // 1)
            waveform.t0.seconds = whole + EPOCH
            waveform.t0.fractional_seconds = int((begin - whole) * 2**64)
            if task.hardware_timed:
                waveform.dt = 1.0 / task.rate
        if mode & WITH_PROPERTIES:
            channel = task.channels[row]
            waveform.attributes["NI_ChannelName"].string_value = channel.name
            waveform.attributes["NI_UnitDescription"].string_value = (
                UNITS[channel.units] if channel.custom is None else channel.custom.units_after
            )
    return response


@call("WriteAnalogWaveforms")
def _write_waveforms(service: Service, request: Any) -> Any:
    task = service.task(request)
    if not request.waveforms or len({len(waveform.y_data) for waveform in request.waveforms}) != 1:
        raise ChassisError(-200524, f"Waveforms: {len(request.waveforms)}", done=0)
    values = np.array([waveform.y_data for waveform in request.waveforms], dtype=np.float64)
    codes = transfer.to_codes(task, values) if task.kind == "ao" else np.empty(values.shape, dtype=np.int32)
    put = transfer.write(task, codes, auto_start=request.auto_start, timeout=request.timeout)
    return message("WriteAnalogWaveformsResponse")(samps_per_chan_written=put)
