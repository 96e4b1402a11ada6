"""The tables of a rig file as they are there: known keys, texts where quantities belong."""

from __future__ import annotations

import datetime
from typing import Annotated, Literal

from pydantic import Field

from ipmclab.store.strict import Strict

TextPair = Annotated[tuple[str, str], Field(strict=False)]
"""Two texts, written ``["-1 V", "1 V"]``."""

Points = Annotated[tuple[TextPair, TextPair], Field(strict=False)]
"""Two points of a scale: terminal volts, quantity."""


class OutputTable(Strict):
    """``[output]``."""

    physical: str = ""
    range: TextPair = ("-10 V", "10 V")
    amplifier: str = ""
    current_limit: str | None = None


class ChannelTable(Strict):
    """``[channels.NAME]``."""

    physical: str = ""
    terminal: Literal["differential", "single-ended", "non-referenced"] = "differential"
    range: TextPair
    noise: str | None = None
    scale: Points | None = None
    sensor_range: TextPair | None = None
    sensor_noise: str | None = None
    rest: str | None = None
    lost: str | None = None
    zeroed: bool = False
    calibrated: str | datetime.date | None = None
    uncertainty: str | None = None
    instrument: str = ""
    interface: str = ""
    sensor_resolution: str | None = None


class ThermometerTable(Strict):
    """``[thermometer]``."""

    physical: str = ""
    resistance: str = "100 ohm"
    wires: Literal[3, 4] = 4
    current: str = "1 mA"


class FourProbeTable(Strict):
    """``[four_probe]``."""

    physical: str = ""
    spacing: str = "10 mm"
    current: str = "1 mA"
    contacts: Literal["line", "points"] = "line"
    offset: str = "0.05 ohm"


class VirtualTable(Strict):
    """``[virtual]``."""

    actuator: str = "friend-2"
    seed: Annotated[int, Field(ge=0)] = 20261121
    temperature: str = "22 degC"
    relative_humidity: str = "45 percent"
    hydrated: bool = False
    load: Literal["strip", "dummy"] = "strip"
    preload_drift: str = "0 mN"
    meter_offset: str = "0 ohm"


class ChamberTable(Strict):
    """``[chamber]``."""

    driver: Literal["virtual", "espec-p300", "espec-sh", "watlow-f4t", "dew-point", "scpi", "modbus"]
    port: str | None = None
    address: str | None = None
    baud_rate: Annotated[int, Field(ge=300, le=921600)] | None = None
    parity: Literal["none", "even", "odd"] = "none"
    unit: Annotated[int, Field(ge=0, le=247)] = 1
    patience: str | None = None
    temperature: TextPair | None = None
    relative_humidity: TextPair | None = None
    table: str | None = None
    cell_temperature: str | None = None
    run_event: Annotated[int, Field(ge=1, le=8)] | None = None


class RigTable(Strict):
    """The whole file."""

    name: str
    bench: Literal["virtual", "ni"]
    address: str | None = None
    shunt_resistance: str
    source_resistance: str = "0 ohm"
    voltage_sensed: Literal["electrodes", "upstream of shunt"]
    output: OutputTable
    channels: dict[str, ChannelTable]
    thermometer: ThermometerTable | None = None
    four_probe: FourProbeTable | None = None
    virtual: VirtualTable = VirtualTable()
    chamber: ChamberTable | None = None
