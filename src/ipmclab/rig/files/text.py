"""A rig as the text of its file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ipmclab.destination import write_text
from ipmclab.rig.channels import Channel, FourProbe, Output, Rig, Thermometer, VirtualStrip
from ipmclab.rig.files.chamber import chamber_table
from ipmclab.rig.files.rig_file import NI_9205_NOISE
from ipmclab.units import (
    CURRENT,
    FORCE,
    LENGTH,
    RELATIVE_HUMIDITY,
    RESISTANCE,
    TEMPERATURE,
    VOLTAGE,
    readable_quantity,
)


def write_rig(rig: Rig, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a rig to a TOML file, from which ``load_rig`` reads the same rig.

    A scale is written as two points, from which gain and offset are computed again to rounding.

    Raises
    ------
    InputError
        No such folder, or an existing file.
    IpmclabError
        The system refuses to write there.
    """
    write_text(rig_to_text(rig), path, overwrite=overwrite)


def rig_to_text(rig: Rig) -> str:
    """The text of a rig's TOML file.

    Examples
    --------
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> print(rig_to_text(THESIS_RIG).splitlines()[2])
    shunt_resistance = "1 ohm"
    """
    import tomli_w

    table: dict[str, Any] = {"name": rig.name, "bench": rig.bench}
    if rig.address is not None:
        table["address"] = rig.address
    table["shunt_resistance"] = readable_quantity(rig.shunt_resistance, RESISTANCE)
    if rig.source_resistance:
        table["source_resistance"] = readable_quantity(rig.source_resistance, RESISTANCE)
    table["voltage_sensed"] = rig.voltage_sensed
    table["output"] = _output(rig.output)
    table["channels"] = {channel.name: _channel(channel) for channel in rig.channels}
    if rig.thermometer is not None:
        table["thermometer"] = _thermometer(rig.thermometer)
    if rig.four_probe is not None:
        table["four_probe"] = _four_probe(rig.four_probe)
    if rig.bench == "virtual" or rig.virtual != VirtualStrip():
        table["virtual"] = _virtual(rig.virtual)
    if rig.chamber is not None:
        table["chamber"] = chamber_table(rig.chamber)
    return tomli_w.dumps(table)


def _output(output: Output) -> dict[str, Any]:
    range_ = [readable_quantity(output.low, VOLTAGE), readable_quantity(output.high, VOLTAGE)]
    table: dict[str, Any] = {"physical": output.physical} if output.physical else {}
    table["range"] = range_
    if output.amplifier:
        table["amplifier"] = output.amplifier
    if output.current_limit is not None:
        table["current_limit"] = readable_quantity(output.current_limit, CURRENT)
    return table


def _channel(channel: Channel) -> dict[str, Any]:
    quantity, converter = channel.quantity, channel.converter
    table: dict[str, Any] = {"physical": channel.physical} if channel.physical else {}
    if channel.terminal != "differential":
        table["terminal"] = channel.terminal
    table["range"] = [readable_quantity(converter.low, VOLTAGE), readable_quantity(converter.high, VOLTAGE)]
    if converter.noise != NI_9205_NOISE.get(converter.high):
        table["noise"] = readable_quantity(converter.noise, VOLTAGE)
    if channel.name != "voltage" or (channel.gain, channel.offset) != (1.0, 0.0):
        table["scale"] = _points(channel)
    if channel.sensor_range is not None:
        table["sensor_range"] = [readable_quantity(end, quantity) for end in channel.sensor_range]
    for key, value in (("sensor_noise", channel.sensor_noise), ("rest", channel.rest)):
        if value:
            table[key] = readable_quantity(value, quantity)
    if channel.lost is not None:
        table["lost"] = readable_quantity(channel.lost, VOLTAGE)
    if channel.zeroed:
        table["zeroed"] = True
    if channel.calibrated is not None:
        table["calibrated"] = channel.calibrated
    if channel.uncertainty:
        table["uncertainty"] = readable_quantity(channel.uncertainty, quantity)
    table |= {key: text for key, text in (("instrument", channel.instrument), ("interface", channel.interface)) if text}
    if channel.sensor_resolution:
        table["sensor_resolution"] = readable_quantity(channel.sensor_resolution, quantity)
    return table


def _points(channel: Channel) -> list[list[str]]:
    """Two points of the scale: the ends of the sensor where that gives gain and offset to the digit."""
    candidates = [(0.0, 1.0), (0.0, 10.0)]
    if channel.sensor_range is not None:
        low, high = ((end - channel.offset) / channel.gain for end in channel.sensor_range)
        candidates = [(float(f"{low:.12g}"), float(f"{high:.12g}")), *candidates]
    best, least = candidates[0], float("inf")
    for v0, v1 in candidates:
        q0, q1 = channel.gain * v0 + channel.offset, channel.gain * v1 + channel.offset
        if v0 == v1 or q0 == q1:
            continue
        gain = (q1 - q0) / (v1 - v0)
        error = abs(gain / channel.gain - 1.0) + abs(q0 - gain * v0 - channel.offset)
        if error < least:
            best, least = (v0, v1), error
    return [
        [readable_quantity(v, VOLTAGE), readable_quantity(channel.gain * v + channel.offset, channel.quantity)]
        for v in best
    ]


def _thermometer(meter: Thermometer) -> dict[str, Any]:
    return {
        **({"physical": meter.physical} if meter.physical else {}),
        "resistance": readable_quantity(meter.resistance, RESISTANCE),
        "wires": meter.wires,
        "current": readable_quantity(meter.current, CURRENT),
    }


def _four_probe(probe: FourProbe) -> dict[str, Any]:
    return {
        **({"physical": probe.physical} if probe.physical else {}),
        "spacing": readable_quantity(probe.spacing, LENGTH),
        "current": readable_quantity(probe.current, CURRENT),
        "contacts": probe.contacts,
        "offset": readable_quantity(probe.offset, RESISTANCE),
    }


def _virtual(strip: VirtualStrip) -> dict[str, Any]:
    return {
        "actuator": strip.actuator,
        "seed": strip.seed,
        "temperature": readable_quantity(strip.temperature, TEMPERATURE),
        "relative_humidity": readable_quantity(strip.relative_humidity, RELATIVE_HUMIDITY),
        "hydrated": strip.hydrated,
        "load": strip.load,
        "preload_drift": readable_quantity(strip.preload_drift, FORCE),
        "meter_offset": readable_quantity(strip.meter_offset, RESISTANCE),
    }
