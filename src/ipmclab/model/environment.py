"""The environment of a strip, and the laws by which its parameters follow it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ipmclab.errors import InputError


@dataclass(frozen=True)
class Environment:
    """A constant environment.

    Parameters
    ----------
    temperature : float [degC]
    relative_humidity : float [percent]

    Raises
    ------
    InputError
        A number that is not finite, or a humidity outside 0 to 100 percent.
    """

    temperature: float
    relative_humidity: float

    def __post_init__(self) -> None:
        if not math.isfinite(self.temperature):
            raise InputError(
                f"the temperature is {self.temperature}",
                code="bad-temperature",
                where="temperature",
                repair="give a number in degC",
            )
        if not 0.0 <= self.relative_humidity <= 100.0:
            raise InputError(
                f"the relative humidity is {self.relative_humidity}",
                code="bad-relative-humidity",
                where="relative_humidity",
                repair="give a number from 0 to 100 percent",
            )


@dataclass(frozen=True)
class EnvironmentLaw:
    """How one parameter follows the environment.

    Parameters
    ----------
    parameter : str
        Its dotted name.
    value : function of (float [SI], Environment) to float [SI]
        From the value that the actuator states to the value in an environment. A function of a module, so that an
        actuator with this law can be sent to another process.
    """

    parameter: str
    value: Callable[[float, Environment], float]
