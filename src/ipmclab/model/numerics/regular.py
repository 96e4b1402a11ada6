"""The path without poles over rows of one period, from rest: a transition that is kept with the actuator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.dense import Dense, parts
from ipmclab.model.numerics.reduce import reduced, seen_states

if TYPE_CHECKING:
    from ipmclab.model.actuator import Actuator
    from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]

_KEPT = 8


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
        self._dense.run(kind, start, end, row, voltage, np.zeros(self._states), values)


def regular(actuator: Actuator, period: float, chosen: Sequence[int]) -> Regular | None:
    """A strip over rows of one period [s]; None where a period must be divided.

    Parameters
    ----------
    actuator : Actuator
    period : float [s]
    chosen : sequence of int
        Places of the outputs in ``OUTPUTS``.
    """
    if parts(actuator.system, np.array([period]))[0] > 1:
        return None
    kept: dict[tuple[float, tuple[int, ...]], Regular] = actuator.__dict__.setdefault("_regular", {})
    key = period, tuple(chosen)
    if key not in kept:
        if len(kept) >= _KEPT:
            kept.clear()
        seen = seen_states([actuator.system], chosen)
        kept[key] = Regular(Dense.of(reduced(actuator.system, chosen, seen), [period]), len(seen))
    return kept[key]
