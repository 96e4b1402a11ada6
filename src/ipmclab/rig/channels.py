"""Channels of a rig as data: converter, sensor, and the scaling between volts and quantity.

The default rig is that of chapter 3 of Friend's thesis: an NI 9205 (16 bit) that reads a shunt of
1 ohm, a laser displacement sensor (optoNCDT 1420-25, 4 to 20 mA over 500 ohm for 25 mm), and a
load cell (GSO-10) whose amplifier gives 10 V for 10 gf. An NI 9263 with a current amplifier
drives the strip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from ipmclab.model.four_probe import Contacts, sheet_factor
from ipmclab.rig.chambers.settings import ChamberSettings
from ipmclab.units import CHANNELS, Quantity

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Converter:
    """An analogue input: its range, resolution and noise.

    Parameters
    ----------
    low, high : float [V]
        The codes go from ``low`` to one step below ``high``.
    bits : int
    noise : float [V]
        Standard deviation of what it adds.

    Examples
    --------
    >>> converter = Converter(-5.0, 5.0, noise=0.0)
    >>> converter.convert([0.0001, 7.0]).tolist()
    [0.000152587890625, 4.999847412109375]
    """

    low: float
    high: float
    noise: float
    bits: int = 16

    @property
    def step(self) -> float:
        """The least significant bit [V]."""
        return (self.high - self.low) / float(2**self.bits)

    @property
    def top(self) -> float:
        """The largest reading [V]."""
        return self.high - self.step

    def convert(self, volts: npt.ArrayLike) -> FloatArray:
        """The reading for each voltage: the nearest step within the range."""
        step = self.step
        codes = np.rint(np.asarray(volts, dtype=np.float64) / step)
        readings: FloatArray = (codes * step).clip(self.low, self.top)
        return readings

    def at_limit(self, readings: FloatArray) -> npt.NDArray[np.bool_]:
        """Which readings are the lowest or the highest that there is."""
        return (readings <= self.low) | (readings >= self.top)


Terminal = Literal["differential", "single-ended", "non-referenced"]
"""How an input is wired: RSE and NRSE are the makers' words for the last two."""


@dataclass(frozen=True)
class Channel:
    """A channel of a rig: ``quantity = gain * volts + offset``.

    Parameters
    ----------
    name : str
        A channel of a run.
    converter : Converter
    gain : float [SI unit of the channel per V]
    offset : float [SI unit of the channel]
        What 0 V means.
    sensor_range : (low, high) [SI unit of the channel], optional
        What the sensor can read, before zeroing.
    sensor_noise : float [SI unit of the channel]
        Standard deviation of what the sensor adds, before the converter.
    rest : float [SI unit of the channel]
        What the sensor reads while the strip rests: the distance of the laser, the preload of the load cell.
    lost : float [V], optional
        What the sensor gives when it has lost what it measures: beyond what it gives within its range.
    zeroed : bool
        Whether the reading at rest is subtracted.
    physical : str
        The input that it is wired to, such as ``"cDAQ1Mod1/ai0"``; empty where there is no hardware.
    terminal : "differential", "single-ended" or "non-referenced"
    calibrated : str, optional
        ISO date of the calibration.
    uncertainty : float [SI unit of the channel]
        Standard uncertainty of the calibration; 0 where none is stated.
    instrument : str
        The sensor by its maker's name.
    interface : str
        How a computer reaches its settings, such as ``"RS-485"``; its readings come by the input.
    sensor_resolution : float [SI unit of the channel]
        The smallest change that the sensor shows, by its data sheet.
    """

    name: str
    converter: Converter
    gain: float = 1.0
    offset: float = 0.0
    sensor_range: tuple[float, float] | None = None
    sensor_noise: float = 0.0
    rest: float = 0.0
    lost: float | None = None
    zeroed: bool = False
    physical: str = ""
    terminal: Terminal = "differential"
    calibrated: str | None = None
    uncertainty: float = 0.0
    instrument: str = ""
    interface: str = ""
    sensor_resolution: float = 0.0

    @property
    def quantity(self) -> Quantity:
        """What the channel measures."""
        return CHANNELS[self.name]

    @property
    def resolution(self) -> float:
        """The smallest change that is read [SI]: a step of the converter, or of the sensor where that is larger."""
        return max(abs(self.gain) * self.converter.step, self.sensor_resolution)

    @property
    def range(self) -> tuple[float, float]:
        """What the channel can read, before zeroing [SI]: the sensor's range within the converter's."""
        low, high = sorted((self.to_quantity(self.converter.low), self.to_quantity(self.converter.top)))
        if self.sensor_range is None:
            return low, high
        return max(low, self.sensor_range[0]), min(high, self.sensor_range[1])

    def to_quantity(self, volts: float) -> float:
        """A reading [V] in the unit of the channel."""
        return self.gain * volts + self.offset

    def to_volts(self, value: FloatArray) -> FloatArray:
        """What the sensor gives out [V] for values in the unit of the channel."""
        return (value - self.offset) / self.gain

    def is_lost(self, readings: FloatArray) -> npt.NDArray[np.bool_]:
        """Which readings [V] are no readings: nearer to ``lost`` than to the range of the sensor."""
        if self.lost is None or self.sensor_range is None:
            return np.zeros(len(readings), dtype=np.bool_)
        low, high = sorted((end - self.offset) / self.gain for end in self.sensor_range)
        if self.lost < low:
            return readings < (self.lost + low) / 2
        return readings > (self.lost + high) / 2

    def calibration(self, zero: float) -> str:
        """The scaling as text, with what was subtracted as zero."""
        unit = self.quantity.unit
        text = f"raw [V] x {self.gain:.12g} {unit}/V"
        if self.offset:
            text += f" {'+' if self.offset > 0 else '-'} {abs(self.offset):.12g} {unit}"
        return f"{text}, zeroed at {zero:.12g} {unit}" if self.zeroed else text


