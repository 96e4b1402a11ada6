"""The state of the strip in each run of a fit, as people read it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from ipmclab.units import significant

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit

HEAD: Final = ("run", "temperature", "humidity", "water content", "known", "found", "dose")


@dataclass(frozen=True)
class StateRow:
    """One run: its air, its water content with its standard uncertainty, how that is known, what was found, its dose.

    The water content is in molecules of water for each ionic group.
    """

    run: str
    temperature: str
    humidity: str
    water_content: str
    how: str
    found: str
    dose: str

    @property
    def cells(self) -> list[str]:
        """In the order of ``HEAD``."""
        return [self.run, self.temperature, self.humidity, self.water_content, self.how, self.found, self.dose]


def state_rows(fit: Fit) -> list[StateRow]:
    """One row for each run whose state counts; none where nothing follows the environment and nothing ages.

    Examples
    --------
    >>> from ipmclab import identify, load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> state_rows(identify(strip, simulate(strip, "step 1 V", duration=20, rate=50)))
    []
    """
    rows = []
    for observation in fit.observations:
        state = observation.state
        if state is None:
            continue
        water, how = "-", "-"
        if state.water_content is not None:
            how = state.how
            water = f"{state.water_content:.3g} ± {significant(state.standard_uncertainty, 2)}"
        rows.append(
            StateRow(
                observation.label,
                "-" if state.temperature is None else f"{state.temperature:.3g} degC",
                "-" if state.relative_humidity is None else f"{state.relative_humidity:.3g} %RH",
                water,
                how,
                "-" if state.found is None else f"{state.found:.3g}",
                ", ".join(f"{value:.4g} {_UNITS[scale]}" for scale, value in state.doses.items()) or "-",
            )
        )
    return rows


_UNITS: Final = {"runs": "runs", "hours": "h", "charge": "C"}
