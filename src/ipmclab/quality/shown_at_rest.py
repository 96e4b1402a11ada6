"""What the check of a record says of a sensor by its rows at 0 V."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from ipmclab.run import Finding, FloatArray

BEFORE_STEP: Final = {"offset-before-step": "offset", "drift-before-step": "drift"}
"""Findings of a record that call for an unknown of its observation."""

_SURELY: Final = 3.3  # standard errors, beyond which a value is rarer than 0.1 % (derived)
_PARTS: Final = 6  # of the rows at 0 V, over which a walk is sought: more of them take white noise for one (convention)


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

    def about(self, what: str, time: FloatArray, values: FloatArray, step: float, driven: float) -> tuple[float, float]:
        """Between which values the offset at the first row [SI], or the slope over the record [SI/s], lies.

        Beside the error of the check stand two more. A converter whose code hardly changes hides half a step. And what
        a constant or a line leaves of these rows may be a walk, which begins at another value than its mean over T and
        keeps no slope: of q^2 a second that is a variance of q^2 T/3 of the offset and 6 q^2/(5 T) of the slope. Means
        over neighbouring parts of length t then differ by a variance of 2 q^2 t/3, less what the line has taken of it;
        all that they differ by is taken for the walk.

        Parameters
        ----------
        what : str
            ``offset`` or ``drift``.
        time : float array, shape (n,) [s]
            Of the rows at 0 V.
        values : float array, shape (n,) [SI]
        step : float [SI]
            Of the converter; 0 where none shows.
        driven : float [SI]
            The most that the strip itself may read in these rows, at a voltage that is nearly 0.
        """
        span = float(time[-1] - time[0])
        differs, moves, unit, left = 2.0 / 3.0, span / 3.0, 1.0, values
        if what == "drift":
            differs, moves, unit, left = differs - 1.2 / _PARTS, 1.2 / span, span, values - self.value * time
        means = [float(part.mean()) for part in np.array_split(left, _PARTS)]
        strays = float(np.mean(np.diff(means) ** 2)) / (differs * span / _PARTS)
        walked = math.sqrt(strays * moves)
        reach = _SURELY * math.hypot(self.error, walked, step / math.sqrt(12.0) / unit) + driven / unit
        return self.value - reach, self.value + reach
