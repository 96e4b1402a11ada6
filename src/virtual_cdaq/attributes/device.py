"""Properties of the chassis, its modules and their physical channels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from virtual_cdaq.attributes.channel import USAGE_RESISTANCE, USAGE_RTD, USAGE_VOLTAGE
from virtual_cdaq.attributes.table import Property, Table, constant
from virtual_cdaq.model.chassis import Chassis, Slot
from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.model.task import CONTINUOUS, FINITE

C_SERIES, USB, C_SERIES_BUS = 14659, 12586, 14637  # categories and bus types of DAQmx
TERMINAL_BITS = {10083: 1, 10078: 2, 10106: 4}  # RSE, NRSE, differential in a set of configurations
DIGITAL_EDGE_BIT = 0x2
DRIVER = (26, 0, 0)  # the driver that the stand-in says it is: the properties are those of its client


@dataclass(frozen=True)
class Device:
    """The chassis, or one of its modules."""

    chassis: Chassis
    name: str

    @property
    def is_chassis(self) -> bool:
        """Whether it is the chassis."""
        return self.name == self.chassis.name

    @property
    def slots(self) -> list[Slot]:
        """The modules of that name: one for a module, none for the chassis.

        A device without slots is a chassis whose modules bear its own name, so there may be several.
        """
        return [slot for slot in self.chassis.slots if slot.device == self.name]

    @property
    def devices(self) -> list[str]:
        """What a reset of it reaches."""
        return self.chassis.devices if self.is_chassis else [self.name]


@dataclass(frozen=True)
class PhysicalChannel:
    """One input or output of a module."""

    slot: Slot
    index: int

    @property
    def name(self) -> str:
        """Such as ``cDAQ1Mod1/ai0``."""
        return f"{self.slot.device}/{self.slot.module.kind}{self.index}"


def find_device(chassis: Chassis, name: str) -> Device:
    """The device of a name; a physical channel names its device too.

    Raises
    ------
    ChassisError
        -200220, no such device.
    """
    wanted = name.strip().strip("/").split("/")[0]
    for device in chassis.devices:
        if device.lower() == wanted.lower():
            return Device(chassis, device)
    raise ChassisError(-200220, f"Device Specified: {wanted}")


def find_physical(chassis: Chassis, name: str) -> PhysicalChannel:
    """The physical channel of a name.

    Raises
    ------
    ChassisError
        -200220 or -200170.
    """
    device = find_device(chassis, name)
    port = name.strip().strip("/").rpartition("/")[2].lower()
    port = chassis.inner_channels.get(port, port)
    for slot in device.slots if "/" in name.strip().strip("/") else []:
        digits = port.removeprefix(slot.module.kind)
        if digits != port and digits.isdecimal() and int(digits) < slot.module.channels:
            return PhysicalChannel(slot, int(digits))
    raise ChassisError(-200170, f"Physical channel: {name.strip()}\nDevice: {device.name}")


def _module(kind: str | None, get: Any) -> Property:
    """A property that modules of a kind have."""

    def of(device: Device) -> Any:
        for slot in device.slots:
            if kind in (None, slot.module.kind):
                return get(slot)
        raise ChassisError(-200197, f"Device: {device.name}")

    return Property(of)


def _always(value: Any) -> Any:
    return lambda _: value


def _chassis(get: Any) -> Property:
    def of(device: Device) -> Any:
        if not device.is_chassis:
            raise ChassisError(-200197, f"Device: {device.name}")
        return get(device.chassis)

    return Property(of)


def _channels(kind: str) -> Property:
    """The physical channels of a kind; none on the chassis and on other modules."""

    def of(device: Device) -> str:
        return ", ".join(
            f"{slot.device}/{kind}{index}"
            for slot in device.slots
            if slot.module.kind == kind
            for index in range(slot.module.channels)
        )

    return Property(of)


def _ranges(slot: Slot) -> list[float]:
    return [end for each in slot.module.ranges for end in (each.low, each.high)]


def _input_ranges(slot: Slot) -> list[float]:
    return [] if slot.module.resistive else _ranges(slot)


def _usages(slot: Slot) -> list[int]:
    return [USAGE_RTD, USAGE_RESISTANCE] if slot.module.resistive else [USAGE_VOLTAGE]


def _serial(device: Device) -> int:
    return 0x1D0C0000 + (0 if device.is_chassis else device.slots[0].number)


def _terminals(device: Device) -> str:
    chassis = device.chassis
    signals = [f"/{chassis.name}/{name}/{s}" for name in chassis.engines for s in ("SampleClock", "StartTrigger")]
    return ", ".join(signals)


DEVICE: Table = {
    "IS_SIMULATED": constant(True),
    "PRODUCT_CATEGORY": Property(lambda d: d.chassis.category if d.is_chassis else C_SERIES),
    "PRODUCT_TYPE": Property(lambda d: d.chassis.product if d.is_chassis else d.slots[0].module.product),
    "PRODUCT_NUM": Property(lambda d: d.chassis.number if d.is_chassis else d.slots[0].module.number),
    "SERIAL_NUM": Property(_serial),
    "BUS_TYPE": Property(lambda d: USB if d.is_chassis else C_SERIES_BUS),
    "TERMINALS": Property(_terminals),
    "COMPACT_DAQ_CHASSIS_DEV_NAME": _module(None, lambda s: s.device.rpartition("Mod")[0]),
    "COMPACT_DAQ_SLOT_NUM": _module(None, lambda s: s.number),
    "CHASSIS_MODULE_DEV_NAMES": _chassis(lambda c: ", ".join(c.devices[1:])),
    "ANLG_TRIG_SUPPORTED": constant(False),
    "DIG_TRIG_SUPPORTED": constant(True),
    "TIME_TRIG_SUPPORTED": constant(False),
    "AI_PHYSICAL_CHANS": _channels("ai"),
    "AI_SUPPORTED_MEAS_TYPES": _module("ai", _usages),
    "AI_MAX_SINGLE_CHAN_RATE": _module("ai", lambda s: s.module.rate),
    "AI_MAX_MULTI_CHAN_RATE": _module("ai", lambda s: s.module.aggregate_rate),
    "AI_MIN_RATE": _module("ai", _always(80e6 / 2**32)),
    "AI_SIMULTANEOUS_SAMPLING_SUPPORTED": _module("ai", _always(False)),
    "AI_NUM_SAMP_TIMING_ENGINES": _module("ai", _always(3)),
    "AI_SAMP_MODES": _module("ai", _always([FINITE, CONTINUOUS])),
    "AI_VOLTAGE_RNGS": _module("ai", _input_ranges),
    "AI_RESISTANCE_RNGS": _module("ai", lambda s: _ranges(s) if s.module.resistive else []),
    "AI_TRIG_USAGE": _module("ai", _always(DIGITAL_EDGE_BIT)),
    "AI_COUPLINGS": _module("ai", _always(2)),
    "AI_CURRENT_RNGS": _module("ai", _always([])),
    "AI_FREQ_RNGS": _module("ai", _always([])),
    "AI_GAINS": _module("ai", _always([])),
    "AO_PHYSICAL_CHANS": _channels("ao"),
    "AO_SUPPORTED_OUTPUT_TYPES": _module("ao", _always([USAGE_VOLTAGE])),
    "AO_MAX_RATE": _module("ao", lambda s: s.module.rate),
    "AO_MIN_RATE": _module("ao", _always(80e6 / 2**32)),
    "AO_SAMP_CLK_SUPPORTED": _module("ao", _always(True)),
    "AO_NUM_SAMP_TIMING_ENGINES": _module("ao", _always(1)),
    "AO_SAMP_MODES": _module("ao", _always([FINITE, CONTINUOUS])),
    "AO_VOLTAGE_RNGS": _module("ao", _ranges),
    "AO_CURRENT_RNGS": _module("ao", _always([])),
    "AO_GAINS": _module("ao", _always([])),
    "AO_TRIG_USAGE": _module("ao", _always(DIGITAL_EDGE_BIT)),
    "CI_PHYSICAL_CHANS": constant(""),
    "CO_PHYSICAL_CHANS": constant(""),
    "DI_LINES": constant(""),
    "DI_PORTS": constant(""),
    "DO_LINES": constant(""),
    "DO_PORTS": constant(""),
}


def _terminal_set(channel: PhysicalChannel) -> int:
    module = channel.slot.module
    if module.kind != "ai":
        raise ChassisError(-200197, f"Physical channel: {channel.name}")
    chosen = module.terminals
    if module.differential_only(channel.index):
        chosen = tuple(each for each in chosen if each != 10106)
    return sum(TERMINAL_BITS[each] for each in chosen)


def _output_terminal_set(channel: PhysicalChannel) -> int:
    if channel.slot.module.kind != "ao":
        raise ChassisError(-200197, f"Physical channel: {channel.name}")
    return TERMINAL_BITS[10083]


def _usages_of(kind: str) -> Any:
    def of(channel: PhysicalChannel) -> list[int]:
        if channel.slot.module.kind != kind:
            raise ChassisError(-200197, f"Physical channel: {channel.name}")
        return _usages(channel.slot)

    return of


PHYSICAL: Table = {
    "PHYSICAL_CHAN_AI_SUPPORTED_MEAS_TYPES": Property(_usages_of("ai")),
    "PHYSICAL_CHAN_AI_TERM_CFGS": Property(_terminal_set),
    "PHYSICAL_CHAN_AO_SUPPORTED_OUTPUT_TYPES": Property(_usages_of("ao")),
    "PHYSICAL_CHAN_AO_TERM_CFGS": Property(_output_terminal_set),
    "PHYSICAL_CHAN_AO_MANUAL_CONTROL_AMPLITUDE": constant(0.0),
}

SYSTEM: Table = {
    "DEV_NAMES": Property(lambda c: ", ".join(c.devices)),
    "GLOBAL_CHANS": constant(""),
    "SCALES": constant(""),
    "TASKS": constant(""),
    "NIDAQ_MAJOR_VERSION": constant(DRIVER[0]),
    "NIDAQ_MINOR_VERSION": constant(DRIVER[1]),
    "NIDAQ_UPDATE_VERSION": constant(DRIVER[2]),
}
