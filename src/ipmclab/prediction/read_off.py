"""What is read off a record before it is predicted: the zero of a sensor, and when the edges were applied."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from ipmclab.fit.fit import Fit
from ipmclab.identification.noise.at_rest import Resting
from ipmclab.identification.problem.free_run import predict
from ipmclab.identification.problem.record import LONGEST_DELAY, PreparedRun
from ipmclab.identification.search.starts.start_circuit import zero_of_wave
from ipmclab.model import Actuator
from ipmclab.quality.noise import variance_for_means
from ipmclab.quality.record import Record
from ipmclab.quality.rows_at_rest import rows_near_zero
from ipmclab.run import FloatArray, Run
from ipmclab.statespace.noise_model import NoiseModel

_FEWEST_AT_REST: Final = 5  # readings, whose mean and scatter say whether a sensor reads zero (convention)
_MOST_AT_REST: Final = 2000  # readings, the last of them: more would say no more of a zero (convention)
_SURELY: Final = 3.0  # standard errors of a mean reading (convention)
_HARDLY: Final = 0.25  # of an offset: until a prediction is as large the strip has not moved much (convention)
MOSTLY: Final = (
    0.5  # of what was missed (or of an offset), that a zero or a drift leaves where it is the cause (convention)
)


def sensor_zeros(
    model: Actuator, record: PreparedRun, outputs: Sequence[str], fit: Fit | None = None
) -> dict[str, float]:
    """What sensors read of a strip at rest: the mean of the readings before the voltage moves, less the answer there.

    The zero of a current without such rows is what its wave shows by itself, as in a fit (``zero_of_wave``). Where a
    laser or a load cell reads zero is arbitrary: without such rows it is the offset that is most of what a prediction
    from rest misses, also before the strip has moved much.

    A voltage that begins slowly moves the strip before it counts as on, and that is no zero. One is taken off where it
    is surely no mean of noise, which would only add its error to every reading: neither of the noise that these rows
    show, nor of that which the fit knows. Rows that are few beside the time in which a noise changes show little of it.

    Parameters
    ----------
    model : Actuator
    record : PreparedRun
    outputs : sequence of str
    fit : Fit, optional
        That the actuator comes from.

    Returns
    -------
    zeros : dict of output to float [SI]
        0 where the mean is within the noise, or where nothing shows it.
    """
    rows = rows_that_show_zero(record.run)
    if not outputs or rows >= len(record.run) - 1:
        return dict.fromkeys(outputs, 0.0)
    if not rows:
        return {
            output: _of_wave(model, record, answer) if output == "current" else _of_motion(record, output, answer)
            for output, answer in zip(outputs, predict(model, record, outputs, 0.0), strict=True)
        }
    answers = np.zeros((len(outputs), rows))
    if np.any(record.run.voltage[:rows]):
        answers = np.asarray(predict(model, record, outputs, 0.0))[:, :rows]
    found = {}
    for output, answer in zip(outputs, answers, strict=True):
        reading = record.readings[output]
        kept = np.flatnonzero(reading.exact[:rows])[-_MOST_AT_REST:]
        found[output] = _zero_of((reading.values[:rows] - answer)[kept], record.run.time[kept], fit, output)
    return found


def rows_that_show_zero(run: Run) -> int:
    """How many rows before the voltage moves show the zeros of sensors; none where they are fewer than five.

    Channels of a foreign record may lead its voltage by a few rows.
    """
    rows = rows_near_zero(run) - (LONGEST_DELAY if run.hold == "unknown" else 0)
    return rows if rows >= _FEWEST_AT_REST else 0


def _of_wave(model: Actuator, record: PreparedRun, answer: FloatArray) -> float:
    reading = record.readings["current"]
    missed = (reading.values - answer)[reading.exact]
    left = {(record.place, "current"): float(np.sqrt(np.mean(missed**2))) if len(missed) else 0.0}
    return zero_of_wave(record, model.structure.branches, left) or 0.0


def _of_motion(record: PreparedRun, output: str, answer: FloatArray) -> float:
    """The intercept of readings over the answer from rest, which hangs on no gain; 0 where it explains little."""
    reading = record.readings[output]
    if Record.of(record.run).begins_under_voltage or not reading.exact.any():
        return 0.0
    values, answer = reading.values[reading.exact], answer[reading.exact]
    missed = values - answer
    offset = float(np.linalg.lstsq(np.column_stack([np.ones(len(answer)), answer]), missed, rcond=1e-12)[0][0])
    moves = np.abs(answer) >= _HARDLY * abs(offset)
    first = missed[: int(np.argmax(moves)) if moves.any() else None]
    is_there = len(first) > 0 and abs(float(first.mean()) - offset) < MOSTLY * abs(offset)
    return offset if is_there and np.linalg.norm(missed - offset) < MOSTLY * np.linalg.norm(missed) else 0.0


def _zero_of(before: FloatArray, time: FloatArray, fit: Fit | None, output: str) -> float:
    """The mean of readings of a strip at rest; 0 where it could be one of noise."""
    if len(before) < _FEWEST_AT_REST:
        return 0.0
    mean = float(before.mean())
    variances = [variance_for_means(before - mean, 1) / len(before)]
    for one in () if fit is None else fit.observations:
        noise = one.noise_model.get(output)
        # What a model lacks is in its noise, too, but not in these rows: what is slow in it counts where they show it.
        if noise is None or _resting(noise, time, before).likelier_with_slow <= 0.0:
            continue
        variance = noise.variance_of_mean(time)
        about = float(np.mean(noise.deviation(time - time[0]) ** 2)) - variance
        variances.append(variance * min(float(before.var()) / about, 1.0) if about > 0.0 else variance)
    return mean if abs(mean) > _SURELY * math.sqrt(max(variances)) else 0.0


def _resting(noise: NoiseModel, time: FloatArray, left: FloatArray) -> Resting:
    """The first reading of each step of a noise, and that noise."""
    _, first = np.unique(np.rint((time - time[0]) / noise.step), return_index=True)
    return Resting(noise.shape, left[first])


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
