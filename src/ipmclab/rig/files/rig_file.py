"""Rig files: TOML, quantities as texts with their unit, refused where a rig cannot be as they say."""

from __future__ import annotations

import datetime
import math
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ipmclab.errors import InputError, suggest, unknown_name
from ipmclab.rig.channels import Channel, Converter, FourProbe, Output, Rig, Thermometer, VirtualStrip
from ipmclab.rig.files.chamber import chamber_settings
from ipmclab.rig.files.wiring import check_wiring
from ipmclab.toml_file import parse_table, read_text
from ipmclab.units import (
    CHANNELS,
    CURRENT,
    FORCE,
    LENGTH,
    RELATIVE_HUMIDITY,
    RESISTANCE,
    TEMPERATURE,
    VOLTAGE,
    Quantity,
    parse_quantity,
)

if TYPE_CHECKING:
    from ipmclab.rig.files.tables import ChannelTable, OutputTable, RigTable, TextPair, VirtualTable

_LIBRARY: Final = resources.files("ipmclab.rig.files") / "library"
_ALIASES: Final = {"virtual": "thesis"}
"""``rig = "virtual"`` is the rig that needs nothing."""

NI_9205_NOISE: Final = {0.2: 10e-6, 1.0: 26e-6, 5.0: 116e-6, 10.0: 240e-6}
"""Ranges of the NI 9205 [V], each to both sides, and the noise in them by its data sheet [V]."""

RIG_CHANNELS: Final = ("voltage", "current", "displacement", "force", "relative_humidity")
"""What a channel of a rig may measure; the temperature comes from the thermometer."""

_MOST_SERIES: Final = 1000.0  # [ohm]: a shunt or a source beyond it leaves no voltage for a strip of some 10 ohm
_CHAMBER: Final = (-40.0, 150.0)  # [degC]


def library_rigs() -> list[str]:
    """Names of the rigs that come with ipmclab.

    Examples
    --------
    >>> library_rigs()
    ['thesis', 'virtual']
    """
    stored = [entry.name.removesuffix(".toml") for entry in _LIBRARY.iterdir() if entry.name.endswith(".toml")]
    return sorted([*stored, *_ALIASES])


def load_rig(name_or_path: str | Path) -> Rig:
    """Read a rig from the library or from a TOML file.

    Parameters
    ----------
    name_or_path : str or Path
        A library name (``"thesis"``; ``"virtual"`` is the same), or the path of a file.

    Raises
    ------
    InputError
        No such rig, no TOML, an unknown or missing key, a wrong unit, a rig that cannot be.

    Examples
    --------
    >>> rig = load_rig("thesis")
    >>> rig["displacement"].sensor_range
    (0.0, 0.025)
    """
    if isinstance(name_or_path, str) and name_or_path in library_rigs():
        name = _ALIASES.get(name_or_path, name_or_path)
        return rig_from_text((_LIBRARY / f"{name}.toml").read_text(encoding="utf-8"), where=name)
    path = Path(name_or_path)
    missing = InputError(
        f"there is no rig {str(name_or_path)!r}, neither in the library nor as a file",
        code="no-rig",
        where="rig",
        repair=suggest(str(name_or_path), library_rigs()),
    )
    return rig_from_text(read_text(path, kind="a rig file", missing=missing), where=str(path), folder=path.parent)


def rig_from_text(text: str, *, where: str = "rig", folder: Path | None = None) -> Rig:
    """Read a rig from the text of its TOML file.

    Parameters
    ----------
    text : str
    where : str
        What the messages name: the file.
    folder : Path, optional
        Where the path of a virtual strip's actuator file starts.

    Raises
    ------
    InputError
    """
    from ipmclab.rig.files.tables import RigTable
    from ipmclab.store.strict import validated

    document = parse_table(text, where=where, repair="compare with the page on rigs")
    _check_channel_names(document.get("channels"), where)
    table = validated(RigTable, document, where=where)
    rig = _rig(table, _Place(f"{where}: "), folder)
    check_wiring(rig, where=where)
    return rig


class _Place(str):
    """Where in the file something is: ``place / "range"`` is the key below."""

    def __truediv__(self, key: object) -> _Place:
        return _Place(f"{self}{'' if self.endswith(': ') else '.'}{key}")

    def refuse(self, message: str, repair: str, code: str = "out-of-range") -> InputError:
        return InputError(message, code=code, where=str(self), repair=repair)


def _check_channel_names(channels: Any, where: str) -> None:
    for name in channels if isinstance(channels, dict) else ():
        if name == "temperature":
            raise InputError(
                "the temperature is no channel here",
                code="unknown-channel",
                where=f"{where}: channels.temperature",
                repair="describe its resistance thermometer in [thermometer]",
            )
        if name not in RIG_CHANNELS:
            raise unknown_name("channel", name, RIG_CHANNELS, where=f"{where}: channels.{name}")


