"""What must be known of the environment of a run before its strip is believed to be in a state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from ipmclab.fit.run_state import RunState
from ipmclab.model import Actuator
from ipmclab.model.environment.findings import NEAR_DEW
from ipmclab.model.environment.sorption import dew_point
from ipmclab.run import Finding, Run

EXTRAPOLATED: Final = "environment-extrapolated"
NOT_IN_EQUILIBRIUM: Final = "not-in-equilibrium"
CONDENSATION: Final = "condensation"

_WETTER: Final = 1.0  # percent of relative humidity
_WARMER: Final = 1.0  # K
_SETTLED: Final = 3.0  # time constants of sorption


def extrapolated(state: RunState, seen: Sequence[RunState], label: str) -> list[Finding]:
    """``environment-extrapolated``: a state outside those in which the runs of a fit were.

    Parameters
    ----------
    state : RunState
    seen : sequence of RunState
        Of the runs of the fit.
    label : str
        For the message.
    """
    beyond = []
    for what, unit, slack in (("relative_humidity", "%RH", _WETTER), ("temperature", "degC", _WARMER)):
        own = getattr(state, what)
        others = [other for one in seen if (other := getattr(one, what)) is not None]
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
    """``not-in-equilibrium`` and ``condensation`` of a run.

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
    return [*_not_settled(actuator, run, state, label), *condensation(state, label)]


def _not_settled(actuator: Actuator, run: Run, state: RunState, label: str) -> list[Finding]:
    from ipmclab.model.environment.transport import time_constants

    minutes = run.metadata.minutes_in_environment
    if state.how != "assumed" or minutes is None or state.water_content is None or state.temperature is None:
        return []
    from ipmclab.model.environment import WaterState

    slow = time_constants(actuator.parameter_values, WaterState(state.water_content, state.temperature)).film
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


def condensation(state: RunState, label: str) -> list[Finding]:
    """``condensation``: air so near to its dew point that the strip may be wet."""
    if state.relative_humidity is None or state.temperature is None:
        return []
    point = dew_point(state.temperature, state.relative_humidity)
    if state.temperature >= point + NEAR_DEW:
        return []
    return [
        Finding(
            CONDENSATION,
            "warning",
            f"{label}: at {state.temperature:.3g} degC and {state.relative_humidity:.3g} %RH the strip is "
            f"{state.temperature - point:.1f} K above the dew point: water may condense on it, and then it holds more "
            "than the isotherm says",
            "keep the strip 2 K above the dew point, or weigh it",
            values={"dew_point": point},
        )
    ]
