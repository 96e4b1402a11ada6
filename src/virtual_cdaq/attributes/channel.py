"""Properties of the channels of a task."""

from __future__ import annotations

from typing import Any

from virtual_cdaq.attributes.table import Property, Table, constant, kept
from virtual_cdaq.model.channels import CUSTOM, DEGREES_C, DEGREES_F, DEGREES_R, KELVINS, OHMS, VOLTS, Channel
from virtual_cdaq.model.converters import step
from virtual_cdaq.model.errors import ChassisError, unsupported_value
from virtual_cdaq.model.modules import EXCITATION
from virtual_cdaq.model.scales import find_scale

AI_CHANNEL, AO_CHANNEL = 10100, 10102  # DAQmx_Val_AI, _AO
USAGE_VOLTAGE, USAGE_RESISTANCE, USAGE_RTD = 10322, 10278, 10301
INTERNAL, TWO_WIRE, THREE_WIRE, FOUR_WIRE = 10200, 2, 3, 4
REFERENCED_OUTPUT = 10083


def _for(kind: str, prop: Property) -> Property:
    """A property that only channels of one kind have."""

    def checked(channel: Channel) -> Channel:
        if channel.module.kind != kind:
            raise ChassisError(-200452, f"Channel: {channel.name}")
        return channel

    put, reset = prop.put, prop.reset
    return Property(
        lambda channel: prop.get(checked(channel)),
        None if put is None else lambda channel, value: put(checked(channel), value),
        None if reset is None else lambda channel: reset(checked(channel)),
    )


def _resistive(prop: Property) -> Property:
    def checked(channel: Channel) -> Channel:
        if not channel.module.resistive:
            raise ChassisError(-200452, f"Channel: {channel.name}")
        return channel

    put = prop.put
    return Property(
        lambda channel: prop.get(checked(channel)),
        None if put is None else lambda channel, value: put(checked(channel), value),
        prop.reset,
    )


def _set_limit(which: str) -> Any:
    def put(channel: Channel, value: float) -> None:
        channel.fit(*((value, channel.high) if which == "low" else (channel.low, value)))

    return put


def _reset_limit(which: str) -> Any:
    def reset(channel: Channel) -> None:
        low, high = channel.widest()
        _set_limit(which)(channel, low if which == "low" else high)

    return reset


def _usage(channel: Channel) -> int:
    return {"voltage": USAGE_VOLTAGE, "resistance": USAGE_RESISTANCE, "rtd": USAGE_RTD}[channel.measurement]


def _coerced(sign: int) -> Any:
    """What the input measures with its settings: the end of its range, not what was asked for."""

    def get(channel: Channel) -> float:
        low, high = (channel.low, channel.high) if channel.measurement == "rtd" else channel.range_ends()
        return high if sign > 0 else low

    return get


def _set_range(sign: int) -> Any:
    def put(channel: Channel, value: float) -> None:
        fit = [each for each in channel.module.ranges if abs(value) <= abs(each.high if sign > 0 else each.low)]
        if not fit:
            raise unsupported_value(
                f"{channel.module.kind.upper()}.Rng.{'High' if sign > 0 else 'Low'}",
                value,
                f"{channel.module.ranges[-1]}",
            )
        channel.chosen = fit[0]

    return put


def _range_end(sign: int) -> Any:
    def get(channel: Channel) -> float:
        return channel.chosen.high if sign > 0 else channel.chosen.low

    return get


def _set_name(channel: Channel, value: str) -> None:
    channel.name = value


def _set_terminal(channel: Channel, value: int) -> None:
    if value not in channel.module.terminals:
        raise unsupported_value("AI.TermCfg", value, str(channel.module.terminals))
    channel.terminal = value


def _set_timing_mode(channel: Channel, value: int) -> None:
    if value not in (16097, 10195, 14712):
        raise unsupported_value("AI.ADCTimingMode", value, "automatic, high resolution, high speed")
    channel.timing_mode = value


def _scale_coefficients(channel: Channel) -> list[float]:
    return [0.0, step(channel.module, channel.chosen)]


def _units_of(*own: int) -> Property:
    """Units of a measurement: its own, the first by default, or those of the channel's custom scale."""

    def put(channel: Channel, value: int) -> None:
        if value not in (*own, CUSTOM):
            raise unsupported_value("units", value, str((*own, CUSTOM)))
        if value == CUSTOM and find_scale(channel.scales, channel.scale_name).units_before not in own:
            raise unsupported_value("Scale.PreScaledUnits", channel.scale_name, str(own))
        channel.units = value

    return Property(lambda channel: channel.units, put, lambda channel: put(channel, own[0]))


def _set_scale(channel: Channel, name: str) -> None:
    channel.scale_name = name and find_scale(channel.scales, name).name


SCALE_NAME = Property(lambda channel: channel.scale_name, _set_scale, lambda channel: _set_scale(channel, ""))