@dataclass(frozen=True)
class Output:
    """The analogue output that drives the strip.

    Parameters
    ----------
    low, high : float [V]
        What it can give.
    physical : str
        The output, such as ``"cDAQ1Mod2/ao0"``; empty where there is no hardware.
    amplifier : str
        What is between the output and the strip.
    current_limit : float [A], optional
        What it can deliver.
    """

    low: float
    high: float
    physical: str = ""
    amplifier: str = ""
    current_limit: float | None = None


@dataclass(frozen=True)
class Thermometer:
    """A resistance thermometer in the air around the strip, read slowly in addition to the other channels.

    Parameters
    ----------
    physical : str
        The input, such as ``"cDAQ1Mod3/ai1"``.
    resistance : float [ohm]
        At 0 degC.
    wires : 3 or 4
    current : float [A]
        What the module drives through it: 1 mA for the NI 9217.
    """

    physical: str = ""
    resistance: float = 100.0
    wires: Literal[3, 4] = 4
    current: float = 1e-3


@dataclass(frozen=True)
class FourProbe:
    """Four contacts on the strip that measure the resistance of its surface (thesis, section 3.2).

    The outer two carry a small constant current, the inner two read the voltage between them.

    Parameters
    ----------
    physical : str
        The input, such as ``"cDAQ1Mod3/ai0"``.
    spacing : float [m]
        Between the inner contacts; points are all as far from each other.
    current : float [A]
        1 mA for the NI 9217.
    contacts : "line" or "points"
        Across the whole width of the strip, or four points along its middle.
    offset : float [ohm]
        By how much the meter may read wrong everywhere.
    """

    physical: str = ""
    spacing: float = 10e-3
    current: float = 1e-3
    contacts: Contacts = "line"
    offset: float = 0.05

    def sheet_resistance(self, resistance: float, width: float, length: float = math.inf) -> float:
        """The resistance of a square [ohm/sq], from that between the inner contacts [ohm] and the strip's size [m].

        Examples
        --------
        >>> FourProbe(spacing=10e-3).sheet_resistance(2.6, width=5e-3)
        1.3
        """
        return resistance * sheet_factor(self.contacts, self.spacing, width, length)


@dataclass(frozen=True)
class VirtualStrip:
    """What is behind the terminals of a rig that exists only as a model, and the air around it.

    Parameters
    ----------
    actuator : str
        The strip in the clamp: a library name or the path of an actuator file.
    seed : int
        Of the noise: the same seed gives the same readings.
    temperature : float [degC], relative_humidity : float [percent]
        Of the air, at first.
    hydrated : bool
        Whether a strip with a table ``[hydration]`` has just been taken out of its water, and dries; otherwise it is in
        equilibrium with the air.
    load : "strip" or "dummy"
        ``dummy`` is the load of ``rig prove``: 10 ohm and 100 mF in series, no strip.
    preload_drift : float [N]
        By how much the preload of the load cell falls, with a time constant of 10 min.
    meter_offset : float [ohm]
        What the meter of the four-probe contacts reads too much.
    """

    actuator: str = "friend-2"
    seed: int = 20261121
    temperature: float = 22.0
    relative_humidity: float = 45.0
    hydrated: bool = False
    load: Literal["strip", "dummy"] = "strip"
    preload_drift: float = 0.0
    meter_offset: float = 0.0


