"""A signal that cannot leave its limits: every value is held within them when it is given out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ipmclab.signals import Signal
from ipmclab.signals.signal import EDGE

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Clamped(Signal):
    """A signal that cannot leave its limits, and ends at 0 V.

    Parameters
    ----------
    signal : Signal
    most : float [V]
        Largest magnitude; what is no number becomes 0 V.
    end : float [s]
        From here on it is 0 V.

    Examples
    --------
    >>> from ipmclab.signals import Step
    >>> Clamped(Step(35.0), most=3.5, end=2.0).voltage([0.0, 1.0, 2.0]).tolist()
    [3.5, 3.5, 0.0]
    """

    signal: Signal
    most: float
    end: float = math.inf

    def __post_init__(self) -> None:
        """Nothing to check: its numbers are no parameters of a signal."""

    def voltage(self, time: npt.ArrayLike) -> FloatArray:
        """The voltage at each time: see ``Signal.voltage``."""
        times = np.asarray(time, dtype=np.float64)
        wanted = np.nan_to_num(self.signal.voltage(times), nan=0.0)
        return np.where(times < self.end - EDGE, np.clip(wanted, -self.most, self.most), 0.0)

    def _shape(self, time: FloatArray) -> FloatArray:
        return self.voltage(time)

    def __str__(self) -> str:
        return str(self.signal)
