"""Findings about the environment: outside what a law was fitted to, not in equilibrium, water on the strip."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from ipmclab.model.environment.conditions import Environment, WaterState
from ipmclab.model.environment.sorption import dew_point
from ipmclab.model.environment.transport import time_constants
from ipmclab.run import Finding

EQUILIBRIUM: Final = 3.0
"""Time constants after which a strip counts as in equilibrium: 5 % of the change are then left."""

NEAR_DEW: Final = 2.0
"""Above the dew point [K] a strip must be, because sensors err by as much."""

_SLACK: Final = (0.5, 2.0)
"""How far [degC, percent] beside fitted conditions still counts as there: what sensors err by."""

CODES: Final = ("environment-extrapolated", "not-in-equilibrium", "condensation", "environment-ignored")


@dataclass(frozen=True)
class EnvironmentRange:
    """The environments that some laws were fitted to.

    Parameters
    ----------
    temperature : pair of float [degC]
        Least and greatest.
    relative_humidity : pair of float [percent]
    """

    temperature: tuple[float, float]
    relative_humidity: tuple[float, float]


def extrapolated(environment: Environment, fitted: EnvironmentRange) -> Finding | None:
    """Whether an environment is outside those that the laws were fitted to.

    Examples
    --------
    >>> fitted = EnvironmentRange(temperature=(20.0, 30.0), relative_humidity=(60.0, 80.0))
    >>> extrapolated(Environment(20.0, 70.0), fitted) is None
    True
    >>> print(extrapolated(Environment(40.0, 70.0), fitted).message)
    the laws of this strip were fitted at 20 to 30 degC and 60 to 80 %RH, and it is asked at 40 degC and 70 %RH
    """
    asked = (environment.temperature, environment.relative_humidity)
    ranges = (fitted.temperature, fitted.relative_humidity)
    if all(low - slack <= one <= high + slack for one, (low, high), slack in zip(asked, ranges, _SLACK, strict=True)):
        return None
    (cold, warm), (dry, wet) = ranges
    return Finding(
        code="environment-extrapolated",
        severity="warning",
        message=f"the laws of this strip were fitted at {_span(cold, warm)} degC and {_span(dry, wet)} %RH, "
        f"and it is asked at {asked[0]:g} degC and {asked[1]:g} %RH",
        repair="record a run there, or read this prediction as a guess",
        values={"temperature": asked[0], "relative_humidity": asked[1]},
    )


def not_in_equilibrium(values: Mapping[str, float], state: WaterState, since: float) -> Finding | None:
    """Whether a strip has been too short in its environment to have its water.

    Parameters
    ----------
    values : mapping of dotted name to float [SI]
        Of an actuator with a table ``[hydration]``.
    state : WaterState
        To which the strip goes: its equilibrium.
    since : float [s]
        Since the environment changed last.

    Examples
    --------
    >>> from ipmclab.model.environment.hydration import STANDARD, equilibrium
    >>> strip = {**STANDARD, "geometry.thickness": 0.2e-3}
    >>> found = not_in_equilibrium(strip, equilibrium(STANDARD, Environment(25.0, 80.0)), since=600.0)
    >>> print(found.message)
    the environment changed 10 min before, and the water of this strip follows with a time constant of 12 min
    """
    lag = time_constants(values, state).whole
    if since >= EQUILIBRIUM * lag:
        return None
    return Finding(
        code="not-in-equilibrium",
        severity="warning",
        message=f"the environment changed {since / 60.0:.0f} min before, and the water of this strip follows with a "
        f"time constant of {lag / 60.0:.0f} min",
        repair=f"wait for {math.ceil(EQUILIBRIUM * lag / 60.0)} min after a change, or measure the water by mass",
        values={"since": since, "time_constant": lag},
    )


def condensation(temperature: float, air: Environment) -> Finding | None:
    """Whether water may condense on a strip.

    Parameters
    ----------
    temperature : float [degC]
        Of the strip.
    air : Environment

    Examples
    --------
    >>> condensation(20.0, Environment(20.0, 80.0)) is None
    True
    >>> print(condensation(20.0, Environment(20.0, 95.0)).message)
    the strip has 20.0 degC and the dew point of the air is 19.2 degC: water may condense on it
    """
    dew = dew_point(air.temperature, air.relative_humidity)
    if air.in_water or temperature >= dew + NEAR_DEW:
        return None
    return Finding(
        code="condensation",
        severity="warning",
        message=f"the strip has {temperature:.1f} degC and the dew point of the air is {dew:.1f} degC: "
        "water may condense on it",
        repair="warm the strip before the air becomes humid, or lower the humidity",
        values={"temperature": temperature, "dew_point": dew},
    )


def ignored(environment: str) -> Finding:
    """That an actuator has no laws, so that an environment changes nothing."""
    return Finding(
        code="environment-ignored",
        severity="warning",
        message=f"this actuator has no laws of the environment: it is the same at {environment}",
        repair="give it a table [hydration] and laws [environment.NAME], or add them after a plus, such as "
        "+environment.coupling_gain",
    )


def _span(low: float, high: float) -> str:
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"
