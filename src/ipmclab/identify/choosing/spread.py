"""How far the prediction of a fit may be off because its parameters are not known better."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.identify.fit import Fit
from ipmclab.identify.free_run import seen_from_sensor
from ipmclab.identify.observation import Record, model_hold
from ipmclab.model.sensitivity import simulate_outputs

FloatArray = npt.NDArray[np.float64]

_STEP: Final = 1e-4  # of a parameter: its effect on a prediction is nearly straight
_WIDEST: Final = 1.0  # relative error: a parameter that is not determined is not known to a factor of two


def spread(
    fit: Fit, record: Record, outputs: list[str], *, in_fit: int | None, delay: float | None
) -> dict[str, FloatArray]:
    """The effect on each output of one standard error of each independent combination of the parameters.

    Parameters
    ----------
    fit : Fit
        Its errors allow for residuals that hang together.
    record : Record
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
    since = record.run.time - record.run.time[0]

    def predicted(changes: dict[str, float], later: float = 0.0) -> FloatArray:
        model = seen_from_sensor(fit.actuator.replace(**{**own, **changes}), record.series_resistance)
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
    names, slopes, errors = [], [], []
    for name, parameter in fit.parameters.items():
        base = name.removesuffix(ending)
        if "[" in base or (name == base and base.startswith("observation.")):
            continue  # another run's own
        slope = np.zeros_like(here)
        if base.startswith(("observation.offset.", "observation.drift.")):
            output = base.rsplit(".", 1)[1]
            if output in outputs:
                slope[outputs.index(output)] = 1.0 if ".offset." in base else since
            most = np.inf
        elif base == "observation.delay":
            step = 1e-3 * record.period
            slope, most = (predicted({}, step) - here) / step, record.period
        else:
            step = _STEP * (abs(parameter.value) or min(parameter.standard_error, 1.0))
            try:
                slope = (predicted({base: parameter.value + step}) - here) / step
            except InputError:  # at its upper bound
                slope = (here - predicted({base: parameter.value - step})) / step
            most = _WIDEST * abs(parameter.value) or parameter.standard_error
        error = min(parameter.standard_error, most)
        if np.isfinite(error):
            names.append(name)
            slopes.append(slope)
            errors.append(error)
    if not names:
        return {output: np.zeros((len(since), 0)) for output in outputs}
    correlation = np.nan_to_num(np.array([[fit.correlations[a][b] for b in names] for a in names]))
    square, directions = np.linalg.eigh(correlation)
    mix = np.array(errors)[:, None] * directions * np.sqrt(np.maximum(square, 0.0))
    return {output: np.array([slope[row] for slope in slopes]).T @ mix for row, output in enumerate(outputs)}
