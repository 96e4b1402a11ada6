"""What a fit says of the runs it was made from: the model as each run's observation reads it."""

from __future__ import annotations

import numpy as np

from ipmclab.fit.ages import rates_of
from ipmclab.fit.fit import Fit
from ipmclab.identification.problem.free_run import seen_from_sensor
from ipmclab.identification.problem.record import READ_OUTPUTS, model_hold, own_endings, own_values, prepare
from ipmclab.model.outputs import simulate_outputs
from ipmclab.model.stages.laser import blank_lost
from ipmclab.prediction.bands_of_run import band_of_run
from ipmclab.prediction.scores import Comparison
from ipmclab.quality import check
from ipmclab.run import Run
from ipmclab.strip_state.in_state import strip_in_state


def fitted_outputs(fit: Fit, run: Run, place: int) -> dict[str, Comparison]:
    """Measured and fitted values of the outputs that a run gave to a fit.

    Unlike a prediction, the fitted values carry everything that the fit settled for this run:
    its delay, offset, drift, starting state, and parameters of its own.

    Parameters
    ----------
    fit : Fit
    run : Run
    place : int
        The run's place in the call of ``identify``.

    Returns
    -------
    comparisons : dict of output to Comparison
    """
    observation = fit.observations[place]
    outputs = [name for name in READ_OUTPUTS if name in observation.noise and name in run.channels]
    record = prepare(run, place, outputs, check(run))
    values = {name: parameter.value for name, parameter in fit.parameters.items()}
    own = own_values(values, own_endings(place, observation.mounting))
    model = seen_from_sensor(fit.actuator.replace(**own), observation.series_resistance)
    state = observation.state
    fitted = simulate_outputs(
        model if state is None else strip_in_state(model, state, rates_of(fit)),
        run.time,
        record.run.voltage,
        model_hold(record),
        outputs=outputs,
        initial_state=observation.initial_state or None,
        delay=observation.delay,
    )
    read = record.readings.get("displacement")
    blank_lost(fitted, outputs, model.parameter_values, kept=None if read is None else read.exact)
    reach = band_of_run(fit, model, record, place, observation.delay, observation.initial_state, {})
    since = run.time - run.time[0]
    comparisons: dict[str, Comparison] = {}
    for output, values in zip(outputs, fitted, strict=True):
        shifted = values + observation.offset.get(output, 0.0) + observation.drift.get(output, 0.0) * since
        reading = record.readings[output]
        comparisons[output] = Comparison(
            run.time, run.channels[output], np.asarray(shifted), reading.exact, reach.get(output)
        )
    return comparisons
