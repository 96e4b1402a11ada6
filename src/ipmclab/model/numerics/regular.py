"""The path without poles over rows of one period, from rest."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ipmclab.model.assemble import System
from ipmclab.model.numerics.course import voltage_course
from ipmclab.model.numerics.dense import Dense
from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]


class Regular:
    """Some outputs of a strip over rows of one period.

    Parameters
    ----------
    system : System
        Driven by the voltage alone.
    period : float [s]
    """

    def __init__(self, system: System, period: float) -> None:
        self._dense, self._states = Dense.of(system, [period]), len(system.states)

    def write(self, voltage: FloatArray, hold: Hold, values: FloatArray) -> None:
        """Write the outputs at the rows of a voltage, from rest; raises what ``along`` does."""
        before, after = voltage[:-1], voltage[1:]
        start, end = (after if hold == "zero-before" else before), (before if hold == "zero" else after)
        self.along(start, end, voltage, values)

    def along(self, start: FloatArray, end: FloatArray, reading: FloatArray, values: FloatArray) -> None:
        """The same of a voltage by its ends in each period, and what each row sees of it.

        Raises
        ------
        IpmclabError
            The equation of a law has no solution in floating point.
        """
        kind, row = np.zeros(len(start), dtype=np.int64), np.arange(len(reading), dtype=np.int64)
        self._dense.run(voltage_course(kind, start, end, row, reading), np.zeros(self._states), values)
