"""The free run of an actuator over a record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ipmclab.errors import IpmclabError
from ipmclab.identification.problem.record import PreparedRun, model_hold
from ipmclab.model import Actuator
from ipmclab.model.outputs import simulate_outputs
from ipmclab.model.stages.circuit import CONTACT
from ipmclab.run import FloatArray


def predict(
    model: Actuator,
    record: PreparedRun,
    outputs: Sequence[str],
    delay: float,
    initial_state: Mapping[str, float] | None = None,
) -> FloatArray:
    """The outputs from rest, shape (n_outputs, n_time), with nothing of the response shown to the model.

    A run of the fit starts from the state that was found there.
    """
    run = record.run
    values = simulate_outputs(
        model,
        run.time,
        run.voltage,
        model_hold(record),
        outputs=outputs,
        initial_state=initial_state or None,
        delay=delay,
    )
    if not np.all(np.isfinite(values)):
        output, row = (int(index[0]) for index in np.nonzero(~np.isfinite(values)))
        raise IpmclabError(
            f"the predicted {outputs[output]} of {model.name} is not finite from sample {row} on",
            code="not-finite",
            where=record.label,
            repair="see that the actuator's parameters are those of a real strip",
        )
    return values


def seen_from_sensor(actuator: Actuator, series_resistance: float) -> Actuator:
    """The actuator with the shunt in series, where the voltage was sensed upstream of it."""
    if series_resistance == 0.0:
        return actuator
    return actuator.replace(**{CONTACT: actuator[CONTACT] + series_resistance})
