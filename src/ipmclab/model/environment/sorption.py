"""Sorption: how much water a membrane holds in equilibrium with vapour, and the vapour itself."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from ipmclab.errors import InputError, suggest
from ipmclab.model.environment.conditions import ABSOLUTE

GAS: Final = 8.314462618
"""Molar gas constant [J/(mol K)]."""

BUCK: Final = (611.21, 18.678, 234.5, 257.14)
"""The pressure of saturated vapour over water (Buck, 1981): [Pa], and three numbers for a temperature in degC."""

WATER: Final = 18.015e-3
"""Molar mass of water [kg/mol]."""

COEFFICIENTS: Final = ("constant", "linear", "quadratic", "cubic")
PREFIX: Final = "hydration.sorption."

ISOTHERMS: Final[Mapping[str, Mapping[str, float]]] = {
    "zawodzinski-H": dict(zip(COEFFICIENTS, (0.043, 17.81, -39.85, 36.0), strict=True)),
}
"""Isotherms that have a name. Zawodzinski's is of the H+ form at 30 degC, as Springer (1991) fits it."""

_ABOVE: Final = 0.1
"""Part by which the water content grows from saturated vapour for each unit of activity above 1 (Springer, 1991)."""

_MOST: Final = 1.2
"""Times the content in saturated vapour, beyond which it does not grow (Springer, 1991)."""

_TABLE: Final = 257


def water_content(values: Mapping[str, Any], activity: Any) -> Any:
    """The water content in equilibrium with vapour of an activity (relative humidity over 100).

    Parameters
    ----------
    values : mapping of dotted name to number
        With ``hydration.sorption.``: four coefficients and a scale.
    activity : number or array, 0 or more

    Examples
    --------
    >>> from ipmclab.model.environment.hydration import STANDARD
    >>> round(float(water_content(STANDARD, 0.8)), 6)
    7.219
    """
    within = np.minimum(activity, 1.0) if np.isrealobj(activity) else activity
    found = _polynomial(values, within)
    if np.isrealobj(activity) and np.any(np.asarray(activity) > 1.0):
        found = found * np.minimum(1.0 + _ABOVE * (np.maximum(activity, 1.0) - 1.0), _MOST)
    return found


def slope(values: Mapping[str, Any], activity: Any) -> Any:
    """The derivative of the water content by the activity.

    Examples
    --------
    >>> from ipmclab.model.environment.hydration import STANDARD
    >>> round(slope(STANDARD, 0.8), 6)
    23.17
    """
    _, linear, quadratic, cubic, scale = _numbers(values)
    return scale * (linear + activity * (2.0 * quadratic + activity * 3.0 * cubic))


def activity(values: Mapping[str, Any], content: Any) -> Any:
    """The activity of the water in a membrane: the inverse of ``water_content``, from 0 to 1.

    A membrane with more water than saturated vapour gives it loses water as a free surface does: its activity is 1.

    Parameters
    ----------
    values : mapping of dotted name to number
    content : number or array
        Complex where a derivative is taken.

    Examples
    --------
    >>> from ipmclab.model.environment.hydration import STANDARD
    >>> round(float(activity(STANDARD, 7.219)), 12), float(activity(STANDARD, 20.0))
    (0.8, 1.0)
    """
    real = {f"{PREFIX}{name}": np.real(values[f"{PREFIX}{name}"]) for name in (*COEFFICIENTS, "scale")}
    wanted = np.real(content)
    dry, wet = _polynomial(real, 0.0), _polynomial(real, 1.0)
    found = np.clip((wanted - dry) / (wet - dry), 0.0, 1.0)
    low, high = np.zeros_like(found), np.ones_like(found)
    for _ in range(60):  # Newton, kept between bounds that close in: the curve has a flat middle
        above = _polynomial(real, found) > wanted
        low, high = np.where(above, low, found), np.where(above, found, high)
        step = found - (_polynomial(real, found) - wanted) / slope(real, found)
        following = np.where((step >= low) & (step <= high), step, 0.5 * (low + high))
        done = np.all(np.abs(following - found) <= 1e-15)
        found = following
        if done:
            break
    inside = (wanted > dry) & (wanted < wet)
    # One step of Newton with complex numbers carries a derivative through the root.
    exact = found - np.where(inside, (_polynomial(values, found) - content) / slope(values, found), 0.0)
    return np.where(inside, exact, np.where(wanted >= wet, 1.0, 0.0))