def _rig(table: RigTable, place: _Place, folder: Path | None) -> Rig:
    if not table.name.strip():
        raise (place / "name").refuse("the rig has no name", 'write name = "bench 1"', "missing-key")
    if "voltage" not in table.channels:
        raise (place / "channels.voltage").refuse(
            "this table is missing: every run needs its voltage", "wire it to an input and describe it", "missing-key"
        )
    low, high = _range(table.output.range, VOLTAGE, place / "output.range")
    if not (-10.0 <= low <= 0.0 <= high <= 10.0):
        raise (place / "output.range").refuse(
            f"{low:g} V to {high:g} V is not within -10 V to 10 V, or does not hold 0 V",
            "give what the output gives: an NI 9263 gives -10 V to 10 V",
        )
    probe, meter = table.four_probe, table.thermometer
    return Rig(
        name=table.name,
        channels=tuple(_channel(name, one, place / f"channels.{name}") for name, one in table.channels.items()),
        shunt_resistance=_series(table.shunt_resistance, place / "shunt_resistance"),
        source_resistance=_series(table.source_resistance, place / "source_resistance"),
        voltage_sensed=table.voltage_sensed,
        output=_output(table.output, low, high, place / "output"),
        thermometer=None
        if meter is None
        else Thermometer(
            meter.physical.removeprefix("/"),
            _positive(meter.resistance, RESISTANCE, place / "thermometer.resistance"),
            meter.wires,
            _positive(meter.current, CURRENT, place / "thermometer.current"),
        ),
        four_probe=None
        if probe is None
        else FourProbe(
            probe.physical.removeprefix("/"),
            _positive(probe.spacing, LENGTH, place / "four_probe.spacing"),
            _positive(probe.current, CURRENT, place / "four_probe.current"),
            probe.contacts,
            _not_negative(probe.offset, RESISTANCE, place / "four_probe.offset"),
        ),
        bench=table.bench,
        address=_address(table, place / "address"),
        virtual=_virtual(table.virtual, place / "virtual", folder),
        chamber=None if table.chamber is None else chamber_settings(table.chamber, str(place / "chamber"), folder),
    )


def _output(table: OutputTable, low: float, high: float, place: _Place) -> Output:
    most = table.current_limit
    limit = None if most is None else _positive(most, CURRENT, place / "current_limit")
    return Output(low, high, table.physical.removeprefix("/"), table.amplifier, limit)


def _channel(name: str, table: ChannelTable, place: _Place) -> Channel:
    quantity = CHANNELS[name]
    low, high = _range(table.range, VOLTAGE, place / "range")
    if low != -high or high not in NI_9205_NOISE:
        fitting = next((one for one in NI_9205_NOISE if one >= max(abs(low), abs(high))), None)
        raise (place / "range").refuse(
            f"{low:g} V to {high:g} V is not a range of the NI 9205, which has "
            + ", ".join(f"±{one:g} V" for one in NI_9205_NOISE),
            "bring the signal within 10 V" if fitting is None else f'write ["-{fitting:g} V", "{fitting:g} V"]',
        )
    noise = NI_9205_NOISE[high] if table.noise is None else _not_negative(table.noise, VOLTAGE, place / "noise")
    gain, offset = _scale(name, table, quantity, place / "scale")
    sensor = None if table.sensor_range is None else _range(table.sensor_range, quantity, place / "sensor_range")
    channel = Channel(
        name,
        Converter(low, high, noise),
        gain=gain,
        offset=offset,
        sensor_range=sensor,
        sensor_noise=_difference(table.sensor_noise, quantity, place / "sensor_noise"),
        rest=0.0 if table.rest is None else parse_quantity(table.rest, quantity, where=place / "rest"),
        lost=None if table.lost is None else parse_quantity(table.lost, VOLTAGE, where=place / "lost"),
        zeroed=table.zeroed,
        physical=table.physical.removeprefix("/"),
        terminal=table.terminal,
        calibrated=_date(table.calibrated, place / "calibrated"),
        uncertainty=_difference(table.uncertainty, quantity, place / "uncertainty"),
        instrument=table.instrument,
        interface=table.interface,
        sensor_resolution=_difference(table.sensor_resolution, quantity, place / "sensor_resolution"),
    )
    if sensor is not None:
        _check_sensor(channel, sensor, place)
    elif channel.lost is not None:
        raise (place / "lost").refuse(
            "the reading of a lost target needs the range of the sensor", "add sensor_range", "missing-key"
        )
    return channel


def _check_sensor(channel: Channel, sensor: tuple[float, float], place: _Place) -> None:
    ends = sorted((end - channel.offset) / channel.gain for end in sensor)
    low, high, lost = channel.converter.low, channel.converter.high, channel.lost
    if ends[1] <= low or ends[0] >= high:
        raise (place / "sensor_range").refuse(
            f"the sensor gives {ends[0]:g} V to {ends[1]:g} V, the range is {low:g} V to {high:g} V",
            "correct the range, the scale or the sensor's range",
        )
    if lost is not None and not low <= lost <= high:
        raise (place / "lost").refuse(
            f"{lost:g} V is beyond the range {low:g} V to {high:g} V",
            "give the reading of the sensor when nothing is in its range",
        )
    if lost is not None and ends[0] <= lost <= ends[1]:
        raise (place / "lost").refuse(
            f"{lost:g} V is a reading: the sensor gives {ends[0]:g} V to {ends[1]:g} V",
            "give the reading of the sensor when nothing is in its range, outside these",
        )


