"""What the check of a record says of a sensor by its rows at 0 V."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.run import Finding

FloatArray = npt.NDArray[np.float64]

BEFORE_STEP: Final = {"offset-before-step": "offset", "drift-before-step": "drift"}
"""Findings of a record that call for an unknown of its observation."""

_SURELY: Final = 3.3  # standard errors, beyond which a value is rarer than 0.1 %


class AtRest(NamedTuple):
    """The offset or the slope of the rows at 0 V, and its standard error [SI]."""

    value: float
    error: float

    @classmethod
    def of(cls, finding: Finding) -> AtRest:
        """What the check says of it."""
        name = "slope" if BEFORE_STEP[finding.code] == "drift" else "offset"
        return cls(float(finding.values[name] or 0.0), float(finding.values["standard_error"] or 0.0))

    @property
    def at_most(self) -> tuple[float, float]:
        """Between which values it lies where more than the sensor moves in these rows: in either direction [SI]."""
        largest = abs(self.value) + _SURELY * self.error
        return -largest, largest

    def about(self, what: str, time: FloatArray, values: FloatArray) -> tuple[float, float]:
        """Between which values the offset at the first row [SI], or the slope over the record [SI/s], lies.

        What a constant or a line leaves of these rows may hold a walk. It begins at another value than its mean over T,
        and keeps no slope: of q^2 a second it is an error of variance q^2 T/3 of the offset and 6 q^2/(5 T) of the
        slope, beside the one of the check. All that rows a quarter apart differ by more than neighbours is the walk.

        Parameters
        ----------
        what : str
            ``offset`` or ``drift``.
        time : float array, shape (n,) [s]
            Of the rows at 0 V.
        values : float array, shape (n,) [SI]
        """
        lag, walked = len(time) // 4, 0.0
        if lag > 1:
            left = values - self.value * time if what == "drift" else values
            near, far = (float(np.mean((left[by:] - left[:-by]) ** 2)) for by in (1, lag))
            strays, span = max(far - near, 0.0) / float(time[lag] - time[1]), float(time[-1] - time[0])
            walked = math.sqrt(strays * (1.2 / span if what == "drift" else span / 3.0))
        reach = _SURELY * math.hypot(self.error, walked)
        return self.value - reach, self.value + reach
