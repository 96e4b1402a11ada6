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
    shared : mapping of name to float
        By how much the water content is off where something that other runs rest on too is off by its standard
        uncertainty: the ionic groups of weighed runs, the film of air, the content in liquid water, the state in a run
        before. The squares of these are parts of that of ``standard_uncertainty``.
    tangent : (float, float), optional
        The water content with nothing of that off and its standard uncertainty, along the tangent at what readings say
        of it; None where these are ``water_content`` and ``standard_uncertainty``.
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
    shared: Mapping[str, float] = field(default_factory=dict)
    tangent: tuple[float, float] | None = None

    @property
    def known(self) -> tuple[float, float]:
        """The water content as a fit takes it to be known, and its standard uncertainty."""
        assert self.water_content is not None
        return self.tangent or (self.water_content, self.standard_uncertainty)

    @property
    def own_uncertainty(self) -> float:
        """The part of the standard uncertainty that no other run has."""
        return math.sqrt(max(self.known[1] ** 2 - sum(part**2 for part in self.shared.values()), 0.0))

    def content_at(self, off: Mapping[str, float]) -> float:
        """The water content where what is shared is off by so many standard uncertainties, along the tangent."""
        return self.known[0] + sum(part * off.get(name, 0.0) for name, part in self.shared.items())

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
        tangent = table.get("tangent")
        return cls(**{**table, "tangent": None if tangent is None else (tangent[0], tangent[1])})
