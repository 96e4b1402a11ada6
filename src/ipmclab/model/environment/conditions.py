"""The environment of a strip, and the state of the water in its membrane."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

from ipmclab.errors import InputError
from ipmclab.units import RELATIVE_HUMIDITY, TEMPERATURE, parse_quantity

ABSOLUTE: Final = 273.15
"""Of 0 degC [K]."""

COLDEST: Final = -40.0
"""Of a strip [degC], as an environment that somebody writes may have it."""

WARMEST: Final = 150.0
"""The same, upwards: no membrane holds water there."""

Origin = Literal["assumed", "computed", "measured"]
"""How a water content is known: assumed in equilibrium, computed from a history, measured by mass."""

IN_WATER: Final = "in water"


@dataclass(frozen=True)
class Environment:
    """A constant environment.

    Parameters
    ----------
    temperature : float [degC]
    relative_humidity : float [percent]
    in_water : bool
        Whether the strip lies in liquid water. A membrane takes up more of it than of saturated vapour (Schroeder's
        paradox): water and 100 %RH are two environments.

    Raises
    ------
    InputError
        A number that is not finite, or a humidity outside 0 to 100 percent.

    Examples
    --------
    >>> Environment.parse("20 degC, 80 %RH")
    Environment(temperature=20.0, relative_humidity=80.0, in_water=False)
    >>> str(Environment.parse("20 degC, in water"))
    '20 degC, in water'
    """

    temperature: float
    relative_humidity: float
    in_water: bool = False

    def __post_init__(self) -> None:
        check_temperature(self.temperature)
        if not 0.0 <= self.relative_humidity <= 100.0:
            raise InputError(
                f"the relative humidity is {self.relative_humidity}",
                code="bad-relative-humidity",
                where="relative_humidity",
                repair="give a number from 0 to 100 percent",
            )
        if self.in_water and self.relative_humidity != 100.0:
            raise InputError(
                f"the strip is in water, and the relative humidity is {self.relative_humidity}",
                code="bad-relative-humidity",
                where="relative_humidity",
                repair="give 100 percent for a strip in water",
            )

    @classmethod
    def parse(cls, text: str, *, where: str = "environment") -> Environment:
        """An environment as people write it: ``"20 degC, 80 %RH"`` or ``"20 degC, in water"``.

        Raises
        ------
        InputError
            Another text, or a temperature outside -40 to 150 degC.
        """
        temperature, comma, second = (part.strip() for part in text.partition(","))
        if not comma or not temperature or not second:
            raise InputError(
                f"{text!r} is not an environment",
                code="bad-environment",
                where=where,
                repair="write temperature and humidity, such as '20 degC, 80 %RH', or '20 degC, in water'",
            )
        degrees = parse_quantity(temperature, TEMPERATURE, where=where)
        if not COLDEST <= degrees <= WARMEST:
            raise InputError(
                f"{temperature!r} is no temperature of a strip that holds water",
                code="bad-temperature",
                where=where,
                repair=f"give {COLDEST:g} to {WARMEST:g} degC",
            )
        if second == IN_WATER:
            return cls(degrees, 100.0, in_water=True)
        return cls(degrees, parse_quantity(second, RELATIVE_HUMIDITY, where=where))

    def __str__(self) -> str:
        """The text that ``parse`` reads."""
        air = IN_WATER if self.in_water else f"{self.relative_humidity:.15g} %RH"
        return f"{self.temperature:.15g} degC, {air}"


@dataclass(frozen=True)
class WaterState:
    """How much water the membrane has, and how warm it is.

    Parameters
    ----------
    water_content : float
        Molecules of water for each sulfonate group (lambda of the literature).
    temperature : float [degC]
    relative_humidity : float [percent], optional
        Of the air around, where it is known. The laws do not ask for it.
    origin : "assumed", "computed" or "measured"
        How the water content is known.

    Raises
    ------
    InputError
        A water content that is not above 0, a temperature or humidity that is none.
    """

    water_content: float
    temperature: float
    relative_humidity: float | None = None
    origin: Origin = "assumed"

    def __post_init__(self) -> None:
        check_temperature(self.temperature)
        if not (math.isfinite(self.water_content) and self.water_content > 0.0):
            raise InputError(
                f"the water content is {self.water_content}",
                code="bad-water-content",
                where="water_content",
                repair="give molecules of water for each sulfonate group, a number above 0",
            )
        if self.relative_humidity is not None:
            Environment(self.temperature, self.relative_humidity)


def check_temperature(temperature: float) -> None:
    """Refuse what is no temperature [degC] of a strip.

    Raises
    ------
    InputError
    """
    if not (math.isfinite(temperature) and temperature > -ABSOLUTE):
        raise InputError(
            f"the temperature is {temperature}",
            code="bad-temperature",
            where="temperature",
            repair="give a number in degC",
        )


@dataclass(frozen=True)
class EnvironmentLaw:
    """How one parameter follows the environment, by a function of your own.

    The laws of the literature are parameters of the actuator (``environment.laws``); this is for others.

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
