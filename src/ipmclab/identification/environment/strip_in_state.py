"""A strip in the state of a run, as an actuator without laws."""

from __future__ import annotations

from collections.abc import Mapping

from ipmclab.fit.fit import Fit
from ipmclab.fit.run_state import RunState
from ipmclab.identification.problem.age import AGE
from ipmclab.identification.problem.in_state import in_state
from ipmclab.model import Actuator
from ipmclab.model.environment.laws import is_of_environment


def rates_of(fit: Fit | None) -> dict[str, float]:
    """How fast parameters age, as a fit found it."""
    return {} if fit is None else {name: one.value for name, one in fit.parameters.items() if name.startswith(AGE)}


def strip_in_state(actuator: Actuator, state: RunState, rates: Mapping[str, float]) -> Actuator:
    """A strip in a state, without laws.

    Parameters
    ----------
    actuator : Actuator
        As it is in the reference state.
    state : RunState
    rates : mapping of name to float
        How fast parameters age.
    """
    found = in_state(actuator.parameter_values, state, (), water=state.found, rates=rates)
    stages = {name: value for name, value in found.values.items() if not is_of_environment(name)}
    return Actuator(actuator.name, stages, sample=actuator.sample)
