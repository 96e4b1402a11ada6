"""A chamber that exists only as a model: its air lags, overshoots and drifts, and its faults can be called up."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.environment.sorption import saturation_pressure
from ipmclab.rig.chambers.chamber import ChamberError, Conditions, Mode, Ranges, Stillness

FloatArray = npt.NDArray[np.float64]

STEP: Final = 1.0
"""The air is computed in steps of so long [s]: it changes within minutes."""


RANGES: Final = Ranges((-10.0, 100.0), (10.0, 98.0))


@dataclass(frozen=True)
class VirtualClimate:
    """How the air of a virtual chamber behaves.

    Parameters
    ----------
    ranges : Ranges
    temperature_time, vapour_time : float [s]
        Time constants with which its temperature and the pressure of its vapour follow what they are regulated to;
        ten times ``STEP`` at least.
    damping : float
        Of the temperature: below 1 it overshoots.
    room_temperature : float [degC], room_humidity : float [percent]
        Of the air outside, and of that inside at first.
    leak_temperature, leak_vapour : float [s]
        Time constants with which the air goes to that outside while nothing regulates it.
    temperature_noise : float [K], humidity_noise : float [percent]
        Standard deviation of a reading of its own sensors.
    """

    ranges: Ranges = RANGES
    temperature_time: float = 180.0
    vapour_time: float = 300.0
    damping: float = 0.6
    room_temperature: float = 22.0
    room_humidity: float = 45.0
    leak_temperature: float = 2400.0
    leak_vapour: float = 1200.0
    temperature_noise: float = 0.15
    humidity_noise: float = 1.0


class VirtualChamber:
    """A simulated chamber.

    The temperature follows its set point as a damped oscillator, so that it overshoots. The humidity is that of a
    vapour pressure, which lags behind its set point: a change of the temperature changes the relative humidity at once.
    While the chamber is still, in standby or off, the air goes slowly towards that of the room.

    Parameters
    ----------
    clock : callable
        The time [s], such as that of a virtual bench; that of the computer where it is left out.
    climate : VirtualClimate, optional
    seed : int
        Of the noise of its sensors.

    Examples
    --------
    >>> now = 0.0
    >>> chamber = VirtualChamber(lambda: now)
    >>> chamber.set(30.0, 60.0)
    >>> now = 3600.0
    >>> temperature, humidity = chamber.air(np.array([600.0, 3600.0]))
    >>> temperature.round(1).tolist(), humidity.round(0).tolist()
    ([30.6, 30.0], [49.0, 60.0])
    >>> chamber.read().mode, chamber.still(120.0).humidity_drift < 2.0, chamber.safe(), chamber.read().mode
    ('constant', True, None, 'standby')
    """

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        climate: VirtualClimate | None = None,
        *,
        seed: int = 0,
    ) -> None:
        self.climate = climate or VirtualClimate()
        self.silent = False
        """Whether it answers nothing."""
        self.tank_empty = False
        """Whether it has no water: the humidity falls, and it raises an alarm."""
        self.alarms: tuple[str, ...] = ()
        """Further alarms that it raises."""
        self._clock = clock
        self._lock = threading.RLock()
        self._noise = np.random.default_rng([seed, 17])
        self._mode: Mode = "off"
        self._is_still = False
        self._asked: tuple[float, float | None] | None = None
        vapour = _vapour(self.climate.room_temperature, self.climate.room_humidity)
        # One row a step: temperature [degC], its slope [K/s], pressure of the vapour [Pa].
        self._states = [(self.climate.room_temperature, 0.0, vapour)]
        self._origin = clock()

    @property
    def ranges(self) -> Ranges:
        """What it can be set to."""
        return self.climate.ranges

    @property
    def is_shaking(self) -> bool:
        """Whether its fan runs."""
        return self._mode == "constant" and not self._is_still

    def set(self, temperature: float, relative_humidity: float | None) -> None:
        """Regulate towards these from now on: see ``Chamber.set``."""
        self.ranges.check(temperature, relative_humidity)
        with self._changing():
            self._asked, self._mode, self._is_still = (temperature, relative_humidity), "constant", False

    def read(self) -> Conditions:
        """What it is like now: see ``Chamber.read``."""
        self._answer()
        now = self._clock()
        temperature, humidity = (float(values[0]) for values in self.air(np.array([now])))
        with self._lock:
            noise = self._noise.standard_normal(2)
            asked = self._asked if self._mode == "constant" and self._asked is not None else (None, None)
            return Conditions(
                now,
                round(temperature + self.climate.temperature_noise * noise[0], 1),
                round(min(max(humidity + self.climate.humidity_noise * noise[1], 0.0), 100.0), 1),
                self._mode,
                (*(["water tank empty"] if self.tank_empty else []), *self.alarms),
                *asked,
            )

    def still(self, longest: float) -> Stillness:
        """Fan and compressor off: see ``Chamber.still``."""
        with self._changing():
            self._is_still = True
        temperature, humidity = (float(values[0]) for values in self.air(np.array([self._clock()])))
        climate = self.climate
        drifts = [
            abs(there - here) * -math.expm1(-longest / lasts)
            for here, there, lasts in (
                (temperature, climate.room_temperature, climate.leak_temperature),
                (humidity, climate.room_humidity, climate.leak_vapour),
            )
        ]
        return Stillness(longest, *drifts)

    def resume(self) -> None:
        """Regulate again: see ``Chamber.resume``."""
        with self._changing():
            self._is_still = False

    def safe(self) -> None:
        """Standby: see ``Chamber.safe``."""
        with self._changing():
            self._mode, self._is_still = "standby", False

    def close(self) -> None:
        """Nothing is held."""

    def air(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The air in it, as it is and not as its sensors read.

        Parameters
        ----------
        times : float array [s]
            On the clock of the chamber; before its start, and before the last change of its settings, the air is as it
            was then.

        Returns
        -------
        temperature : float array [degC]
        relative_humidity : float array [percent]
        """
        with self._lock:
            places = (np.asarray(times, dtype=np.float64) - self._origin) / STEP
            self._compute(math.ceil(max(0.0, float(np.max(places, initial=0.0)))))
            first = max(0, math.floor(float(np.min(places, initial=len(self._states)))))
            first = min(first, len(self._states) - 1)
            nodes = np.array(self._states[first:])
        at = np.arange(first, first + len(nodes))
        temperature, vapour = (np.interp(places, at, nodes[:, column]) for column in (0, 2))
        return temperature, np.clip(100.0 * vapour / saturation_pressure(temperature), 0.0, 100.0)

    @contextmanager
    def _changing(self) -> Iterator[None]:
        """A block in which settings change: what was computed beyond now is computed again."""
        self._answer()
        with self._lock:
            self._cut()
            yield

    def _cut(self) -> None:
        """Let the steps begin now, with the air as it is."""
        now = self._clock()
        place = max(0.0, (now - self._origin) / STEP)
        self._compute(math.ceil(place))
        before, part = math.floor(place), place - math.floor(place)
        here, there = self._states[before], self._states[min(before + 1, len(self._states) - 1)]
        joined = [(1.0 - part) * a + part * b for a, b in zip(here, there, strict=True)]
        self._states, self._origin = [(joined[0], joined[1], joined[2])], max(now, self._origin)

    def _compute(self, last: int) -> None:
        """Continue until there is a node of that number."""
        climate = self.climate
        regulated = self._mode == "constant" and not self._is_still and self._asked is not None
        stiffness = 1.0 / climate.temperature_time**2
        room = _vapour(climate.room_temperature, climate.room_humidity)
        while len(self._states) <= last:
            temperature, slope, vapour = self._states[-1]
            if regulated:
                assert self._asked is not None
                wanted, humidity = self._asked
                pull = stiffness * (wanted - temperature) - 2.0 * climate.damping / climate.temperature_time * slope
                slope += STEP * pull
                temperature += STEP * slope
            else:
                humidity, slope = None, 0.0
                temperature += (climate.room_temperature - temperature) * STEP / climate.leak_temperature
            if humidity is None or self.tank_empty:
                vapour += (room - vapour) * STEP / climate.leak_vapour
            else:
                vapour += (_vapour(temperature, humidity) - vapour) * STEP / climate.vapour_time
            # What is beyond saturation is dew.
            self._states.append((temperature, slope, min(vapour, _vapour(temperature, 100.0))))

    def _answer(self) -> None:
        """Raises ChamberError where it is silent."""
        if self.silent:
            raise ChamberError(
                "it does not answer",
                code="chamber-silent",
                where="virtual chamber",
                repair="see that it is switched on and its cable is plugged in",
            )


def _vapour(temperature: float, relative_humidity: float) -> float:
    """The pressure of the vapour [Pa]."""
    return relative_humidity / 100.0 * float(saturation_pressure(temperature))
