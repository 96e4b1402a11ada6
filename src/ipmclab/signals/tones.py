"""A step, the periodic signals, and the chirp."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.signals.signal import EDGE, Signal, shortened, write_value

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Step(Signal):
    """A constant voltage.

    Parameters
    ----------
    amplitude : float [V]
    delay : float [s]
        It is 0 V before.

    Examples
    --------
    >>> Step(amplitude=1.0, delay=2.0).voltage([0.0, 1.0, 2.0, 3.0]).tolist()
    [0.0, 0.0, 1.0, 1.0]
    """

    word: ClassVar[str] = "step"
    amplitude: float
    delay: float = 0.0

    def _shape(self, time: FloatArray) -> FloatArray:
        return np.full_like(time, self.amplitude)


@dataclass(frozen=True)
class _Periodic(Signal):
    amplitude: float
    frequency: float
    phase: float = 0.0
    offset: float = 0.0
    delay: float = 0.0

    @property
    def fastest(self) -> float:
        return self.frequency

    def _cycles(self, time: FloatArray) -> FloatArray:
        return self.frequency * time + self.phase / math.tau


@dataclass(frozen=True)
class _Wave(_Periodic):
    def check_fits(self, duration: float, rate: float = math.inf) -> None:
        super().check_fits(duration, rate)
        if 2.0 * self.frequency >= rate:
            raise InputError(
                f"rows at {rate:.9g} Hz show the same two places of each of its periods: of a sine only the zeros",
                code="signal-too-fast",
                where=f"signal {shortened(str(self))!r}",
                repair=f"give a rate above {write_value('frequency', 2.0 * self.frequency)}, or a slower signal",
            )

    def _shape(self, time: FloatArray) -> FloatArray:
        # Whole periods are dropped before the trigonometry, which loses digits at large angles.
        return self.offset + self.amplitude * self._unit(np.mod(self._cycles(time), 1.0))

    @abstractmethod
    def _unit(self, cycle: FloatArray) -> FloatArray:
        """The shape for an amplitude of 1, at a place in its period from 0 to 1."""


@dataclass(frozen=True)
class Sine(_Wave):
    """A sine: ``offset + amplitude sin(2 pi frequency (t - delay) + phase)``.

    Parameters
    ----------
    amplitude : float [V]
        Peak, not peak to peak.
    frequency : float [Hz]
    phase : float [rad]
    offset : float [V]
    delay : float [s]
        It is 0 V before; the offset starts with the sine.

    Examples
    --------
    >>> print(Sine(amplitude=1.0, frequency=0.1, delay=1.0))
    sine 1 V 0.1 Hz delay=1 s
    """

    word: ClassVar[str] = "sine"

    def _unit(self, cycle: FloatArray) -> FloatArray:
        return np.sin(math.tau * cycle)


@dataclass(frozen=True)
class Cosine(_Wave):
    """A cosine; its parameters are those of ``Sine``.

    Examples
    --------
    >>> Cosine(amplitude=2.0, frequency=0.5).voltage([0.0, 1.0]).tolist()
    [2.0, -2.0]
    """

    word: ClassVar[str] = "cosine"

    def _unit(self, cycle: FloatArray) -> FloatArray:
        return np.cos(math.tau * cycle)


@dataclass(frozen=True)
class Square(_Periodic):
    """A square wave, positive while a sine of the same phase is; its parameters are those of ``Sine``.

    Its edges fall on the right row although ``k / rate`` is inexact: at 0.1 Hz and 50 S/s
    exactly on rows 250, 500, ...

    Examples
    --------
    >>> Square(amplitude=1.0, frequency=0.1).voltage([4.98, 5.0]).tolist()
    [1.0, -1.0]
    """

    word: ClassVar[str] = "square"

    def _shape(self, time: FloatArray) -> FloatArray:
        # The phase is inexact in itself, by a few parts in 1e16 of a period.
        halves = np.floor(2.0 * (self._cycles(time) + self.frequency * EDGE + 1e-12))
        return self.offset + self.amplitude * (1.0 - 2.0 * np.mod(halves, 2.0))


@dataclass(frozen=True)
class Triangle(_Wave):
    """A triangle in phase with a sine; its parameters are those of ``Sine``.

    The thesis's triangle, ``sawtooth(t, 0.5)``, starts at its lowest point: ``phase=-90 deg``.

    Examples
    --------
    >>> Triangle(amplitude=1.0, frequency=0.25).voltage([0.0, 0.5, 1.0, 2.0, 3.0]).tolist()
    [0.0, 0.5, 1.0, 0.0, -1.0]
    """

    word: ClassVar[str] = "triangle"

    def _unit(self, cycle: FloatArray) -> FloatArray:
        return 1.0 - np.abs(4.0 * np.mod(cycle + 0.25, 1.0) - 2.0)


@dataclass(frozen=True)
class Chirp(Signal):
    """A sine whose frequency grows (or falls) by equal ratios in equal times, then stays.

    Parameters
    ----------
    amplitude : float [V]
    start_frequency, end_frequency : float [Hz]
    sweep_time : float [s]
        Time from the start to the end frequency.
    phase : float [rad]
        At the start.
    offset : float [V]
    delay : float [s]

    Examples
    --------
    >>> print(Chirp(amplitude=1.0, start_frequency=0.05, end_frequency=5.0, sweep_time=100.0))
    chirp 1 V 0.05 Hz 5 Hz sweep_time=100 s
    """

    word: ClassVar[str] = "chirp"
    amplitude: float
    start_frequency: float
    end_frequency: float
    sweep_time: float = 40.0
    phase: float = 0.0
    offset: float = 0.0
    delay: float = 0.0

    @property
    def fastest(self) -> float:
        return max(self.start_frequency, self.end_frequency)

    @property
    def reach(self) -> float:
        return self.delay + self.sweep_time

    def check_fits(self, duration: float, rate: float = math.inf) -> None:
        try:
            super().check_fits(duration, rate)
        except InputError as error:
            if error.code == "signal-too-long" and self.delay < duration:
                ratio = self.end_frequency / self.start_frequency
                there = self.start_frequency * ratio ** ((duration - self.delay) / self.sweep_time)
                error.message += f": it would get to {there:.3g} Hz of {self.end_frequency:.9g} Hz"
                left = write_value("sweep_time", float(f"{duration - self.delay:.9g}"))
                error.repair = f"record longer, or give sweep_time={left}"
            raise

    def _shape(self, time: FloatArray) -> FloatArray:
        growth = math.log(self.end_frequency / self.start_frequency) / self.sweep_time
        swept = np.minimum(time, self.sweep_time)
        # The integral of start_frequency exp(growth t); expm1 keeps its digits for a slow growth.
        sweeping = np.expm1(growth * swept) / growth if growth else swept
        cycles = self.start_frequency * sweeping + self.end_frequency * (time - swept)
        return self.offset + self.amplitude * np.sin(math.tau * np.mod(cycles, 1.0) + self.phase)
