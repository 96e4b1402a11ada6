"""The path without poles over rows of one period, from rest."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.course import voltage_course
from ipmclab.model.numerics.dense import Dense
from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]


class Regular:
    """Some outputs of a strip over rows of one period.

    Parameters
    ----------
    dense : Dense
    states : int
    """

    def __init__(self, dense: Dense, states: int) -> None:
        self._dense, self._states = dense, states

    def write(self, voltage: FloatArray, hold: Hold, values: FloatArray) -> None:
        """Write the outputs at the rows of a voltage, from rest.

        Raises
        ------
        IpmclabError
            The equation of a law has no solution in floating point.
        """
        rows = len(voltage)
        before, after = voltage[:-1], voltage[1:]
        start, end = (after if hold == "zero-before" else before), (before if hold == "zero" else after)
        kind, row = np.zeros(rows - 1, dtype=np.int64), np.arange(rows, dtype=np.int64)
        self._dense.run(voltage_course(kind, start, end, row, voltage), np.zeros(self._states), values)
