"""What some records asked of a strip, as the declarations of stages want to know it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ipmclab.model import Actuator, geometry
from ipmclab.model.stages.kind import Excitation
from ipmclab.run import Run

_LAGS: Final = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
"""Time constants that are tried, of the length of the longest record."""

_FEWEST_ROWS: Final = 3.0  # and the fastest, in rows


def excitation(actuator: Actuator, runs: Sequence[Run], outputs: Sequence[str]) -> Excitation:
    """What some runs asked of a strip.

    Parameters
    ----------
    actuator : Actuator
        Gives the dimensions.
    runs : sequence of Run
    outputs : sequence of str
        That are read.
    """
    values = actuator.parameter_values
    longest = max(float(run.time[-1] - run.time[0]) for run in runs)
    row = min(1.0 / run.rate for run in runs)
    area = float(np.real(geometry.area_per_thickness(values))) * values["geometry.thickness"]
    currents = [np.abs(run.current[np.isfinite(run.current)]) for run in runs if run.current is not None]
    return Excitation(
        outputs=tuple(outputs),
        lags=tuple(part * longest for part in _LAGS if part * longest >= _FEWEST_ROWS * row),
        voltage=max(float(np.abs(run.voltage).max()) for run in runs),
        current_density=max((float(one.max(initial=0.0)) for one in currents), default=0.0) / area,
    )
