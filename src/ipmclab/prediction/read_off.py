"""What is read off a record before it is predicted: the zero of a sensor, and when the edges were applied."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from ipmclab.identification.problem.free_run import predict
from ipmclab.identification.problem.record import LONGEST_DELAY, PreparedRun, rest_rows
from ipmclab.model import Actuator
from ipmclab.run import FloatArray

_FEWEST_AT_REST: Final = 5  # readings, whose mean and scatter say whether a sensor reads zero (convention)
_SURELY: Final = 3.0  # standard errors of a mean reading (convention)


def sensor_zero(record: PreparedRun, output: str) -> float:
    """What a sensor reads of a strip at rest: the mean reading before the voltage first moves.

    0 where that mean is within the noise, or where fewer than five readings show it: taking
    off a mean of noise would only add its error to every reading.
    """
    # Channels of a foreign record may lead its voltage by a few rows.
    rows = rest_rows(record.run) - (LONGEST_DELAY if record.delay_is_free else 0)
    if rows < _FEWEST_AT_REST or rows >= len(record.run) - 1:
        return 0.0
    reading = record.readings[output]
    before = reading.values[:rows][reading.exact[:rows]]
    if len(before) < _FEWEST_AT_REST:
        return 0.0
    mean, error = float(before.mean()), float(before.std(ddof=1)) / np.sqrt(len(before))
    return mean if abs(mean) > _SURELY * error else 0.0


def edge_delay(
    model: Actuator, record: PreparedRun, measured: Mapping[str, FloatArray], fitted: Mapping[str, Any]
) -> float | None:
    """By how much the edges of a foreign record lie after its rows; None where it shows no edge to tell by.

    A run of the fit is read as the fit read it. Elsewhere it is the delay within a few rows whose
    predicted shape is nearest to the readings: each output may be scaled, so that a model of the
    wrong size does not buy a smaller error with a wrong delay.
    """
    from scipy.optimize import minimize_scalar

    if "delay" in fitted:
        return float(fitted["delay"])
    rows = {name: reading.exact for name, reading in record.readings.items()}
    outputs = [name for name, used in rows.items() if used.any() and np.any(measured[name][used])]
    if not record.shows_edges or not outputs:
        return None
    period = 1.0 / record.run.rate

    def unlike(delay: float) -> float:
        """Sum over the outputs of the part of the readings that no multiple of the prediction explains."""
        left = 0.0
        for name, predicted in zip(outputs, predict(model, record, outputs, delay), strict=True):
            measured_rows, predicted_rows = measured[name][rows[name]], predicted[rows[name]]
            left += 1.0 - float(predicted_rows @ measured_rows) ** 2 / float(
                (predicted_rows @ predicted_rows) * (measured_rows @ measured_rows) or 1.0
            )
        return left

    grid = period * np.arange(-LONGEST_DELAY, LONGEST_DELAY + 0.01, 0.25)
    costs = [unlike(delay) for delay in grid]
    best = int(np.argmin(costs))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    found = minimize_scalar(unlike, bounds=(low, high), method="bounded")
    return float(found.x if found.fun < costs[best] else grid[best])
