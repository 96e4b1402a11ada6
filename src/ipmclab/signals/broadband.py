"""Signals with many frequencies at once: multisine, binary sequence, random levels."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import ClassVar, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.signals.signal import Signal, whole_periods

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Multisine(Signal):
    """Equal sines at multiples of the lowest frequency, with a low peak for their power.

    Phases are Schroeder's, ``-pi n (n - 1) / N`` for the n-th of N sines, or random; the sum repeats with
    the period of the lowest frequency and is scaled to the stated peak.

    Parameters
    ----------
    amplitude : float [V]
        Peak of the sum.
    lowest_frequency : float [Hz]
        The first harmonic: the signal repeats every ``1 / lowest_frequency``.
    highest_frequency : float [Hz]
        No harmonic lies above it.
    harmonics : "all" or "odd"
        With odd ones, a response at an even multiple shows a nonlinearity.
    offset : float [V]
    delay : float [s]
    phases : "schroeder" or "random"
        Random ones spread what is nonlinear evenly over the frequencies, so that a best linear approximation has a
        meaning: see ``comparison.frequency_response``.
    seed : int
        Of random phases, and of the harmonics that are left out.
    left_out : int
        Of each so many harmonics in a row one, chosen at random, is not there: at an odd multiple that is not driven,
        a response shows an odd nonlinearity. 0 leaves none out.

    Examples
    --------
    >>> print(Multisine(amplitude=1.0, lowest_frequency=0.05, highest_frequency=5.0, harmonics="odd"))
    multisine 1 V 0.05 Hz 5 Hz harmonics=odd
    >>> Multisine(1.0, 1.0, 15.0, harmonics="odd", phases="random", left_out=4).numbers.tolist()
    [1, 3, 5, 9, 11, 13]
    """

    word: ClassVar[str] = "multisine"
    amplitude: float
    lowest_frequency: float
    highest_frequency: float
    harmonics: str = "all"
    offset: float = 0.0
    delay: float = 0.0
    phases: str = "schroeder"
    seed: int = 0
    left_out: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.left_out == 1:
            raise InputError(
                "one of each 1 harmonic is left out, which leaves none",
                code="out-of-range",
                where="left_out",
                repair="give 0, or 2 and more",
            )
        count = self.highest_frequency / self.lowest_frequency
        if not 1.0 - 1e-9 <= count <= 10_000:
            raise InputError(
                f"the highest frequency, {self.highest_frequency:g} Hz, is {count:.4g} times the lowest, "
                f"{self.lowest_frequency:g} Hz",
                code="out-of-range",
                where="highest_frequency",
                repair="give from 1 to 10000 times the lowest frequency",
            )

    @property
    def fastest(self) -> float:
        return self.highest_frequency

    @cached_property
    def numbers(self) -> npt.NDArray[np.int64]:
        """The harmonics that are there, as multiples of the lowest frequency."""
        highest = math.floor(self.highest_frequency / self.lowest_frequency + 1e-9)
        every = np.arange(1, highest + 1, 1 if self.harmonics == "all" else 2)
        if not self.left_out:
            return every
        starts = np.arange(0, len(every) - self.left_out + 1, self.left_out)
        chosen = np.random.Generator(np.random.Philox(key=[self.seed, 1])).random(len(starts))
        return np.delete(every, starts + np.floor(self.left_out * chosen).astype(np.int64))

    @cached_property
    def _coefficients(self) -> npt.NDArray[np.complex128]:
        """Complex amplitude of each harmonic from 0 on; the signal is the real part of their sum."""
        numbers = self.numbers
        highest = math.floor(self.highest_frequency / self.lowest_frequency + 1e-9)
        n = np.arange(1, len(numbers) + 1)
        coefficients = np.zeros(highest + 1, dtype=np.complex128)
        if self.phases == "schroeder":
            phases = -np.pi * n * (n - 1) / len(numbers)
        else:
            phases = math.tau * np.random.Generator(np.random.Philox(key=[self.seed, 0])).random(len(numbers))
        # -1j: a single harmonic is a sine.
        coefficients[numbers] = -1j * np.exp(1j * phases)
        return coefficients * (self.amplitude / _peak(coefficients))

    def _shape(self, time: FloatArray) -> FloatArray:
        around = np.exp(1j * math.tau * np.mod(self.lowest_frequency * time, 1.0))
        waves = np.asarray(np.polynomial.polynomial.polyval(around, self._coefficients).real, dtype=np.float64)
        return self.offset + waves


def _peak(coefficients: npt.NDArray[np.complex128]) -> float:
    """The largest magnitude over a period of the real part of a sum of harmonics."""
    rows = 32 * len(coefficients)
    grid = np.fft.irfft(0.5 * coefficients, rows, norm="forward")
    # The true peak lies within a 64th of the shortest period of one of the high rows; Newton finds it.
    at = np.flatnonzero(np.abs(grid) >= 0.98 * np.abs(grid).max()) * (math.tau / rows)
    orders = 1j * np.arange(len(coefficients))
    polynomial = np.polynomial.polynomial.polyval
    for _ in range(4):
        around = np.exp(1j * at)
        slope = polynomial(around, coefficients * orders).real
        bend = polynomial(around, coefficients * orders**2).real
        at = at - np.clip(slope / np.where(bend == 0.0, np.inf, bend), -math.tau / rows, math.tau / rows)
    return float(max(np.abs(polynomial(np.exp(1j * at), coefficients).real).max(), np.abs(grid).max()))


@dataclass(frozen=True)
class Prbs(Signal):
    """A pseudo-random binary sequence of maximum length: plus or minus the amplitude.

    Parameters
    ----------
    amplitude : float [V]
    bit_time : float [s]
        Time that each bit lasts.
    order : int
        The sequence repeats after ``2**order - 1`` bits.
    seed : int
        The bit of the sequence at which it starts.
    offset : float [V]
    delay : float [s]

    Examples
    --------
    >>> Prbs(amplitude=1.0, bit_time=0.5, order=3).voltage([0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0]).tolist()
    [1.0, 1.0, 1.0, -1.0, 1.0, -1.0, -1.0]
    """

    word: ClassVar[str] = "prbs"
    amplitude: float
    bit_time: float = field(default=0.1, metadata={"unnamed": True})
    order: int = 10
    seed: int = 0
    offset: float = 0.0
    delay: float = 0.0

    @property
    def fastest(self) -> float:
        return 0.5 / self.bit_time

    def _shape(self, time: FloatArray) -> FloatArray:
        bits = _maximum_length_sequence(self.order)
        place = (whole_periods(time, self.bit_time) + self.seed % len(bits)) % len(bits)
        return self.offset + self.amplitude * bits[place]


# Tap of each order in the recurrence b[k] = b[k - order] xor the bits below, from the primitive
# polynomials of Zierler and Brillhart, and of Golomb's "Shift Register Sequences".
_TAPS: Final[dict[int, tuple[int, ...]]] = {
    2: (1,),
    3: (1,),
    4: (1,),
    5: (2,),
    6: (1,),
    7: (1,),
    8: (2, 3, 4),
    9: (4,),
    10: (3,),
    11: (2,),
    12: (1, 4, 6),
    13: (1, 3, 4),
    14: (1, 3, 5),
    15: (1,),
    16: (2, 3, 5),
}


@lru_cache
def _maximum_length_sequence(order: int) -> FloatArray:
    bits = [1] * order
    for k in range(order, 2**order - 1):
        bit = bits[k - order]
        for tap in _TAPS[order]:
            bit ^= bits[k - tap]
        bits.append(bit)
    return 2.0 * np.array(bits) - 1.0


_MOST_LEVELS: Final = 50_000_000
"""Levels of a random signal that are computed at once: about 1 GB."""


@dataclass(frozen=True)
class Random(Signal):
    """Random levels, uniform between minus and plus the amplitude, each held for a time.

    Parameters
    ----------
    amplitude : float [V]
    hold_time : float [s]
        Time that each level lasts.
    seed : int
    offset : float [V]
    delay : float [s]

    Raises
    ------
    InputError
        When a voltage is asked for over more than 50 million levels.

    Examples
    --------
    >>> signal = Random(amplitude=1.0, hold_time=0.5, seed=1)
    >>> bool(signal.voltage(0.2) == signal.voltage(0.4))
    True
    """

    word: ClassVar[str] = "random"
    amplitude: float
    hold_time: float = field(default=0.1, metadata={"unnamed": True})
    seed: int = 0
    offset: float = 0.0
    delay: float = 0.0

    @property
    def fastest(self) -> float:
        return 0.5 / self.hold_time

    def _shape(self, time: FloatArray) -> FloatArray:
        place = whole_periods(time, self.hold_time)
        if place.size == 0:
            return np.zeros_like(time)
        if int(place.max()) - int(place.min()) > _MOST_LEVELS:
            raise InputError(
                f"from {time.min():.9g} s to {time.max():.9g} s there are more than {_MOST_LEVELS} levels of "
                f"{self.hold_time:g} s each",
                code="out-of-range",
                where="hold_time",
                repair="hold each level longer",
            )
        # Philox counts: block n of four levels is had without those before it.
        block = int(place.min()) // 4
        generator = np.random.Philox(key=self.seed)
        generator.advance(block)
        raw = generator.random_raw(int(place.max()) - 4 * block + 1)
        levels: FloatArray = (raw >> np.uint64(11)).astype(np.float64) * 2.0**-52 - 1.0
        return self.offset + self.amplitude * levels[place - 4 * block]
