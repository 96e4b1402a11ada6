"""History: an environment that changes while a strip is in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.model.environment.conditions import Environment, WaterState
from ipmclab.run import Run

FloatArray = npt.NDArray[np.float64]

_COLUMNS: Final = ("time", "temperature", "relative_humidity")


@dataclass(frozen=True, eq=False)
class EnvironmentHistory:
    """An environment that changes: straight lines between its points, constant before the first and after the last.

    Parameters
    ----------
    time : float array, shape (n_environment,) [s]
        Increasing; 0 is the first row of the run that it belongs to.
    temperature : float array, shape (n_environment,) [degC]
    relative_humidity : float array, shape (n_environment,) [percent]
    start : WaterState, optional
        Of the strip at 0 s; in equilibrium with the environment there where it is left out.

    Raises
    ------
    InputError
        Unequal lengths, a time that does not increase, a temperature or humidity that is none.

    Examples
    --------
    >>> drying = EnvironmentHistory.of([(0.0, "20 degC, 80 %RH"), (300.0, "20 degC, 50 %RH")])
    >>> drying.at(150.0)
    Environment(temperature=20.0, relative_humidity=65.0, in_water=False)
    """

    time: FloatArray
    temperature: FloatArray
    relative_humidity: FloatArray
    start: WaterState | None = None

    def __post_init__(self) -> None:
        columns = {name: np.atleast_1d(np.array(getattr(self, name), dtype=np.float64)) for name in _COLUMNS}
        lengths = {len(column) for column in columns.values()}
        if len(lengths) != 1 or not all(column.ndim == 1 and len(column) for column in columns.values()):
            raise InputError(
                f"the columns of this environment have {', '.join(str(len(c)) for c in columns.values())} values",
                code="unequal-lengths",
                where="environment",
                repair="give as many times as temperatures and humidities, at least one",
            )
        if not np.all(np.isfinite(columns["time"])) or np.any(np.diff(columns["time"]) <= 0.0):
            raise InputError(
                "the times of this environment do not increase",
                code="bad-time",
                where="environment.time",
                repair="give increasing times in seconds",
            )
        for temperature, humidity in zip(columns["temperature"], columns["relative_humidity"], strict=True):
            Environment(float(temperature), float(humidity))
        for name, column in columns.items():
            column.flags.writeable = False
            object.__setattr__(self, name, column)

    @classmethod
    def of(cls, points: Any, start: WaterState | None = None) -> EnvironmentHistory:
        """From pairs of a time [s] and an environment (or its text); or one environment for all times.

        Raises
        ------
        InputError
            What is no environment, or a strip in water, which is a state that it starts from.
        """
        if isinstance(points, EnvironmentHistory):
            return points
        if isinstance(points, (Environment, str)):
            points = [(0.0, points)]
        read = [(time, Environment.parse(one) if isinstance(one, str) else one) for time, one in points]
        if any(one.in_water for _, one in read):
            raise InputError(
                "a history is one of air, and here the strip lies in water",
                code="bad-environment",
                where="environment",
                repair="give the air that follows, and the water as the state at the start",
            )
        return cls(
            np.array([time for time, _ in read]),
            np.array([one.temperature for _, one in read]),
            np.array([one.relative_humidity for _, one in read]),
            start,
        )

    @classmethod
    def of_run(cls, run: Run, start: WaterState | None = None) -> EnvironmentHistory:
        """The air that was read during a run.

        Raises
        ------
        InputError
            A run without readings of temperature and humidity.
        """
        if run.temperature is None or run.relative_humidity is None:
            raise InputError(
                "temperature and humidity were not both read during this run",
                code="no-environment",
                where="environment",
                repair="give the environment yourself, such as '20 degC, 80 %RH'",
            )
        time = run.time if run.time_environment is None else run.time_environment
        known = np.isfinite(run.temperature) & np.isfinite(run.relative_humidity)
        return cls(time[known], run.temperature[known], np.clip(run.relative_humidity[known], 0.0, 100.0), start)

    def at(self, time: float) -> Environment:
        """The environment at one time [s]."""
        temperature, humidity = (float(np.interp(time, self.time, column)) for column in self._air)
        return Environment(temperature, humidity)

    @property
    def _air(self) -> tuple[FloatArray, FloatArray]:
        return self.temperature, self.relative_humidity

    @property
    def key(self) -> tuple[bytes, ...]:
        """The same for equal histories."""
        return (
            self.time.tobytes(),
            self.temperature.tobytes(),
            self.relative_humidity.tobytes(),
            repr(self.start).encode(),
        )