@dataclass(frozen=True)
class Rig:
    """What reads and drives a strip.

    Parameters
    ----------
    name : str
    channels : tuple of Channel
        ``voltage`` is one of them.
    shunt_resistance : float [ohm]
        In series with the strip: it takes its share of the output voltage.
    voltage_sensed : "electrodes" or "upstream of shunt"
        Where the channel ``voltage`` is connected.
    output : Output
    source_resistance : float [ohm]
        Of the amplifier that drives the strip, in series with it.
    thermometer : Thermometer, optional
    four_probe : FourProbe, optional
    bench : "virtual" or "ni"
        What is behind the channels.
    address : str, optional
        ``host:port`` of a chassis behind a gRPC server; None for the driver of this computer.
    virtual : VirtualStrip
        What a virtual bench, and the stand-in chassis, put behind the channels.
    chamber : ChamberSettings, optional
        The chamber around the strip, where a program can set it.
    """

    name: str
    channels: tuple[Channel, ...]
    shunt_resistance: float
    voltage_sensed: Literal["electrodes", "upstream of shunt"]
    output: Output
    source_resistance: float = 0.0
    thermometer: Thermometer | None = None
    four_probe: FourProbe | None = None
    bench: Literal["virtual", "ni"] = "virtual"
    address: str | None = None
    virtual: VirtualStrip = VirtualStrip()
    chamber: ChamberSettings | None = None

    def __getitem__(self, name: str) -> Channel:
        """The channel of that name."""
        return {channel.name: channel for channel in self.channels}[name]


# Noise of the NI 9205 by its data sheet: 240, 116, 26 and 10 uV in its ranges 10, 5, 1 and 0.2 V.
_GRAM_FORCE: Final = 9.80665e-3
_SHUNT: Final = 1.0

THESIS_RIG: Final = Rig(
    name="rig of Friend's thesis, chapter 3",
    channels=(
        Channel("voltage", Converter(-5.0, 5.0, noise=116e-6), physical="cDAQ1Mod1/ai3"),
        Channel("current", Converter(-0.2, 0.2, noise=10e-6), gain=1.0 / _SHUNT, physical="cDAQ1Mod1/ai0"),
        Channel(
            "displacement",
            Converter(-10.0, 10.0, noise=240e-6),
            # 4 to 20 mA over 500 ohm, 2 to 10 V, for 25 mm.
            gain=25e-3 / 8.0,
            offset=-25e-3 / 4.0,
            sensor_range=(0.0, 25e-3),
            rest=12.3e-3,  # appendix A.2; the middle of the range is 12.5 mm
            lost=1.5,  # 3 mA, an error value of this maker's sensors; below 4 mA in all of them
            zeroed=True,
            physical="cDAQ1Mod1/ai1",
            instrument="optoNCDT 1420-25",
            interface="RS-485",
            sensor_resolution=1.25e-6,
        ),
        Channel(
            "force",
            Converter(-10.0, 10.0, noise=240e-6),
            gain=_GRAM_FORCE,
            # It can only be pushed.
            sensor_range=(0.0, 10 * _GRAM_FORCE),
            sensor_noise=0.1e-3,
            # What appendix A.2 subtracts, which counts 100 mN for 10 V: preload and zero of the cell together.
            rest=4.48e-3,
            zeroed=True,
            physical="cDAQ1Mod1/ai2",
            instrument="GSO-10 with LCA-RTC",
        ),
        Channel(
            "relative_humidity",
            Converter(-10.0, 10.0, noise=240e-6),
            gain=10.0,
            sensor_range=(0.0, 100.0),
            physical="cDAQ1Mod1/ai4",
        ),
    ),
    shunt_resistance=_SHUNT,
    voltage_sensed="upstream of shunt",
    # The module alone gives 1 mA.
    output=Output(-10.0, 10.0, physical="cDAQ1Mod2/ao0", amplifier="current amplifier", current_limit=0.3),
    thermometer=Thermometer("cDAQ1Mod3/ai1"),
    four_probe=FourProbe("cDAQ1Mod3/ai0"),
)
"""The rig of chapter 3 of Friend's thesis; the humidity transmitter and the thermometer in its chamber are ours.

The thesis does not say on which side of the shunt the voltage was read. Upstream, it is held between
rows, so that a record says exactly what the strip and its shunt were given; at the electrodes it
sags between rows as the current decays.
"""
