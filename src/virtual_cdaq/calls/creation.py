"""Channels from the requests that create them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

from virtual_cdaq.attributes.channel import INTERNAL
from virtual_cdaq.attributes.device import PhysicalChannel, find_physical
from virtual_cdaq.model.channels import CUSTOM, DEGREES_C, DEGREES_F, DEGREES_R, KELVINS, OHMS, VOLTS, Channel
from virtual_cdaq.model.chassis import HostedTask
from virtual_cdaq.model.converters import RTD_CURVES
from virtual_cdaq.model.errors import ChassisError, unsupported_value
from virtual_cdaq.model.modules import EXCITATION, Differential
from virtual_cdaq.model.names import assigned, expand
from virtual_cdaq.model.scales import find_scale
from virtual_cdaq.model.waiting import gate

DEFAULT_TERMINAL = -1
DEGREES = (DEGREES_C, DEGREES_F, KELVINS, DEGREES_R)
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
    names = assigned(request.name_to_assign_to_channel, len(channels)) or [channel.name for channel in channels]
    yield from zip(channels, names, strict=True)


def _add(task: HostedTask, channel: PhysicalChannel, name: str, request: Any, **more: Any) -> None:
    low, high = request.min_val, request.max_val
    module = channel.slot.module
    if not low < high:
        raise ChassisError(-200082, f"Minimum: {low:g}\nMaximum: {high:g}\nChannel: {channel.name}")
    made = Channel(
        name=name,
        physical=channel.name,
        device=channel.slot.device,
        module=module,
        low=low,
        high=high,
        chosen=module.ranges[-1],
        scales=task.chassis.scales,
        **more,
    )
    made.fit(low, high)
    task.add(made)


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
        units = _units(task, request, VOLTS)
        _add(task, channel, name, request, measurement="voltage", terminal=terminal, **units)


def voltage_output(task: HostedTask, request: Any) -> None:
    """Add voltage outputs."""
    for channel, name in _physical(task, request, "ao", resistive=False):
        _add(task, channel, name, request, measurement="voltage", **_units(task, request, VOLTS))


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
            terminal=Differential,
            rtd_type=kind,
            r0=request.r0,
            wires=wires,
            **_units(task, request, *DEGREES),
        )


def resistance(task: HostedTask, request: Any) -> None:
    """Add resistances."""
    for channel, name in _physical(task, request, "ai", resistive=True):
        wires = _check_excitation(request)
        _add(
            task,
            channel,
            name,
            request,
            measurement="resistance",
            terminal=Differential,
            wires=wires,
            **_units(task, request, OHMS),
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


def _units(task: HostedTask, request: Any, *own: int) -> dict[str, Any]:
    """The units of a channel, of which the first of its own is the default, or its custom scale."""
    wanted = _chosen(request, "units")
    if wanted != CUSTOM:
        return {"units": wanted if wanted in own else own[0]}
    scale = find_scale(task.chassis.scales, getattr(request, "custom_scale_name", ""))
    if scale.units_before not in own:
        raise unsupported_value("Scale.PreScaledUnits", scale.units_before, f"{own}\nCustom scale: {scale.name}")
    return {"units": CUSTOM, "scale_name": scale.name}
