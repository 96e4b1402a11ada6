"""Channels from the requests that create them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

from virtual_cdaq.attributes.channel import INTERNAL
from virtual_cdaq.attributes.device import PhysicalChannel, find_physical
from virtual_cdaq.model.channels import DEGREES_C, OHMS, VOLTS, Channel
from virtual_cdaq.model.chassis import HostedTask
from virtual_cdaq.model.converters import RTD_CURVES, choose_range
from virtual_cdaq.model.errors import ChassisError, unsupported_value
from virtual_cdaq.model.modules import EXCITATION, Differential
from virtual_cdaq.model.names import expand
from virtual_cdaq.model.waiting import gate

DEFAULT_TERMINAL = -1
FROM_CUSTOM_SCALE = 10065
FEWEST_WIRES = 3  # the NI 9217 measures with three or four


def _chosen(request: Any, name: str) -> int:
    """A value of an enumeration, which a client sends raw or by name."""
    return int(getattr(request, f"{name}_raw") or getattr(request, name))


def _physical(
    task: HostedTask, request: Any, kind: Literal["ai", "ao"], *, resistive: bool
) -> Iterator[tuple[PhysicalChannel, str]]:
    """The physical channels of a request with the names that they get in the task."""
    gate(task.chassis)
    channels = [find_physical(task.chassis, name) for name in expand(request.physical_channel)]
    if not channels:
        raise ChassisError(-200170, "Physical channel: (none)")
    for channel in channels:
        module = channel.slot.module
        if module.kind != kind or module.resistive != resistive:
            raise ChassisError(-200431, f"Physical channel: {channel.name} ({module.product})\nTask: {task.name}")
    names = expand(request.name_to_assign_to_channel)
    if len(names) == 1 and len(channels) > 1:
        names = [f"{names[0]}{index}" for index in range(len(channels))]
    for index, channel in enumerate(channels):
        yield channel, names[index] if index < len(names) else channel.name


def _add(task: HostedTask, channel: PhysicalChannel, name: str, request: Any, **more: Any) -> None:
    low, high = request.min_val, request.max_val
    module = channel.slot.module
    if not low < high:
        raise ChassisError(-200082, f"Minimum: {low:g}\nMaximum: {high:g}\nChannel: {channel.name}")
    chosen = module.ranges[-1] if more["measurement"] == "rtd" else choose_range(module, low, high)
    if chosen is None:
        most = module.ranges[-1]
        which, value = ("Max", high) if high > most.high else ("Min", low)
        raise unsupported_value(
            f"{module.kind.upper()}.{which}", value, f"{most.low:g} to {most.high:g}\nChannel: {channel.name}"
        )
    task.add(
        Channel(
            name=name,
            physical=channel.name,
            device=channel.slot.device,
            module=module,
            low=low,
            high=high,
            chosen=chosen,
            **more,
        )
    )


def voltage_input(task: HostedTask, request: Any) -> None:
    """Add voltage inputs."""
    wanted = _chosen(request, "terminal_config")
    for channel, name in _physical(task, request, "ai", resistive=False):
        module = channel.slot.module
        single = module.differential_only(channel.index)
        terminal = wanted
        if wanted == DEFAULT_TERMINAL:
            terminal = module.terminals[1] if single else module.terminals[0]
        if terminal not in module.terminals or (single and terminal == Differential):
            raise unsupported_value("AI.TermCfg", terminal, f"{module.terminals}\nChannel: {channel.name}")
        _refuse_scale(request)
        _add(task, channel, name, request, measurement="voltage", units=VOLTS, terminal=terminal)


def voltage_output(task: HostedTask, request: Any) -> None:
    """Add voltage outputs."""
    for channel, name in _physical(task, request, "ao", resistive=False):
        _refuse_scale(request)
        _add(task, channel, name, request, measurement="voltage", units=VOLTS)


def rtd(task: HostedTask, request: Any) -> None:
    """Add platinum resistors."""
    kind = _chosen(request, "rtd_type")
    for channel, name in _physical(task, request, "ai", resistive=True):
        if kind not in RTD_CURVES:
            raise unsupported_value("AI.RTD.Type", kind, str(sorted(RTD_CURVES)))
        wires = _check_excitation(request)
        _add(
            task,
            channel,
            name,
            request,
            measurement="rtd",
            units=_chosen(request, "units") or DEGREES_C,
            terminal=Differential,
            rtd_type=kind,
            r0=request.r0,
            wires=wires,
        )


def resistance(task: HostedTask, request: Any) -> None:
    """Add resistances."""
    for channel, name in _physical(task, request, "ai", resistive=True):
        wires = _check_excitation(request)
        _refuse_scale(request)
        _add(
            task,
            channel,
            name,
            request,
            measurement="resistance",
            units=OHMS,
            terminal=Differential,
            wires=wires,
        )


def _check_excitation(request: Any) -> int:
    wires = _chosen(request, "resistance_config")
    if wires < FEWEST_WIRES:
        raise unsupported_value("AI.ResistanceCfg", f"{wires} wires", "3 or 4 wires")
    if _chosen(request, "current_excit_source") != INTERNAL:
        raise unsupported_value("AI.Excit.Src", "external or none", "internal")
    if abs(request.current_excit_val - EXCITATION) > 1e-9:
        raise unsupported_value("AI.Excit.Val", f"{request.current_excit_val:g} A", f"{EXCITATION:g} A")
    return wires


def _refuse_scale(request: Any) -> None:
    if _chosen(request, "units") == FROM_CUSTOM_SCALE:
        raise ChassisError(-200452, f"Custom scale: {request.custom_scale_name} (the stand-in has none)")
