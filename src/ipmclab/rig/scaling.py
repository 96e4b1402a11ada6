"""From what the converters read to quantities, with what is known of each reading."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.rig.channels import Channel
from ipmclab.run import QUALITY_FLAGS

FloatArray = npt.NDArray[np.float64]
FlagArray = npt.NDArray[np.uint8]

_LOST: Final = QUALITY_FLAGS["missing"] | QUALITY_FLAGS["sentinel"]


class Scaling:
    """Scales blocks of some channels.

    Parameters
    ----------
    channels : sequence of Channel
    zeros : mapping of channel to float [SI unit of the channel]
        What is subtracted: the reading at rest of the zeroed channels.
    contact_levels : mapping of channel to float [SI unit of the channel]
        A reading that is not above this, before zeroing, is that of a sensor which the tip does not touch.
    """

    def __init__(
        self,
        channels: Sequence[Channel],
        zeros: Mapping[str, float],
        contact_levels: Mapping[str, float] | None = None,
    ) -> None:
        self._channels = tuple(channels)
        self._zeros = dict(zeros)
        self._contact_levels = dict(contact_levels or {})

    def values(self, readings: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """The quantities [SI], NaN where the sensor had lost what it measures."""
        scaled = {}
        for channel in self._channels:
            volts = readings[channel.name]
            values = channel.gain * volts + (channel.offset - self._zeros.get(channel.name, 0.0))
            scaled[channel.name] = np.where(channel.is_lost(volts), np.nan, values)
        return scaled

    def flags(self, readings: Mapping[str, FloatArray]) -> dict[str, FlagArray]:
        """Bits of ``QUALITY_FLAGS``: missing, at the end of the converter, or without contact.

        A reading without contact stays as it was read; its flag keeps it from being taken for a force of zero.
        """
        found = {}
        for channel in self._channels:
            volts = readings[channel.name]
            bits = channel.is_lost(volts) * _LOST | channel.converter.at_limit(volts) * QUALITY_FLAGS["clipped"]
            level = self._contact_levels.get(channel.name)
            if level is not None:
                scaled = channel.gain * volts + channel.offset
                bits = bits | (scaled <= level) * QUALITY_FLAGS["contact_lost"]
            found[channel.name] = bits.astype(np.uint8)
        return found

    @property
    def calibrations(self) -> dict[str, str]:
        """The scaling of each channel as text."""
        return {one.name: one.calibration(self._zeros.get(one.name, 0.0)) for one in self._channels}

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """What each channel can read after zeroing [SI]."""
        found = {}
        for channel in self._channels:
            zero = self._zeros.get(channel.name, 0.0)
            found[channel.name] = (channel.range[0] - zero, channel.range[1] - zero)
        return found
