"""A strip behind its sensors: what the inputs of a rig read while its output drives an actuator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ipmclab.rig.channels import Channel, Rig

if TYPE_CHECKING:
    from ipmclab.model import Actuator

FloatArray = npt.NDArray[np.float64]


class Plant:
    """An actuator in the clamp, from rest, in series with the shunt.

    Each row is read just before the output changes, as on the hardware: a row sees the voltage
    that was given since the row before it.

    Parameters
    ----------
    actuator : Actuator
    rig : Rig
    rate : float [Hz]
    seed : sequence of int
        Of the noise, of which each channel has its own.
    """

    def __init__(self, actuator: Actuator, rig: Rig, rate: float, seed: Sequence[int]) -> None:
        own = actuator["circuit.contact_resistance"]
        in_series = actuator.replace(**{"circuit.contact_resistance": own + rig.shunt_resistance})
        self._simulator = in_series.simulator(rate, "zero-before")
        self._rig = rig
        self._noise = {channel.name: np.random.default_rng([*seed, k]) for k, channel in enumerate(rig.channels)}

    def read(self, source: FloatArray) -> dict[str, FloatArray]:
        """What every channel reads.

        Parameters
        ----------
        source : float array, shape (n_time,) [V]
            The output since the row before each row.

        Returns
        -------
        readings : mapping of channel to float array, shape (n_time,) [V]
            As they come from the converters, unscaled.
        """
        current, _, displacement, force = self._simulator.block(source)
        drop = self._rig.shunt_resistance * current if self._rig.voltage_sensed == "electrodes" else 0.0
        values = {"voltage": source - drop, "current": current, "displacement": displacement, "force": force}
        return {channel.name: self._convert(channel, values[channel.name]) for channel in self._rig.channels}

    def _convert(self, channel: Channel, value: FloatArray) -> FloatArray:
        """Through the sensor and its converter."""
        # Drawn row by row, so that the noise does not depend on how the rows are cut into blocks.
        of_sensor, of_converter = self._noise[channel.name].standard_normal((len(value), 2)).T
        told = value + channel.rest
        low, high = channel.sensor_range or (-np.inf, np.inf)
        outside = (told < low) | (told > high)
        volts = channel.to_volts(np.clip(told, low, high) + channel.sensor_noise * of_sensor)
        if channel.lost is not None:
            volts = np.where(outside, channel.lost, volts)
        return channel.converter.convert(volts + channel.converter.noise * of_converter)
