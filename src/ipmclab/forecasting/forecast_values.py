"""What a forecast gives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.run import Finding
from ipmclab.shown import Shown

FloatArray = npt.NDArray[np.float64]

CHANNELS: Final = ("displacement", "force")

ONLY_HOLDS: Final = 0.9
"""Weight of holding from which a forecast is one of the last value: the others then add less than their band
(convention)."""

_WORDS: Final = {
    "hold": "the last value",
    "line": "the straight line of the last 5 s",
    "slow answer": "the slow answer to the voltage",
    "actuator": "the actuator's answer",
}


@dataclass(frozen=True, eq=False)
class Forecast(Shown):
    """Readings to come, with a band at each time.

    Parameters
    ----------
    channel : str
    origin : float [s]
        The last time that was observed.
    time : float array, shape (n_time,) [s]
    mean, lower, upper : float array, shape (n_time,) [SI]
        Expected reading, and the interval that holds it with probability ``level``.
    level : float
    weights : mapping of name to float
        Of each forecaster, ``hold`` among them; their sum is one.
    horizons_observed : float
        How many horizons of the record weights and band are judged by, older ones less.
    findings : tuple of Finding
        Of the record up to the origin and of the model, where the forecast depends on them.
    """

    channel: str
    origin: float
    time: FloatArray
    mean: FloatArray
    lower: FloatArray
    upper: FloatArray
    level: float
    weights: Mapping[str, float]
    horizons_observed: float
    findings: tuple[Finding, ...] = ()

    @property
    def made_of(self) -> str:
        """Of which simple forecasts it is the sum, in a sentence."""
        hold = self.weights["hold"]
        if hold >= ONLY_HOLDS:
            return (
                f"This forecast only holds the last value (weight {100.0 * hold:.0f} %): nothing else was clearly "
                "nearer earlier in this record. The band says how far off the last value was then."
            )
        parts = sorted(self.weights.items(), key=lambda item: -item[1])
        lines = [f"{_WORDS[name]} ({100.0 * share:.0f} %)" for name, share in parts if share >= 0.005]
        return f"This forecast is made of {', '.join(lines)}."


def known_channel(channel: str) -> None:
    """Refuse a channel that no actuator moves.

    Raises
    ------
    InputError
    """
    if channel not in CHANNELS:
        raise InputError(
            f"{channel!r} cannot be forecast",
            code="unknown-channel",
            where="channel",
            repair=f"give one of {', '.join(CHANNELS)}",
        )