CHANNEL: Table = {
    "CHAN_TYPE": Property(lambda c: AI_CHANNEL if c.module.kind == "ai" else AO_CHANNEL),
    "CHAN_DESCR": kept("CHAN_DESCR", ""),
    "CHAN_IS_GLOBAL": constant(False),
    "PHYSICAL_CHAN_NAME": Property(lambda c: c.physical),
    "AI_MEAS_TYPE": _for("ai", Property(_usage)),
    "AI_MAX": _for("ai", Property(_coerced(+1), _set_limit("high"), _reset_limit("high"))),
    "AI_MIN": _for("ai", Property(_coerced(-1), _set_limit("low"), _reset_limit("low"))),
    "AI_RNG_HIGH": _for("ai", Property(_range_end(+1), _set_range(+1))),
    "AI_RNG_LOW": _for("ai", Property(_range_end(-1), _set_range(-1))),
    "AI_TERM_CFG": _for("ai", Property(lambda c: c.terminal, _set_terminal)),
    "AI_COUPLING": _for("ai", constant(10050)),
    "AI_RESOLUTION": _for("ai", Property(lambda c: float(c.module.bits))),
    "AI_RESOLUTION_UNITS": _for("ai", constant(10109)),
    "AI_RAW_SAMP_SIZE": _for("ai", Property(lambda c: 16 if c.module.bits <= 16 else 32)),
    "AI_RAW_SAMP_JUSTIFICATION": _for("ai", constant(10279)),
    "AI_VOLTAGE_UNITS": _for("ai", _units_of(VOLTS)),
    "AI_TEMP_UNITS": _for("ai", _units_of(DEGREES_C, DEGREES_F, KELVINS, DEGREES_R)),
    "AI_RESISTANCE_UNITS": _for("ai", _units_of(OHMS)),
    "AI_CUSTOM_SCALE_NAME": _for("ai", SCALE_NAME),
    "AI_DEV_SCALING_COEFF": _for("ai", Property(_scale_coefficients)),
    "AI_AUTO_ZERO_MODE": _for("ai", kept("AI_AUTO_ZERO_MODE", 10230)),
    "AI_DATA_XFER_MECH": _for("ai", kept("AI_DATA_XFER_MECH", 12590)),
    "AI_MEM_MAP_ENABLE": _for("ai", kept("AI_MEM_MAP_ENABLE", False)),
    "AI_RTD_TYPE": _resistive(Property(lambda c: c.rtd_type)),
    "AI_RTD_R0": _resistive(Property(lambda c: c.r0)),
    "AI_RTD_A": _resistive(Property(lambda c: c.curve()[0], kept("AI_RTD_A", 0.0).put)),
    "AI_RTD_B": _resistive(Property(lambda c: c.curve()[1], kept("AI_RTD_B", 0.0).put)),
    "AI_RTD_C": _resistive(Property(lambda c: c.curve()[2], kept("AI_RTD_C", 0.0).put)),
    "AI_RESISTANCE_CFG": _resistive(Property(lambda c: c.wires)),
    "AI_EXCIT_SRC": _resistive(constant(INTERNAL)),
    "AI_EXCIT_VAL": _resistive(constant(EXCITATION)),
    "AI_EXCIT_ACTUAL_VAL": _resistive(kept("AI_EXCIT_ACTUAL_VAL", EXCITATION)),
    "AI_EXCIT_VOLTAGE_OR_CURRENT": _resistive(constant(10134)),
    "AI_ADC_TIMING_MODE": _resistive(Property(lambda c: c.timing_mode, _set_timing_mode)),
    "AI_OPEN_CHAN_DETECT_ENABLE": _resistive(kept("AI_OPEN_CHAN_DETECT_ENABLE", False)),
    "AO_OUTPUT_TYPE": _for("ao", constant(USAGE_VOLTAGE)),
    "AO_MAX": _for("ao", Property(lambda c: c.high, _set_limit("high"), _reset_limit("high"))),
    "AO_MIN": _for("ao", Property(lambda c: c.low, _set_limit("low"), _reset_limit("low"))),
    "AO_DAC_RNG_HIGH": _for("ao", Property(_range_end(+1), _set_range(+1))),
    "AO_DAC_RNG_LOW": _for("ao", Property(_range_end(-1), _set_range(-1))),
    "AO_TERM_CFG": _for("ao", constant(REFERENCED_OUTPUT)),
    "AO_RESOLUTION": _for("ao", Property(lambda c: float(c.module.bits))),
    "AO_RESOLUTION_UNITS": _for("ao", kept("AO_RESOLUTION_UNITS", 10109)),
    "AO_VOLTAGE_UNITS": _for("ao", _units_of(VOLTS)),
    "AO_CUSTOM_SCALE_NAME": _for("ao", SCALE_NAME),
    "AO_DEV_SCALING_COEFF": _for("ao", Property(lambda c: [0.0, 1.0 / step(c.module, c.chosen)])),
}