def check(values: Mapping[str, float], *, where: str = "") -> None:
    """Refuse an isotherm that falls somewhere: a water content then belongs to several humidities.

    Raises
    ------
    InputError
    """
    if f"{PREFIX}scale" not in values:
        return
    grid = np.linspace(0.0, 1.0, _TABLE)
    falls = slope(values, grid) <= 0.0
    if np.any(falls):
        raise InputError(
            f"the isotherm falls at {100.0 * grid[np.argmax(falls)]:.0f} %RH, and more vapour gives more water",
            code="bad-isotherm",
            where=f"{where}hydration.sorption",
            repair='correct its coefficients, or write sorption = "zawodzinski-H"',
        )


def named(table: Any, *, where: str) -> Any:
    """The table ``[hydration]`` with the coefficients of an isotherm that it names.

    Raises
    ------
    InputError
        No isotherm of that name.
    """
    if not isinstance(table, dict) or not isinstance(table.get("sorption"), str):
        return table
    name = table["sorption"]
    if name not in ISOTHERMS:
        raise InputError(
            f"no isotherm is called {name!r}",
            code="unknown-isotherm",
            where=f"{where}: hydration.sorption",
            repair=f"{suggest(name, ISOTHERMS)} Or give its coefficients: {', '.join(COEFFICIENTS)}",
        )
    return {**table, "sorption": dict(ISOTHERMS[name])}


def saturation_pressure(temperature: Any) -> Any:
    """Pressure of saturated vapour over water [Pa] at a temperature [degC] (Buck, 1981).

    Examples
    --------
    >>> round(float(saturation_pressure(25.0)))
    3169
    """
    return BUCK[0] * np.exp((BUCK[1] - temperature / BUCK[2]) * temperature / (BUCK[3] + temperature))


def saturation_concentration(temperature: Any) -> Any:
    """Concentration of saturated vapour [mol/m^3] at a temperature [degC].

    Examples
    --------
    >>> round(float(saturation_concentration(25.0)), 6)
    1.278171
    """
    return saturation_pressure(temperature) / (GAS * (temperature + ABSOLUTE))


def dew_point(temperature: float, relative_humidity: float) -> float:
    """The temperature [degC] at which air of a temperature [degC] and a relative humidity [percent] is saturated.

    Examples
    --------
    >>> round(dew_point(25.0, 73.799), 2)
    20.0
    """
    if relative_humidity >= 100.0:
        return temperature
    lowest = -200.0
    wanted = relative_humidity / 100.0 * float(saturation_pressure(temperature))
    if wanted <= saturation_pressure(lowest):
        return lowest
    g = math.log(wanted / BUCK[0])  # Buck's equation, solved for its temperature
    half = 0.5 * (BUCK[1] - g)
    return BUCK[2] * (half - math.sqrt(half**2 - BUCK[3] * g / BUCK[2]))


def _numbers(values: Mapping[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
    constant, linear, quadratic, cubic = (values[f"{PREFIX}{name}"] for name in COEFFICIENTS)
    return constant, linear, quadratic, cubic, values[f"{PREFIX}scale"]


def _polynomial(values: Mapping[str, Any], a: Any) -> Any:
    constant, linear, quadratic, cubic, scale = _numbers(values)
    return scale * (constant + a * (linear + a * (quadratic + a * cubic)))
