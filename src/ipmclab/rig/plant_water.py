"""The water of a strip in the plant: it follows the air around it, and the strip's parameters follow the water."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.environment import Environment
from ipmclab.model.environment.history import EnvironmentHistory
from ipmclab.model.environment.hydration import SWELLING, equilibrium
from ipmclab.model.environment.transport import WaterCourse, curl_displacement, water_course

if TYPE_CHECKING:
    from ipmclab.model import Actuator
    from ipmclab.model.environment import WaterState

FloatArray = npt.NDArray[np.float64]

RENEWED: Final = 10.0
"""How often [s] the water is looked at: a strip takes minutes to follow its air."""

_MOVED: Final = 2e-3
"""How far a parameter moves, as a share of itself, before the strip is another one: as where ``simulate`` drifts."""

Air = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""From times [s] to temperature [degC] and relative humidity [percent]."""


class StripWater:
    """What a strip with laws of the environment, or with water in it, is at the moment.

    Parameters
    ----------
    actuator : Actuator
        With laws or a table ``[hydration]``.
    air : function of times [s] to temperature [degC] and relative humidity [percent]
    now : float [s]
    wet : bool
        Whether it has just been taken out of its water; otherwise it is in equilibrium with the air at first.

    Examples
    --------
    A strip that gives more water through one face than through the other curls while it dries:

    >>> from dataclasses import replace
    >>> from ipmclab import load_actuator
    >>> from ipmclab.model.environment.hydration import STANDARD
    >>> known = {"hydration.linear_swelling": 0.01, "hydration.face_difference": 0.1}
    >>> strip = load_actuator("friend-2")
    >>> strip = replace(strip, parameter_values={**strip.parameter_values, **STANDARD, **known})
    >>> air = lambda times: (np.full(len(times), 22.0), np.full(len(times), 45.0))
    >>> drying, settled = (StripWater(strip, air, 0.0, wet=wet) for wet in (True, False))
    >>> [f"{1e3 * abs(one.curl(np.array([60.0]))[0]):.1f} mm" for one in (drying, settled)]
    ['0.5 mm', '0.0 mm']
    """

    def __init__(self, actuator: Actuator, air: Air, now: float, *, wet: bool = False) -> None:
        self._laws = actuator
        self._air = air
        self._now = now
        self._gradient = 0.0
        here, values = self._environment(now), actuator.parameter_values
        self._state: WaterState | None = None
        if actuator.structure.hydration:
            self._state = equilibrium(values, Environment(here.temperature, 100.0, in_water=True) if wet else here)
        self.strip = actuator.at(here if self._state is None else self._state)

    def follow(self, now: float) -> bool:
        """Come to a later time [s]; True where ``strip`` is another one then."""
        if now - self._now < RENEWED:
            return False
        if self._state is not None:
            course = self._course(now)
            self._state, self._gradient = course.state(now), float(course.gradient[-1])
        self._now = now
        there = self._laws.at(self._environment(now) if self._state is None else self._state)
        before, after = (np.array(list(one.parameter_values.values())) for one in (self.strip, there))
        if np.all(np.abs(after - before) <= _MOVED * np.abs(before)):
            return False
        self.strip = there
        return True

    def curl(self, times: FloatArray) -> FloatArray:
        """What the water through its thickness adds to the displacement [m] at some times from now on [s]."""
        values = self._laws.parameter_values
        if self._state is None or not values[SWELLING] or not len(times):
            return np.zeros(len(times))
        if times[-1] <= self._now:
            return np.full(len(times), curl_displacement(values, self._gradient))
        gradients = self._course(float(times[-1])).gradients(times)
        return np.asarray(curl_displacement(values, gradients), dtype=np.float64)

    def _course(self, until: float) -> WaterCourse:
        times = np.linspace(self._now, until, 2 + int((until - self._now) / RENEWED))
        return water_course(
            self._laws.parameter_values,
            EnvironmentHistory(times, *self._air(times)),
            until - self._now,
            start=self._state,
            begin=self._now,
            gradient=self._gradient,
        )

    def _environment(self, now: float) -> Environment:
        temperature, humidity = self._air(np.array([now]))
        return Environment(float(temperature[0]), float(humidity[0]))
