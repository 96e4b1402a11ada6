"""The water of a strip in the plant: it follows the air around it, and the strip's parameters follow the water."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.environment import Environment
from ipmclab.model.environment.history import EnvironmentHistory
from ipmclab.model.environment.hydration import equilibrium
from ipmclab.model.environment.transport import water_course

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
    """What a strip with laws of the environment is at the moment.

    Parameters
    ----------
    actuator : Actuator
        With laws; in equilibrium with the air at first.
    air : function of times [s] to temperature [degC] and relative humidity [percent]
    now : float [s]
    """

    def __init__(self, actuator: Actuator, air: Air, now: float) -> None:
        self._laws = actuator
        self._air = air
        self._now = now
        here = self._environment(now)
        self._state = equilibrium(actuator.parameter_values, here) if actuator.structure.hydration else None
        self.strip = actuator.at(here if self._state is None else self._state)

    def follow(self, now: float) -> bool:
        """Come to a later time [s]; True where ``strip`` is another one then."""
        if now - self._now < RENEWED:
            return False
        self._state = self._later(now)
        self._now = now
        there = self._laws.at(self._environment(now) if self._state is None else self._state)
        before, after = (np.array(list(one.parameter_values.values())) for one in (self.strip, there))
        if np.all(np.abs(after - before) <= _MOVED * np.abs(before)):
            return False
        self.strip = there
        return True

    def _later(self, now: float) -> WaterState | None:
        if self._state is None:
            return None
        times = np.linspace(self._now, now, 2 + int((now - self._now) / RENEWED))
        history = EnvironmentHistory(times, *self._air(times))
        values = self._laws.parameter_values
        return water_course(values, history, now - self._now, start=self._state, begin=self._now).state(now)

    def _environment(self, now: float) -> Environment:
        temperature, humidity = self._air(np.array([now]))
        return Environment(float(temperature[0]), float(humidity[0]))
