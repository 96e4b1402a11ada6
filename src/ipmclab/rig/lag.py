"""A quantity that follows its setting."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


class Lag:
    """A quantity that follows its setting with one time constant.

    Parameters
    ----------
    value : float
        At first, and the setting.
    time_constant : float [s]

    Examples
    --------
    >>> lag = Lag(20.0, time_constant=300.0)
    >>> lag.set(30.0, now=100.0)
    >>> lag.at(np.array([100.0, 400.0])).round(2).tolist()
    [20.0, 26.32]
    """

    def __init__(self, value: float, time_constant: float) -> None:
        self.setting = value
        self._start = value
        self._since = 0.0
        self._time_constant = time_constant

    def set(self, value: float, now: float) -> None:
        """Go towards another value from now on [s]."""
        self._start = float(self.at(np.array([now]))[0])
        self._since = now
        self.setting = value

    def at(self, times: FloatArray) -> FloatArray:
        """The quantity at some times [s], none before the last setting."""
        if self._start == self.setting:
            return np.full(len(times), self.setting)
        return self.setting + (self._start - self.setting) * np.exp(-(times - self._since) / self._time_constant)
