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


@dataclass(frozen=True, eq=False)
class Forecast(Shown):
    """Readings to come, with a band at each time.

    Parameters
    ----------
    channel : str
    origin : float [s]
        The last time that was seen.
    time : float array, shape (n_time,) [s]
    mean, lower, upper : float array, shape (n_time,) [SI]
        Expected reading, and the interval that holds it with probability ``level``.
    level : float
    weights : mapping of name to float
        Of each forecaster, ``hold`` among them; their sum is one.
    horizons_seen : float
        How many horizons of the record weights and band are judged by, older ones less.
    findings : tuple of Finding
        Of the record up to the origin and of the model, where the forecast hangs on them.
    """

    channel: str
    origin: float
    time: FloatArray
    mean: FloatArray
    lower: FloatArray
    upper: FloatArray
    level: float
    weights: Mapping[str, float]
    horizons_seen: float
    findings: tuple[Finding, ...] = ()


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
