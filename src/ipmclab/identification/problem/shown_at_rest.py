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

    def slopes(self, time: FloatArray, values: FloatArray) -> tuple[float, float]:
        """Between which slopes the sensor drifts over the record [SI/s].

        What a line leaves of these rows may be a walk, whose slope over them is none over the record. Were all of the
        change over a quarter of them a walk of q^2 a second, of which a slope over T has the variance 6 q^2/(5 T), that
        is an error beside the one of the check.

        Parameters
        ----------
        time : float array, shape (n,) [s]
            Of the rows at 0 V.
        values : float array, shape (n,) [SI]
        """
        lag, walked = len(time) // 4, 0.0
        if lag:
            left = values - self.value * time
            strays = float(np.mean((left[lag:] - left[:-lag]) ** 2)) / float(time[lag] - time[0])
            walked = math.sqrt(1.2 * strays / float(time[-1] - time[0]))
        reach = _SURELY * math.hypot(self.error, walked)
        return self.value - reach, self.value + reach
