"""Where the runs of a fit ask more of its actuator than it holds for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ipmclab.fit.ages import rates_of
from ipmclab.fit.fit import Fit
from ipmclab.fit.observation import Observation
from ipmclab.identification.problem.free_run import predict, seen_from_sensor
from ipmclab.identification.problem.record import PreparedRun, own_endings, own_values
from ipmclab.model import Actuator
from ipmclab.model.stages.laser import blank_lost
from ipmclab.model.validity import validity
from ipmclab.run import Finding, Run
from ipmclab.strip_state.in_state import strip_in_state


def beyond_findings(fit: Fit, records: Sequence[PreparedRun]) -> list[Finding]:
    """What ``validity`` says of each run of a fit, with the run's label, and not what the fit already says of it.

    Of the displacement as the fitted actuator predicts it, where it was read: a sensor's zero is no bending. Where
    current alone was read, the beam is not asked, and being near its resonance is worth a note only. So is a ring that
    the rows are too few to show: it follows from the modulus and the density of the file, not from a reading.

    Parameters
    ----------
    fit : Fit
    records : sequence of PreparedRun
    """
    values = {name: one.value for name, one in fit.parameters.items()}
    found = []
    for place, (record, observation) in enumerate(zip(records, fit.observations, strict=True)):
        own = own_values(values, own_endings(place, observation.mounting))
        model = seen_from_sensor(fit.actuator.replace(**own) if own else fit.actuator, record.series_resistance)
        if observation.state is not None:
            model = strip_in_state(model, observation.state, rates_of(fit))
        added = observation.drift.get("displacement", 0.0)
        for finding in validity(model, _answer(model, record, observation, added), record.run.metadata.signal):
            if any(one.code == finding.code and one.message.startswith(f"{record.label}: ") for one in fit.findings):
                continue
            moved = bool(record.readings.keys() & {"displacement", "force"})
            noted = finding.code == "resonance-aliased" or (finding.code == "near-resonance" and not moved)
            drift = added if finding.code == "large-bending" and not observation.initial_state else 0.0
            found.append(
                replace(
                    finding,
                    severity="info" if noted else finding.severity,
                    message=f"{record.label}: {'without the drift of its sensor ' if drift else ''}{finding.message}",
                    samples=(),  # rows of the prediction, not of the record
                    effect="none",
                    values={**finding.values, "drift": drift} if drift else finding.values,
                )
            )
    return found


def _answer(model: Actuator, record: PreparedRun, read: Observation, drift: float) -> Run:
    """The run as the fitted actuator predicts it, as far as the fit read it, with a drift of its sensor [SI/s]."""
    run, reading = record.run, record.readings.get("displacement")
    if reading is None:
        return Run(time=run.time, voltage=run.voltage, hold=run.hold, metadata=run.metadata)
    every = np.array(predict(model, record, ["displacement"], read.delay, read.initial_state))
    blank_lost(every, ["displacement"], model.parameter_values, kept=reading.exact)
    if read.initial_state:
        # A slow start and the zero and the drift of a sensor cancel each other to any size: what is known is how far
        # the readings moved.
        every += drift * (run.time - run.time[0])
        every -= np.sum(every[0][np.isfinite(every[0])][:1])  # of none 0
    return Run(time=run.time, voltage=run.voltage, hold=run.hold, displacement=every[0], metadata=run.metadata)
