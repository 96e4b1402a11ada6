"""Findings about the environment of a simulated run: water on the strip, and laws that are not there."""

from __future__ import annotations

from typing import Final

from ipmclab.model.environment.conditions import Environment
from ipmclab.model.environment.sorption import dew_point
from ipmclab.run import Finding

NEAR_DEW: Final = 2.0
"""Above the dew point [K] a strip must be, because sensors err by as much."""

CODES: Final = ("condensation", "environment-ignored")


def condensation(temperature: float, air: Environment, label: str = "") -> Finding | None:
    """Whether water may condense on a strip.

    Parameters
    ----------
    temperature : float [degC]
        Of the strip.
    air : Environment
    label : str
        Of a run, for the message.

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
        message=f"{label}: "
        * bool(label)
        + f"the strip has {temperature:.1f} degC and the dew point of the air is {dew:.1f} degC: "
        "water may condense on it",
        repair=f"keep the strip {NEAR_DEW:g} K above the dew point: warm it before the air becomes humid, or lower the "
        "humidity; or weigh it",
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
