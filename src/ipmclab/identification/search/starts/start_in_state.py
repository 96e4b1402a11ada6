"""Where a fit of runs in several states starts: from the runs of one state, and laws as the literature has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ipmclab.identification.problem.free import FreeParameters
from ipmclab.identification.problem.record import PreparedRun, at_their_rows
from ipmclab.identification.search.starts.start import StartingPoint
from ipmclab.model import Actuator
from ipmclab.model.environment.laws import is_of_environment
from ipmclab.strip_state.in_state import in_state

_ALIKE: Final = 0.1  # of a water content, and of a temperature in 50 K: states whose runs are taken together


def in_one_state(records: Sequence[PreparedRun]) -> list[PreparedRun] | None:
    """The most runs that are in about one state and have every output; None where states do not count.

    Parameters
    ----------
    records : sequence of PreparedRun
    """
    states = [record.state for record in records if record.state is not None and record.state.water_content is not None]
    if len(states) < len(records):
        return None
    outputs = {output for record in records for output in record.readings}
    places = np.array([state.place for state in states])
    best: list[PreparedRun] = []
    for place in places:
        near = [
            record
            for record, other in zip(records, places, strict=True)
            if float(np.abs(other - place).max()) <= _ALIKE
        ]
        shown = {output for record in near for output in record.readings}
        if shown == outputs and len(near) > len(best):
            best = near
    # Where no state has every output, all runs together are a start.
    return best or list(records)


def there_alone(
    actuator: Actuator, names: FreeParameters, records: Sequence[PreparedRun]
) -> tuple[Actuator, FreeParameters]:
    """The actuator in the state of some runs, without laws, and what is free in it."""
    values = _in_state(actuator, names, records)
    stages = {name: value for name, value in values.items() if not is_of_environment(name)}
    stated = {name: one for name, one in actuator.standard_uncertainties.items() if name in stages}
    priors = {name: prior for name, prior in names.priors.items() if name in stages}
    fewer = replace(names.of(stages), priors=priors, together={}, age=())
    return Actuator(actuator.name, stages, stated, actuator.sample), fewer


def moved_back(
    actuator: Actuator,
    names: FreeParameters,
    point: StartingPoint,
    alike: Sequence[PreparedRun],
    records: Sequence[PreparedRun],
) -> StartingPoint:
    """A start that runs of one state gave, as it is in the reference state, with usual laws."""
    laws = _usual_laws(actuator, names)
    ratios = _in_state(actuator, names, alike)
    values = {
        name: value * actuator[name] / ratios[name] if ratios.get(name) else value
        for name, value in point.values.items()
    }
    return StartingPoint({**values, **laws}, {**at_their_rows(records), **point.delays})


def _usual_laws(actuator: Actuator, names: FreeParameters) -> dict[str, float]:
    declared = actuator.structure.declarations
    usual = {name: declared[name].usual for name in names.actuator if is_of_environment(name)}
    return {name: actuator[name] if value is None else value for name, value in usual.items()}


def _in_state(actuator: Actuator, names: FreeParameters, records: Sequence[PreparedRun]) -> dict[str, float]:
    state = records[0].state
    assert state is not None
    strip = actuator.replace(**_usual_laws(actuator, names))
    return in_state(strip.parameter_values, state, ()).values
