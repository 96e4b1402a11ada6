"""The way of a strip's water through a run, as the compiled walk along it needs it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.environment.conditions import WaterState
from ipmclab.model.environment.history import EnvironmentHistory
from ipmclab.model.environment.hydration import SWELLING, equilibrium
from ipmclab.model.environment.path import RENEWED
from ipmclab.model.environment.sorption import WATER
from ipmclab.model.environment.transport import WATER_FOR_A_COULOMB, Around, WaterCourse, around, water_course

if TYPE_CHECKING:
    from ipmclab.model.environment.track_loop import Track

FloatArray = npt.NDArray[np.float64]

_LEAST_KEPT: Final = 8
_FOR_CURL: Final = 64
"""Times at which the water of a strip that leaks is kept at least: what leaks depends on the voltage, not on the air.
More where the strip curls, which is read between them in straight lines."""


@dataclass(frozen=True, eq=False)
class Way:
    """Where the water goes but for what leaks.

    Parameters
    ----------
    given : Around
    track : Track
    start : float array, shape (2,)
        Water content and temperature [degC] where it begins.
    begin : float [s]
        Of the record.
    at_begin : WaterState
        There.
    cold, warm : float [degC]
        Between which the temperature stays.
    """

    given: Around
    track: Track
    start: FloatArray
    begin: float
    at_begin: WaterState
    cold: float
    warm: float

    def set_out(self) -> tuple[FloatArray, FloatArray]:
        """A walk that is at the begin of the record, and the array of its course."""
        from ipmclab.model.environment.track_loop import WALK, set_out

        walk, course = np.empty(WALK), np.empty((4, len(self.given.time)))
        set_out(self.track, self.start, self.begin, walk, course)
        return walk, course


def way_of(values: Mapping[str, float], history: EnvironmentHistory, begin: float, end: float, *, leaks: bool) -> Way:
    """The way from time 0 of a history, or the begin of a record where that is before it, to its end [s]."""
    from ipmclab.model.environment.track_loop import Track

    zero = min(0.0, begin)
    least = _FOR_CURL if values[SWELLING] else _LEAST_KEPT
    corners = np.linspace(begin, end, least + 1) if leaks else np.empty(0)
    given = around(values, history, zero, end, corners)
    dry: WaterCourse = water_course(values, history, end - zero, start=history.start, begin=zero)
    first = equilibrium(values, history.at(zero)) if history.start is None else history.start
    split = WATER_FOR_A_COULOMB / WATER / given.membrane.sites
    return Way(
        given=given,
        track=Track(given.membrane, given.time, given.air, given.longest, split, RENEWED),
        start=np.array([first.water_content, first.temperature]),
        begin=begin,
        at_begin=dry.state(begin),
        cold=float(np.min(dry.temperature)),
        warm=float(np.max(dry.temperature)),
    )
