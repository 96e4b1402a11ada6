"""What a forecast takes for granted, and what it gives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.run import Finding

FloatArray = npt.NDArray[np.float64]

CHANNELS: Final = ("displacement", "force")


@dataclass(frozen=True)
class ForecastSettings:
    """What a forecast takes for granted.

    Parameters
    ----------
    memory : float [s]
        How long the disturbance goes on as it went.
    span : float [s]
        How far ahead the forecasts of the past are made by which the strength of the disturbance is judged.
    amplitude : float [SI unit of the channel per V], optional
        Standard deviation, before any reading, of what each slow mode does per volt. Left out: half of the largest
        excursion up to the origin, per volt.
    curl : float [SI unit of the channel per s], optional
        Standard deviation by which the drift after the first edge differs from that before it. Left out: a hundredth
        of the largest excursion per second.
    settle : float [s]
        After the first edge, readings that are left out: where the response is steepest, a row of delay or a fast mode
        that is not quite right would be taken for slow ones.
    contact : float
        Share of ``amplitude`` by which the modes start anew when a lost contact comes back.
    step : float [s]
        Readings are averaged over steps of this length.
    """

    memory: float = 0.3
    span: float = 4.0
    amplitude: float | None = None
    curl: float | None = None
    settle: float = 2.0
    contact: float = 0.3
    step: float = 0.2

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if value is None:
                continue
            least = 0.0 if name in ("amplitude", "curl", "settle", "contact") else math.ulp(0.0)
            if not (isinstance(value, (int, float)) and least <= value < math.inf):
                raise InputError(
                    f"{name} is {value!r}, it must be a number {'from' if least == 0.0 else 'above'} 0",
                    code="bad-setting",
                    where=f"settings.{name}",
                    repair="give it in SI units, such as ForecastSettings(memory=0.3, span=4.0)",
                )


@dataclass(frozen=True, eq=False)
class Forecast:
    """Readings to come, as a normal distribution at each time.

    Parameters
    ----------
    channel : str
    origin : float [s]
        The last time that was seen.
    time : float array, shape (n_time,) [s]
    mean, lower, upper : float array, shape (n_time,) [SI]
        Expected reading, and the central interval that holds it with probability ``level``.
    standard_deviation : float array, shape (n_time,) [SI]
    level : float
    settings : ForecastSettings
        Those used, with what was left out filled in.
    coefficients : mapping of name to (mean, standard deviation) [SI]
        The parameters of the actuator that were learnt from the record, ``curl`` [SI/s] beside them.
    findings : tuple of Finding
        Of the record up to the origin and of the model, where the forecast hangs on them.
    """

    channel: str
    origin: float
    time: FloatArray
    mean: FloatArray
    lower: FloatArray
    upper: FloatArray
    standard_deviation: FloatArray
    level: float
    settings: ForecastSettings
    coefficients: Mapping[str, tuple[float, float]]
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