def _scale(name: str, table: ChannelTable, quantity: Quantity, place: _Place) -> tuple[float, float]:
    """Gain and offset from two points."""
    if table.scale is None:
        if name == "voltage":
            return 1.0, 0.0
        unit = quantity.display_unit
        raise place.refuse(
            "this key is missing", f'add scale = [["0 V", "0 {unit}"], ["1 V", "... {unit}"]]', "missing-key"
        )
    points = [
        (
            parse_quantity(volts, VOLTAGE, where=place / f"{index}.0"),
            parse_quantity(value, quantity, where=place / f"{index}.1"),
        )
        for index, (volts, value) in enumerate(table.scale)
    ]
    (v0, q0), (v1, q1) = points
    if v0 == v1 or q0 == q1:
        same = f"{v0:g} V" if v0 == v1 else f"{q0:g} {quantity.unit}"
        raise place.refuse(f"both points are at {same}, they give no line", "give two different points")
    gain = (q1 - q0) / (v1 - v0)
    offset = q0 - gain * v0
    if not (math.isfinite(gain) and gain and math.isfinite(offset)):
        raise place.refuse("these points give no line that can be computed with", "correct their numbers")
    return gain, offset


def _address(table: RigTable, place: _Place) -> str | None:
    if table.address is None:
        return None
    host, _, port = table.address.rpartition(":")
    if not host or not (port.isascii() and port.isdigit() and 0 < int(port) < 65536):
        raise place.refuse(f"{table.address!r} is not HOST:PORT", 'write for example "127.0.0.1:31763"', "bad-value")
    if table.bench == "virtual":
        raise place.refuse(
            "a virtual bench has no address", 'write bench = "ni", or take the address out', "needless-key"
        )
    return table.address


def _virtual(table: VirtualTable, place: _Place, folder: Path | None) -> VirtualStrip:
    from ipmclab.model.actuator_file import is_library_name

    actuator = table.actuator
    if folder is not None and not is_library_name(actuator):
        actuator = str(folder / actuator)
    return VirtualStrip(
        actuator=actuator,
        seed=table.seed,
        temperature=_within(table.temperature, TEMPERATURE, _CHAMBER, place / "temperature"),
        relative_humidity=_within(
            table.relative_humidity, RELATIVE_HUMIDITY, (0.0, 100.0), place / "relative_humidity"
        ),
        hydrated=table.hydrated,
        load=table.load,
        preload_drift=_within(table.preload_drift, FORCE, (-0.1, 0.1), place / "preload_drift"),
        meter_offset=_within(table.meter_offset, RESISTANCE, (-1.0, 1.0), place / "meter_offset"),
    )


def _range(pair: TextPair, quantity: Quantity, place: _Place) -> tuple[float, float]:
    low, high = (parse_quantity(text, quantity, where=place / index) for index, text in enumerate(pair))
    if not low < high:
        raise place.refuse(f"it goes from {pair[0]!r} to {pair[1]!r}", "write the lower end first")
    return low, high


def _within(text: str, quantity: Quantity, limits: tuple[float, float], place: _Place) -> float:
    value = parse_quantity(text, quantity, where=place)
    low, high = limits
    if not low <= value <= high:
        raise place.refuse(
            f"{text!r} is not within {low:g} {quantity.unit} to {high:g} {quantity.unit}", "give a value within"
        )
    return value


def _positive(text: str, quantity: Quantity, place: _Place) -> float:
    value = parse_quantity(text, quantity, where=place)
    if not value > 0:
        raise place.refuse(f"{text!r} is not above 0", "give the measured value")
    return value


def _not_negative(text: str, quantity: Quantity, place: _Place) -> float:
    value = parse_quantity(text, quantity, where=place)
    if value < 0:
        raise place.refuse(f"{text!r} is below 0", "give 0 or more")
    return value


def _difference(text: str | None, quantity: Quantity, place: _Place) -> float:
    return 0.0 if text is None else _not_negative(text, quantity, place)


def _series(text: str, place: _Place) -> float:
    value = _not_negative(text, RESISTANCE, place)
    if value > _MOST_SERIES:
        raise place.refuse(
            f"{text!r} in series leaves no voltage for a strip, at most {_MOST_SERIES:g} ohm", "correct it"
        )
    return value


def _date(given: str | datetime.date | None, place: _Place) -> str | None:
    if given is None:
        return None
    try:
        date = datetime.date.fromisoformat(given) if isinstance(given, str) else given
    except ValueError:
        raise place.refuse(f"{given!r} is not a date", 'write it as "2026-10-31"', "bad-value") from None
    if isinstance(date, datetime.datetime):
        date = date.date()
    if date > datetime.date.today() + datetime.timedelta(days=1):  # a day, for a file from another time zone
        raise place.refuse(f"{date.isoformat()} is in the future", "give the date of the last calibration")
    return date.isoformat()
