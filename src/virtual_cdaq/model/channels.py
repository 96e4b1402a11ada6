"""A channel of a task: a physical channel with its range, its measurement and its units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from virtual_cdaq.model.converters import (
    RTD_CURVES,
    ZERO_CELSIUS,
    Codes,
    Floats,
    channel_key,
    choose_range,
    code_limits,
    decode,
    encode,
    noise,
    rtd_temperature,
    step,
)
from virtual_cdaq.model.errors import unsupported_value
from virtual_cdaq.model.modules import HIGH_RESOLUTION_NOISE, Module, Range
from virtual_cdaq.model.scales import Scale, find_scale

DEGREES_C, DEGREES_F, KELVINS, DEGREES_R = 10143, 10144, 10325, 10145  # DAQmx_Val_DegC, _DegF, _Kelvins, _DegR
VOLTS, OHMS, CUSTOM = 10348, 10384, 10065  # DAQmx_Val_Volts, _Ohms, _FromCustomScale
RTD_LIMITS = (0.0, 100.0)  # of a new channel, in its units
STOCK = 256  # samples of noise that are drawn at once
FARTHEST = 1_000_000  # samples between two of a slow module that one drawing bridges
HIGH_SPEED, HIGH_RESOLUTION, AUTOMATIC = 14712, 10195, 16097


@dataclass
class Channel:
    """One channel of one task.

    Parameters
    ----------
    name : str
        Its name in the task.
    physical : str
        Such as ``cDAQ1Mod1/ai0``.
    device : str
        The module it is on, such as ``cDAQ1Mod1``.
    module : Module
    measurement : {"voltage", "resistance", "rtd"}
    low, high : float
        Limits that were asked for, in the units of the channel.
    chosen : Range
        What the module was set to.
    units : int
        DAQmx number.
    terminal : int
        DAQmx number of the terminal configuration; 0 for an output.
    scale_name : str
        Of its custom scale.
    scales : mapping of str to Scale
        Those of the chassis.
    properties : dict
        Values that were set and that nothing here depends on.
    """

    name: str
    physical: str
    device: str
    module: Module
    measurement: Literal["voltage", "resistance", "rtd"]
    low: float
    high: float
    chosen: Range
    units: int
    terminal: int = 0
    rtd_type: int = 0
    r0: float = 100.0
    wires: int = 4
    timing_mode: int = AUTOMATIC
    scale_name: str = ""
    scales: Mapping[str, Scale] = field(default_factory=dict)
    properties: dict[str, Any] = field(default_factory=dict)

    def curve(self) -> tuple[float, float, float]:
        """Callendar-Van Dusen constants; those of a custom RTD may have been set."""
        a, b, c = RTD_CURVES[self.rtd_type]
        own = self.properties
        return (float(own.get("AI_RTD_A", a)), float(own.get("AI_RTD_B", b)), float(own.get("AI_RTD_C", c)))

    def scale(self, codes: Codes) -> Floats:
        """Codes of the converter in the units of the channel."""
        values = decode(self.module, self.chosen, codes)
        custom = self.custom
        if self.measurement == "rtd":
            celsius = rtd_temperature(values, self.r0, self.curve())
            values = _in_degrees(celsius, self.units if custom is None else custom.units_before)
        return values if custom is None else custom.forward(values)

    def unscale(self, values: Floats) -> Floats:
        """Values in the units of the channel as volts or ohms; not of an RTD."""
        custom = self.custom
        return values if custom is None else custom.reverse(values)

    @property
    def custom(self) -> Scale | None:
        """Its custom scale; None where it has units of its own."""
        return find_scale(self.scales, self.scale_name) if self.units == CUSTOM else None

    def fit(self, low: float, high: float) -> None:
        """Take limits in the units of the channel, and the smallest range of the module that holds them.

        Raises
        ------
        ChassisError
            -200077, none does.
        """
        if self.measurement != "rtd":
            least, most = sorted(self.unscale(np.array([low, high])).tolist())
            chosen = choose_range(self.module, least, most)
            if chosen is None:
                widest = self.module.ranges[-1]
                which, value = ("Max", high) if most > widest.high else ("Min", low)
                allowed = f"{widest.low:g} to {widest.high:g}\nChannel: {self.name}"
                raise unsupported_value(f"{self.module.kind.upper()}.{which}", value, allowed)
            self.chosen = chosen
        self.low, self.high = low, high

    def range_ends(self) -> tuple[float, float]:
        """What its range comes to in the units of the channel, the lower end first; not of an RTD."""
        return self._ends(self.chosen)

    def widest(self) -> tuple[float, float]:
        """The limits that it has by default, in its units."""
        return RTD_LIMITS if self.measurement == "rtd" else self._ends(self.module.ranges[-1])

    def _ends(self, chosen: Range) -> tuple[float, float]:
        ends = np.array([chosen.low, chosen.high])
        low, high = sorted((ends if self.custom is None else self.custom.forward(ends)).tolist())
        return low, high


def _in_degrees(celsius: Floats, units: int) -> Floats:
    if units == DEGREES_F:
        return celsius * 1.8 + 32.0
    if units == KELVINS:
        return celsius + ZERO_CELSIUS
    if units == DEGREES_R:
        return (celsius + ZERO_CELSIUS) * 1.8
    return celsius


class Converter:
    """One channel while it converts: its noise continues from sample to sample.

    Parameters
    ----------
    channel : Channel
    seed : int
        Of the chassis.
    acquisition : int
        How many acquisitions the physical channel has seen before.
    high_resolution : bool
        Of an NI 9217.
    sensor_noise : float [V, or ohm]
        Standard deviation of what the sensor at the terminal adds.
    """

    def __init__(
        self,
        channel: Channel,
        seed: int,
        acquisition: int,
        *,
        high_resolution: bool = False,
        sensor_noise: float = 0.0,
    ) -> None:
        self.channel = channel
        self._step = step(channel.module, channel.chosen)
        self._low, self._high = code_limits(channel.module)
        self._stock = np.empty(0)
        self._stock_begin = -1
        self._key = channel_key(seed, channel.physical, acquisition)
        chosen = channel.chosen
        self._noise = math.hypot(chosen.noise * (HIGH_RESOLUTION_NOISE if high_resolution else 1.0), sensor_noise)
        # The offset belongs to the channel and its range, whatever is done with them.
        offset_key = channel_key(seed, f"{channel.physical} offset {chosen.high}", 0)
        fraction = float(offset_key[0]) / 2.0**63 - 1.0
        self._offset = channel.module.offset * chosen.high * fraction

    def _draw(self, first: int, count: int) -> Floats:
        """The noise of some samples; single ones come from a stock: making a generator takes longer than a draw."""
        begin = first - first % STOCK
        if first + count > begin + STOCK:
            return noise(self._key, first, count)
        if begin != self._stock_begin:
            self._stock_begin, self._stock = begin, noise(self._key, begin, STOCK)
        return self._stock[first - begin : first - begin + count]

    def convert(self, values: Floats, first: int) -> Codes:
        """What the converter makes of the terminal's `values`, the samples from `first` on."""
        read = values + self._offset + self._noise * self._draw(first, values.size)
        return encode(self.channel.module, self.channel.chosen, read)

    def convert_at(self, values: Floats, samples: NDArray[np.int64]) -> Codes:
        """The same for samples with gaps between them, given their ascending numbers."""
        if not values.size:
            return np.empty(0, dtype=np.int32)
        first, last = int(samples[0]), int(samples[-1])
        if last - first > FARTHEST:
            each = [self.convert(values[k : k + 1], int(sample)) for k, sample in enumerate(samples)]
            return np.concatenate(each)
        read = values + self._offset + self._noise * self._draw(first, last - first + 1)[samples - first]
        return encode(self.channel.module, self.channel.chosen, read)

    def convert_one(self, value: float, sample: int) -> int:
        """The same for one sample, without the cost of an array."""
        read = (value + self._offset + self._noise * float(self._draw(sample, 1)[0])) / self._step
        return self._low if read <= self._low else self._high if read >= self._high else round(read)


def repeated(conversion: NDArray[np.int64], last: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Which samples start a new conversion of a slow module.

    Parameters
    ----------
    conversion : array of int, shape (n,)
        Number of the conversion that each sample belongs to, ascending.
    last : int
        Number of the conversion before.

    Returns
    -------
    owner : array of int, shape (n,)
        For every sample, how many of these samples up to and with it start a conversion.
    starts : array of bool, shape (n,)
    """
    starts = np.diff(conversion, prepend=last) != 0
    return np.cumsum(starts), starts
