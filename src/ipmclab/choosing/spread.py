"""How far the prediction of a fit may be off because its parameters are not known better.

A fit by least squares gives each reading the same weight, whatever the noise. Under noise of covariance S its
parameters have the covariance F^-1 (J' W S W J) F^-1 with F = J' W J (the sandwich of Huber and White), J the
slopes of the readings that it saw and W its weights. It is taken along the directions that those readings
determine: along the others its predictions do not move either.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.choosing.kernels import correlate
from ipmclab.choosing.noise import FadingNoise, ResidualSeries
from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.identification.problem.free_run import seen_from_sensor
from ipmclab.identification.problem.record import PreparedRun, model_hold
from ipmclab.model.outputs import simulate_outputs
from ipmclab.prediction.in_state import state_in
from ipmclab.strip_state.in_state import strip_in_state

FloatArray = npt.NDArray[np.float64]

_SEEN: Final = 1e-10  # of the largest: information on a direction that is more than rounding
_STEP: Final = 1e-4  # of a parameter: its effect on a prediction is nearly straight


def slopes(
    fit: Fit, record: PreparedRun, outputs: list[str], *, in_fit: int | None, delay: float | None
) -> dict[str, FloatArray]:
    """How each output moves with each parameter of a fit, by its own size.

    Parameters
    ----------
    fit : Fit
    record : PreparedRun
    outputs : list of str
    in_fit : int or None
        The run's place in the fit, None for a run that it never saw.
    delay : float or None [s]
        Of the edges of a run that it never saw.

    Returns
    -------
    columns : dict of output to float array, shape (n_time, n_parameter) [SI]
    """
    observation = fit.observations[in_fit] if in_fit is not None else None
    ending = f"[{in_fit}]"
    own = {
        name.removesuffix(ending): parameter.value
        for name, parameter in fit.parameters.items()
        if name.endswith(ending) and not name.startswith("observation.")
    }
    shift = observation.delay if observation is not None else delay or 0.0
    state = observation.state if observation is not None else state_in(fit, fit.actuator, record.run)
    since = record.run.time - record.run.time[0]

    def predicted(changes: dict[str, float], later: float = 0.0) -> FloatArray:
        model = seen_from_sensor(fit.actuator.replace(**{**own, **changes}), record.series_resistance)
        if state is not None:
            model = strip_in_state(model, state, {})
        start = observation.initial_state if observation is not None else None
        return np.asarray(
            simulate_outputs(
                model,
                record.run.time,
                record.run.voltage,
                model_hold(record),
                outputs=outputs,
                initial_state=start or None,
                delay=shift + later,
            )
        )

    here = predicted({})
    found = np.zeros((len(fit.parameters), *here.shape))
    for slope, (name, parameter) in zip(found, fit.parameters.items(), strict=True):
        base = name.removesuffix(ending)
        if "[" in base or (name == base and base.startswith("observation.")):
            continue  # another run's own
        if base.startswith(("observation.offset.", "observation.drift.")):
            output = base.rsplit(".", 1)[1]
            if output in outputs:
                slope[outputs.index(output)] = 1.0 if ".offset." in base else since
        elif base == "observation.delay":
            slope[:] = (predicted({}, 1e-3 * record.period) - here) / 1e-3
        else:
            step = _STEP * (abs(parameter.value) or 1e-3)
            try:
                slope[:] = (predicted({base: parameter.value + step}) - here) / _STEP
            except InputError:  # at its upper bound
                slope[:] = (here - predicted({base: parameter.value - step})) / _STEP
    return {output: np.ascontiguousarray(found[:, row].T) for row, output in enumerate(outputs)}


def directions(observed: Sequence[tuple[ResidualSeries, FloatArray, float, FadingNoise]]) -> FloatArray:
    """What one standard error of each independent combination of the parameters is, shape (n_parameter, n_direction).

    Parameters
    ----------
    observed : sequence of (ResidualSeries, slopes, weight, noise)
        Of each output of each run that the fit saw: the rows that it saw, the slopes of shape
        (n_time, n_parameter), one over the standard deviation that the fit gave its readings, and its noise.
    """

    count = observed[0][1].shape[1]
    if count == 0:
        return np.zeros((0, 0))
    information, scatter = np.zeros((count, count)), np.zeros((count, count))
    for series, slope, weight, noise in observed:
        weighed = np.where(series.observed[:, None], slope, 0.0) * weight
        information += weighed.T @ weighed
        white = (noise.white * series.noise) ** 2 + (1e-9 * series.extent) ** 2
        moved = white * weighed
        for part in noise.parts:
            for column in range(count):
                shared = np.zeros(len(weighed))
                correlate(series.time, np.ascontiguousarray(weighed[:, column]), 1.0 / part.time_constant, shared)
                moved[:, column] += (part.amplitude * series.extent) ** 2 * shared
        scatter += weight**2 * (weighed.T @ moved)
    # For columns of length 1; one that moves no reading has nothing of it: rounding over its length could be anything.
    size = np.where(information.diagonal() > 0.0, np.sqrt(information.diagonal()), np.inf)[:, None]
    value, vector = np.linalg.eigh(information / size / size.T)
    known = value > _SEEN * value[-1]
    inverse = (vector[:, known] / value[known]) @ vector[:, known].T
    square, turned = np.linalg.eigh(inverse @ (scatter / size / size.T) @ inverse)
    return np.asarray(turned * np.sqrt(np.maximum(square, 0.0)) / size)
