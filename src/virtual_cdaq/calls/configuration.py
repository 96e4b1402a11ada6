"""Calls that add channels and set timing, triggers and buffers."""

from __future__ import annotations

from typing import Any

from virtual_cdaq import attributes
from virtual_cdaq.attributes.task import set_input_size, set_output_size, set_trigger_type
from virtual_cdaq.calls import creation
from virtual_cdaq.protocol import message
from virtual_cdaq.service import Service, call


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
