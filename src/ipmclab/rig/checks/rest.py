"""What the channels of a rig should read while its output gives 0 V."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.rig.channels import Channel, Rig
from ipmclab.rig.checks.ranges import FILL
from ipmclab.run import Finding

FloatArray = npt.NDArray[np.float64]

_OFFSET: Final = 0.005
"""Of the range: a reading at 0 V beyond it is no offset of a converter (the NI 9205 stays within 0.1 %)."""

_LEAST_PRELOAD: Final = 1e-3
"""[N]: below it the tip leaves the load cell, whose noise is 0.1 mN, with the first reversal."""

_MIDDLE: Final = (0.25, 0.75)
_NOISY: Final = 5.0
_AIR_TEMPERATURE: Final = (-30.0, 110.0)  # of the air in a laboratory's chamber [degC]
_AIR_HUMIDITY: Final = (2.0, 98.0)  # [percent]: a transmitter without supply gives 0 V


def at_rest(channel: Channel, volts: FloatArray) -> Iterator[Finding]:
    """What a channel should read while nothing is given out."""
    mean = channel.to_quantity(float(volts.mean()))
    quantity = channel.quantity

    def shown(value: float) -> str:
        return f"{quantity.to_display(value):.3g} {quantity.display_unit}"

    lost = bool(channel.is_lost(volts).any())
    if lost:
        yield Finding(
            "nothing-seen",
            "error",
            f"the sensor gives {volts.mean():.3g} V, which means that nothing is in its range",
            "bring the strip into its range, and see that nothing is in between",
            channel.name,
        )
    elif channel.converter.at_limit(volts).any():
        yield Finding(
            "at-limit",
            "error",
            f"it reads {volts.mean():.3g} V, the end of its range",
            "look for a broken wire or a missing supply; else take a larger range",
            channel.name,
        )
    noise = math.hypot(
        channel.converter.noise, channel.sensor_noise / abs(channel.gain), channel.converter.step / math.sqrt(12.0)
    )
    if volts.std() > _NOISY * noise and not lost:
        yield Finding(
            "noisy",
            "warning",
            f"its noise is {shown(abs(channel.gain) * float(volts.std()))}, "
            f"data sheets let expect {shown(abs(channel.gain) * noise)}",
            "look for a loose wire, a missing ground, or a shield that is not connected",
            channel.name,
            values={"noise": abs(channel.gain) * float(volts.std())},
        )
    if channel.name == "current" and abs(float(volts.mean())) > _OFFSET * channel.converter.high:
        yield Finding(
            "current-offset",
            "warning",
            f"at 0 V it reads {shown(mean)}",
            "let the strip discharge and check again; else look at the amplifier's offset and the shunt's wiring",
            channel.name,
            values={"reading": mean},
        )
    if channel.name == "force" and not lost:
        yield from _preload(channel, mean, shown(mean))
    if channel.name == "relative_humidity":
        yield from _humidity(channel, mean)
    if channel.name == "displacement" and not lost and channel.sensor_range is not None:
        low, high = channel.sensor_range
        place = (mean - low) / (high - low)
        if not _MIDDLE[0] <= place <= _MIDDLE[1]:
            yield Finding(
                "not-in-the-middle",
                "warning",
                f"the strip rests at {shown(mean)} of {shown(low)} to {shown(high)}",
                f"move the laser until it reads about {shown((low + high) / 2)}",
                channel.name,
                values={"reading": mean},
            )


def _preload(channel: Channel, mean: float, shown: str) -> Iterator[Finding]:
    most = math.inf if channel.sensor_range is None else channel.sensor_range[1]
    if mean < _LEAST_PRELOAD:
        yield Finding(
            "no-preload",
            "warning",
            f"the load cell reads {shown}, the tip does not lie on it",
            "move the cell against the tip until it reads some 4 to 5 mN; for runs of displacement it is right so",
            channel.name,
            values={"reading": mean},
        )
    elif mean > FILL * most:
        yield Finding(
            "large-preload",
            "warning",
            f"the load cell reads {shown} already, more than {100 * FILL:.0f} % of its range",
            "move it back until it reads some 4 to 5 mN",
            channel.name,
            values={"reading": mean},
        )


def temperature_findings(rig: Rig, temperature: float | None, *, was_read: bool) -> Iterator[Finding]:
    """Whether the thermometer reads what the air of a chamber can be [degC]."""
    if rig.thermometer is None or not was_read:
        return
    low, high = _AIR_TEMPERATURE
    if temperature is None:
        yield Finding(
            "no-temperature",
            "warning",
            "the thermometer was not read",
            "look at its wires and at the module's name",
            "temperature",
        )
    elif not low <= temperature <= high:
        yield Finding(
            "implausible-temperature",
            "error",
            f"the thermometer reads {temperature:.3g} degC",
            "look for an open or a shorted wire, and at the thermometer's resistance at 0 degC",
            "temperature",
            values={"temperature": temperature},
        )


def _humidity(channel: Channel, mean: float) -> Iterator[Finding]:
    low, high = _AIR_HUMIDITY
    if not low <= mean <= high:
        yield Finding(
            "implausible-humidity",
            "warning",
            f"the humidity transmitter reads {mean:.3g} percent",
            "see that it has its supply and that its scale is right",
            channel.name,
            values={"reading": mean},
        )
