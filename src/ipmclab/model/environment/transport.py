"""Transport: how water enters and leaves a membrane, through films, coating and its thickness.

Sorption is as fast as the slower of two: what the air carries away from the faces, and what diffuses to them. The
time of the first follows the slope of the isotherm, so that the same strip is five times as slow at 80 %RH as at
50 %RH: no single time constant holds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.model.environment.conditions import WaterState
from ipmclab.model.environment.history import EnvironmentHistory
from ipmclab.model.environment.hydration import SITES, SWELLING, equilibrium, reference
from ipmclab.model.environment.sorption import COEFFICIENTS, PREFIX, WATER, activity, saturation_concentration, slope

FloatArray = npt.NDArray[np.float64]

FARADAY: Final = 96485.33212
"""[C/mol]"""

WATER_FOR_A_COULOMB: Final = WATER / (2.0 * FARADAY)
"""Water [kg] that electrolysis takes for a charge of 1 C: one molecule for two electrons."""

BODY: Final = 37.0
"""Temperature [degC] at which data sheets state what passes a coating."""

_FINE: Final = 20.0
"""Steps in the shortest time constant: one of fourth order then errs by less than 1e-7."""

_MOST_NODES: Final = 4000


@dataclass(frozen=True, eq=False)
class WaterCourse:
    """How the water of a membrane went.

    Parameters
    ----------
    time : float array, shape (n,) [s]
    water_content : float array, shape (n,)
    temperature : float array, shape (n,) [degC]
    gradient : float array, shape (n,)
        First antisymmetric mode of the content through the thickness: positive where the anode's face has more.
    rates : float array, shape (2, n) [1/s and K/s]
        Of water content and temperature.
    with_air : bool
        Whether the strip is always as warm as its air, whose temperature goes in straight lines with corners.
    """

    time: FloatArray
    water_content: FloatArray
    temperature: FloatArray
    gradient: FloatArray
    rates: FloatArray
    with_air: bool = False

    def contents(self, times: npt.ArrayLike) -> FloatArray:
        """The water content at some times [s], by cubics through contents and rates; constant outside."""
        return self._between(times, self.water_content, self.rates[0])

    def temperatures(self, times: npt.ArrayLike) -> FloatArray:
        """The temperature at some times [s] [degC], likewise; in straight lines where it is that of the air."""
        if self.with_air:
            return np.interp(np.asarray(times, dtype=np.float64), self.time, self.temperature)
        return self._between(times, self.temperature, self.rates[1])

    def gradients(self, times: npt.ArrayLike) -> FloatArray:
        """The antisymmetric mode at some times [s]."""
        return np.interp(np.asarray(times, dtype=np.float64), self.time, self.gradient)

    def _between(self, times: npt.ArrayLike, values: FloatArray, rates: FloatArray) -> FloatArray:
        t = np.clip(np.asarray(times, dtype=np.float64), self.time[0], self.time[-1])
        place = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 2)
        length = self.time[place + 1] - self.time[place]
        x, first, rise = (t - self.time[place]) / length, values[place], values[place + 1] - values[place]
        begin, end = rates[place] * length - rise, rates[place + 1] * length - rise
        return np.asarray(first + x * (rise + (1.0 - x) * ((1.0 - x) * begin - x * end)))

    def state(self, time: float, relative_humidity: float | None = None) -> WaterState:
        """The state at one time [s]: computed from the history."""
        content, temperature = float(self.contents(time)), float(self.temperatures(time))
        return WaterState(content, temperature, relative_humidity, "computed")


def water_course(
    values: Mapping[str, float],
    history: EnvironmentHistory,
    duration: float,
    *,
    start: WaterState | None = None,
    begin: float = 0.0,
    leak: FloatArray | None = None,
    gradient: float = 0.0,
) -> WaterCourse:
    """How the water of a membrane goes in an environment that changes.

    Parameters
    ----------
    values : mapping of dotted name to float [SI]
        Of an actuator with a table ``[hydration]``.
    history : EnvironmentHistory
    duration : float [s]
    start : WaterState, optional
        At ``begin``; in equilibrium with the environment there where it is left out.
    begin : float [s]
    leak : float array, shape (2, n), optional
        Times [s] and the current density [A/m^2] that leaks from each of them on: it splits water.
    gradient : float
        Antisymmetric mode at ``begin``.

    Returns
    -------
    course : WaterCourse

    Examples
    --------
    Film alone, 0.2 mm at 20 degC in still air, from 80 to 50 %RH: after 1, 5 and 20 min.

    >>> from ipmclab.model.environment.hydration import STANDARD
    >>> strip = {**STANDARD, "geometry.thickness": 0.2e-3, "hydration.diffusivity": 1.0}
    >>> air = EnvironmentHistory.of("20 degC, 50 %RH")
    >>> course = water_course(strip, air, 1200.0, start=WaterState(7.219, 20.0))
    >>> [round(float(one), 6) for one in course.contents([60.0, 300.0, 1200.0])]
    [6.755945, 5.242157, 3.519616]
    """
    from ipmclab.model.environment.transport_loop import follow

    first = equilibrium(values, history.at(begin)) if start is None else start
    given = around(values, history, begin, begin + duration, np.empty(0) if leak is None else leak[0])
    flowing = np.zeros(len(given.time) - 1)
    if leak is not None:
        flowing = leak[1][np.clip(np.searchsorted(leak[0], given.time[:-1], side="right") - 1, 0, leak.shape[1] - 1)]
    result = np.empty((4, len(given.time)))
    begun = np.array([first.water_content, first.temperature, gradient])
    follow(given.membrane, given.time, given.air, flowing, given.longest, begun, result)
    return given.course(result)


@dataclass(frozen=True, eq=False)
class Around:
    """A membrane, and the air around it.

    Parameters
    ----------
    membrane : transport_loop.Membrane
    time : float array, shape (n,) [s]
        Where the water is kept.
    air : float array, shape (2, n)
        Temperature [degC] and activity of the air there.
    longest : float [s]
        Step of the solver.
    """

    membrane: Any
    time: FloatArray
    air: FloatArray
    longest: float

    def course(self, result: FloatArray) -> WaterCourse:
        """The course of the water of what ``transport_loop.follow`` writes."""
        lag = self.membrane.thermal
        warming = (self.air[0] - result[1]) / lag if lag > 0.0 else np.gradient(self.air[0], self.time)
        if lag <= 0.0:
            result[1] = self.air[0]
        rates = np.vstack([result[3], warming])
        return WaterCourse(self.time, result[0], result[1], result[2], rates, with_air=lag <= 0.0)


def around(
    values: Mapping[str, float], history: EnvironmentHistory, begin: float, end: float, corners: FloatArray
) -> Around:
    """What a membrane is given between two times [s], with further times at which its water is kept."""
    fastest = _fastest(values, history)
    time = _nodes(values, np.concatenate([history.time, corners]), begin, end, fastest)
    air = np.vstack(
        [
            np.interp(time, history.time, history.temperature),
            np.interp(time, history.time, history.relative_humidity) / 100.0,
        ]
    )
    return Around(_membrane(values), time, air, fastest / _FINE)


def dry_thickness(values: Mapping[str, float]) -> float:
    """The thickness [m] without water, as the law of the thickness says; the stated one without that law."""
    swelling = values.get("environment.thickness.swelling", 0.0)
    return values["geometry.thickness"] / (1.0 + swelling * reference(values).water_content)


def mass_transfer(values: Mapping[str, float]) -> float:
    """Mass transfer [m/s] of one face while water leaves: the film of air, a coating behind it, and its bare edges.

    Examples
    --------
    >>> from ipmclab.model.environment.hydration import STANDARD
    >>> coated = {**STANDARD, "hydration.coating.transfer": 1.155e-5, "hydration.coating.bare_edge": 0.054}
    >>> [round(mass_transfer(one), 6) for one in (STANDARD, coated)]
    [0.005, 0.000282]
    """
    air = values["hydration.film"]
    coating = values.get("hydration.coating.transfer")
    if coating is None:
        return air
    return 1.0 / (1.0 / air + 1.0 / coating) + values["hydration.coating.bare_edge"] * air


def coating_transfer(transmission: float) -> float:
    """Mass transfer [m/s] of a coating from a data sheet's water vapour transmission [kg/(m^2 s)] at 37 degC, 90 %RH.

    Examples
    --------
    Parylene C of 5 um by one data sheet, 39.4 g/(m^2 day):

    >>> f"{coating_transfer(39.4e-3 / 86400.0):.3e}"
    '1.155e-05'
    """
    return float(transmission / (WATER * 0.9 * saturation_concentration(BODY)))


def bare_edge(values: Mapping[str, float]) -> float:
    """Area of the cut edges over that of both faces, for ``hydration.coating.bare_edge`` where the edges are bare.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> round(bare_edge(load_actuator("friend-2").parameter_values), 3)
    0.054
    """
    length, width = values["geometry.free_length"], values["geometry.width"]
    return values["geometry.thickness"] * (2.0 * length + width) / (2.0 * length * width)


@dataclass(frozen=True)
class TimeConstants:
    """How long sorption takes [s]: through the films, through the thickness; they add in good approximation."""

    film: float
    diffusion: float

    @property
    def whole(self) -> float:
        """Both, one after the other."""
        return self.film + self.diffusion


def time_constants(values: Mapping[str, float], state: WaterState) -> TimeConstants:
    """Time constants of sorption for small changes about a state.

    Examples
    --------
    >>> from ipmclab.model.environment.hydration import STANDARD
    >>> strip = {**STANDARD, "geometry.thickness": 0.2e-3}
    >>> found = time_constants(strip, WaterState(7.219, 25.0))
    >>> round(found.film, 1), round(found.diffusion, 2)
    (652.6, 40.53)
    """
    thickness = dry_thickness(values)
    there = min(float(activity(values, state.water_content)), 1.0)
    films = sum(_faces(values))
    steep = float(slope(values, there))
    film = thickness * values[SITES] * steep / (films * float(saturation_concentration(state.temperature)))
    return TimeConstants(film, thickness**2 / (math.pi**2 * values["hydration.diffusivity"]))


def curl(values: Mapping[str, float], gradient: Any) -> Any:
    """Curvature [1/m] of a strip whose faces have different water, positive towards the cathode.

    beta_w g/h: the anode's face has more water where g is positive, and the strip bends away from it.
    """
    return values[SWELLING] * gradient / values["geometry.thickness"]


def curl_displacement(values: Mapping[str, float], gradient: Any) -> Any:
    """Displacement [m] at the sensing point that the curl adds, positive towards the anode, for small bending."""
    return -0.5 * curl(values, gradient) * values["geometry.sensing_length"] ** 2


def electrolysed(charge: float) -> float:
    """Water [kg] that a charge [C] splits.

    Examples
    --------
    10 mA for an hour:

    >>> round(1e6 * electrolysed(36.0), 3)
    3.361
    """
    return WATER_FOR_A_COULOMB * charge


def content_by_mass(
    values: Mapping[str, float], wet: float, dry: float, area: float, thickness: float | None = None
) -> WaterState:
    """The water content from masses: wet and dry strip [kg] over the area of one face [m^2], at its reference
    temperature.

    ``thickness`` [m] is that of the membrane before it was plated; without it the stated one of the strip counts,
    though its metal holds no water.

    Raises
    ------
    InputError
        A wet strip that is not heavier than the dry one.
    """
    if not wet > dry:
        raise InputError(
            f"the wet strip weighs {1e6 * wet:g} mg, the dry one {1e6 * dry:g} mg",
            code="bad-mass",
            where="mass",
            repair="give the wet mass first, then the dry one",
        )
    sites = values[SITES] * (dry_thickness(values) if thickness is None else thickness) * area
    return WaterState((wet - dry) / WATER / sites, reference(values).temperature, origin="measured")


def _faces(values: Mapping[str, float]) -> tuple[float, float]:
    """Mass transfer [m/s] of the anode's and the cathode's face while water leaves."""
    whole, difference = mass_transfer(values), values["hydration.face_difference"]
    return whole * (1.0 - max(0.0, difference)), whole * (1.0 - max(0.0, -difference))


def _membrane(values: Mapping[str, float]) -> Any:
    from ipmclab.model.environment.transport_loop import Membrane

    sites = values[SITES] * dry_thickness(values)
    mixing = dry_thickness(values) ** 2 / (math.pi**2 * values["hydration.diffusivity"])
    anode, cathode = _faces(values)
    scale = values[f"{PREFIX}scale"]
    isotherm = [scale * values[f"{PREFIX}{name}"] for name in COEFFICIENTS]
    return Membrane(
        *(sites, anode, cathode, values["hydration.asymmetry"], 0.5 * sites / mixing, mixing),
        *(values["hydration.thermal_time"], values["hydration.drag"], *isotherm),
    )


def _fastest(values: Mapping[str, float], history: EnvironmentHistory) -> float:
    """The shortest time constant [s] that the content may have in this environment."""
    steep = float(np.min(slope(values, np.linspace(0.0, 1.0, 101))))
    hottest = float(np.max(history.temperature))
    transfer = sum(_faces(values)) / min(1.0, values["hydration.asymmetry"])
    film = dry_thickness(values) * values[SITES] * steep / (transfer * float(saturation_concentration(hottest)))
    return film + dry_thickness(values) ** 2 / (math.pi**2 * values["hydration.diffusivity"])


def _nodes(values: Mapping[str, float], corners: FloatArray, begin: float, end: float, fastest: float) -> FloatArray:
    """Where the course is kept: fine enough for cubics in between, and at each corner of air and leak."""
    lag = values["hydration.thermal_time"]
    step = (min(fastest, lag) if lag > 0.0 else fastest) / 4.0
    count = int(np.clip(math.ceil((end - begin) / step), 1, _MOST_NODES))
    inside = corners[(corners > begin) & (corners < end)]
    return np.unique(np.concatenate([np.linspace(begin, end, count + 1), inside]))
