"""What must be known of the environment of a run before its strip is believed to be in a state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ipmclab.model import Actuator
from ipmclab.model.environment import Environment, EnvironmentHistory, WaterState
from ipmclab.model.environment.findings import condensation
from ipmclab.model.environment.hydration import ASYMMETRY
from ipmclab.run import Finding, Run
from ipmclab.strip_state.run_state import RunState
from ipmclab.strip_state.state_of_run import water_after

EXTRAPOLATED: Final = "environment-extrapolated"
NOT_IN_EQUILIBRIUM: Final = "not-in-equilibrium"
MOVES: Final = "water-moves"

_WETTER: Final = 1.0  # percent of relative humidity: runs that near were in one state (convention)
_WARMER: Final = 1.0  # K: the same of temperature
_SETTLED: Final = 3.0  # time constants of sorption
_STILL: Final = 0.01  # of the water content: a smaller change shows in nothing that is read


def extrapolated(state: RunState, fitted_states: Sequence[RunState], label: str) -> list[Finding]:
    """``environment-extrapolated``: a state outside those in which the runs of a fit were.

    Parameters
    ----------
    state : RunState
    fitted_states : sequence of RunState
        Of the runs of the fit.
    label : str
        For the message.
    """
    beyond = []
    for what, unit, slack in (("relative_humidity", "%RH", _WETTER), ("temperature", "degC", _WARMER)):
        own = getattr(state, what)
        others = [other for one in fitted_states if (other := getattr(one, what)) is not None]
        if own is None or not others:
            continue
        low, high = min(others), max(others)
        if not low - slack <= own <= high + slack:
            beyond.append(f"{own:.3g} {unit}, and the runs of the fit were at {low:.3g} to {high:.3g} {unit}")
    if not beyond:
        return []
    return [
        Finding(
            EXTRAPOLATED,
            "warning",
            f"{label} is at {'; and at '.join(beyond)}: the laws were never asked there, and their own error is not in "
            "the band",
            "record a run near this condition and fit it with the others",
        )
    ]


def doubtful(actuator: Actuator, run: Run, state: RunState, label: str) -> list[Finding]:
    """``not-in-equilibrium``, ``water-moves`` and ``condensation`` of a run.

    Parameters
    ----------
    actuator : Actuator
        With a table ``[hydration]``.
    run : Run
    state : RunState
        That was taken for this run.
    label : str
        For the messages.
    """
    return [
        *_not_settled(actuator, run, state, label),
        *_moving(actuator, run, state, label),
        *_wet(state, label),
    ]


def _not_settled(actuator: Actuator, run: Run, state: RunState, label: str) -> list[Finding]:
    from ipmclab.model.environment.transport import time_constants

    minutes = run.metadata.minutes_in_environment
    if state.how != "assumed" or minutes is None or state.water_content is None or state.temperature is None:
        return []
    values = actuator.parameter_values
    slow = time_constants(values, WaterState(state.water_content, state.temperature)).whole
    slow *= max(1.0, values[ASYMMETRY])  # nobody says from which side the strip came
    if 60.0 * minutes >= _SETTLED * slow:
        return []
    return [
        Finding(
            NOT_IN_EQUILIBRIUM,
            "warning",
            f"{label}: the strip was in this environment for {minutes:.3g} min, and takes {slow / 60.0:.2g} min for "
            "most of the way; its water content was assumed in equilibrium",
            f"wait {_SETTLED * slow / 60.0:.2g} min, weigh the strip (mass), or state where it was before "
            "(minutes_out_of_water)",
            values={"minutes": minutes, "time_constant": slow},
        )
    ]


def _moving(actuator: Actuator, run: Run, state: RunState, label: str) -> list[Finding]:
    """``water-moves``: a fit takes one water content for a run, and in its air it becomes another one."""
    content, air = state.water_content, _air(run, state)
    if content is None or state.temperature is None or air is None:
        return []
    begin = WaterState(content, state.temperature)
    end = water_after(actuator.parameter_values, begin, air, float(run.time[-1] - run.time[0]))
    error = max(state.standard_uncertainty, _STILL * content)
    if abs(end - content) <= error:
        return []
    return [
        Finding(
            MOVES,
            "warning",
            f"{label}: its air moves the water content from {content:.3g} to {end:.3g} during the run; one content was "
            f"taken for all of it, and believed within {error:.2g}",
            "wait until the strip is in equilibrium before it is recorded, or record a shorter run",
            values={"begin": content, "end": end, "error": error},
        )
    ]


def _air(run: Run, state: RunState) -> Environment | EnvironmentHistory | None:
    """The air of a run as it was read, else as it is stated; None of a simulated run, which need not move."""
    if run.temperature is not None and run.relative_humidity is not None:
        time = run.time if run.time_environment is None else run.time_environment
        read = np.isfinite(run.temperature) & np.isfinite(run.relative_humidity)
        if read.any():
            humidity = np.clip(run.relative_humidity[read], 0.0, 100.0)
            return EnvironmentHistory(time[read] - run.time[0], run.temperature[read], humidity)
    if run.metadata.origin == "simulated" or state.temperature is None or state.relative_humidity is None:
        return None
    return Environment(state.temperature, state.relative_humidity)


def _wet(state: RunState, label: str) -> list[Finding]:
    if state.relative_humidity is None or state.temperature is None:
        return []
    found = condensation(state.temperature, Environment(state.temperature, state.relative_humidity), label)
    return [] if found is None else [found]
