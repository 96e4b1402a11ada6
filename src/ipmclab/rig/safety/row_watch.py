"""The limits, watched with rows that are read one by one."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from ipmclab.rig.channels import Rig
from ipmclab.rig.safety.guard import Alarm, Guard
from ipmclab.rig.safety.limits import Limits
from ipmclab.rig.scaling import Scaling


class RowWatch:
    """Scales single rows of readings, and holds them against limits.

    Parameters
    ----------
    limits : Limits
    rate : float [Hz]
        Of the rows.
    rig : Rig
    names : collection of str
        The channels of each row, ``"voltage"`` among them.
    """

    def __init__(self, limits: Limits, rate: float, rig: Rig, names: Collection[str]) -> None:
        self._guard = Guard(limits, rate, rig)
        self._channels = [rig[name] for name in names]
        self._scaling = Scaling(self._channels, {})
        self._next = 0

    def subtract(self, zeros: Mapping[str, float]) -> None:
        """Subtract what the channels read at rest [SI unit of each]."""
        self._scaling = Scaling(self._channels, zeros)

    def zeroed(self) -> None:
        """The output was brought to 0 V: from now on only that it gets there is watched."""
        self._guard.zeroed(self._next - 1)

    def look(self, readings: Mapping[str, float], row: int | None = None) -> tuple[Alarm, ...]:
        """Hold a row against the limits.

        Parameters
        ----------
        readings : mapping of channel to float [V]
            As they come from the converters.
        row : int, optional
            The one after the last where it is left out; rows between them were missed.
        """
        first = self._next if row is None else row
        values = self._scaling.values({name: np.array([volts]) for name, volts in readings.items()})
        alarms = self._guard.look(first, values)
        self._next = first + 1
        return alarms
