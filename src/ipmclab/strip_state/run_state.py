"""In which state a strip was in one run: its water, its temperature, what it had been through."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from ipmclab.tabled import Tabled

How = Literal["measured", "computed", "assumed"]
"""How the water content of a run is known: from a mass, from the history of temperature and humidity, or as that of
equilibrium."""


@dataclass(frozen=True)
class RunState(Tabled):
    """The state of a strip in one run.

    Parameters
    ----------
    water_content : float, optional
        Water molecules for each ionic group, as it was measured, computed or assumed. None where nothing follows it.
    standard_uncertainty : float
        Of the water content; 0 where it is exact.
    shared_uncertainty : float
        The part of it that is the same error in all weighed runs of the strip: that of its ionic groups.
    how : "measured", "computed" or "assumed"
        How the water content is known.
    temperature : float [degC], optional
    relative_humidity : float [percent], optional
        Of the air; None in liquid water.
    humidity_uncertainty : float [percent]
        Standard uncertainty of the humidity, where the water content is assumed in equilibrium with it.
    doses : mapping of scale to float
        What the strip had been through before: ``runs``, ``hours`` [h], ``charge`` [C]; those that parameters age with.
    adds : mapping of scale to float
        What the run itself adds to them.
    found : float, optional
        The water content at which the readings are met best.
    """

    water_content: float | None = None
    standard_uncertainty: float = 0.0
    how: How = "assumed"
    temperature: float | None = None
    relative_humidity: float | None = None
    humidity_uncertainty: float = 0.0
    doses: Mapping[str, float] = field(default_factory=dict)
    adds: Mapping[str, float] = field(default_factory=dict)
    found: float | None = None
    shared_uncertainty: float = 0.0

    @property
    def place(self) -> tuple[float, float]:
        """Where a wet strip lies among others: the logarithm of its water content, and its temperature in 50 K."""
        assert self.water_content is not None
        assert self.temperature is not None
        return math.log(self.water_content), self.temperature / 50.0

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> RunState:
        """Read what ``to_table`` gave.

        Examples
        --------
        >>> state = RunState(7.2, 0.4, "assumed", temperature=20.0, relative_humidity=80.0)
        >>> RunState.from_table(state.to_table()) == state
        True
        """
        return cls(**table)
