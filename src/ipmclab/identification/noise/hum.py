"""A hum in residuals: one frequency that is there from the first row to the last, and not in the voltage."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.noise.pieces import Key
from ipmclab.run import FloatArray

_REJECT: Final = 1e-4  # asked of every output of every run, of which few have a hum
_FEWEST: Final = 200  # rows: fewer have no spectrum to stand out of
_SLOWEST: Final = 8  # periods in the record: what is slower is drift
_AROUND: Final = 10  # neighbours in the spectrum of the voltage
_STANDS_OUT: Final = 5.0  # times their median
_PERIODIC: Final = 4  # periods in the record from which a voltage has multiples
_MULTIPLES: Final = 9  # of a periodic voltage: higher ones are below its noise
_UNEVEN: Final = 2.0  # times, by which a ring that dies away is larger in the first half


class Hum(NamedTuple):
    """A frequency [Hz], and the amplitude of its sine [SI]."""

    frequency: float
    amplitude: float


def hum_in(correlated: Correlated, key: Key) -> Hum | None:
    """The hum in what is left of one output of one run; None where there is none.

    Fisher's test (1929) of the largest ordinate of the periodogram, at 0.01 %.

    Parameters
    ----------
    correlated : Correlated
    key : (place, output)
    """
    problem, piece = correlated.problem, correlated.problem.pieces[key]
    run, reading = problem.record_at(key[0]).run, problem.readings[key]
    inside, rows = reading.exact_of_used, np.flatnonzero(reading.exact)
    time = run.time[rows]
    if len(rows) < _FEWEST or np.ptp(np.diff(time)) > 1e-3 * float(time[1] - time[0]):
        return None
    power = _spectrum(correlated.whitened.residual[piece][inside])
    peak = int(np.argmax(power[_SLOWEST:])) + _SLOWEST
    share = float(power[peak] / power[1:].sum())
    if len(power) * math.exp(-share * len(power)) > _REJECT:
        return None
    left = correlated.plain.residual[piece][inside] * problem.noise[key]
    frequency = _frequency(left, peak, time)
    if _is_of_the_drive(run.voltage[rows], peak, frequency, time):
        return None
    middle = len(left) // 2
    first, second = (_amplitude(left[h], frequency, time[h]) for h in (slice(middle), slice(middle, None)))
    if not 1.0 / _UNEVEN < first / max(second, 1e-300) < _UNEVEN:
        return None
    return Hum(frequency, 0.5 * (first + second))


def _is_of_the_drive(voltage: FloatArray, peak: int, frequency: float, time: FloatArray) -> bool:
    """Whether the voltage has a line there, or one of which it is a multiple: the model leaves something there."""
    drive = _spectrum(voltage)
    if drive[peak] > _STANDS_OUT * np.median(drive[max(1, peak - _AROUND) : peak + _AROUND + 1]):
        return True
    first = int(np.argmax(drive))
    if first < _PERIODIC:
        return False
    ratio = frequency / _frequency(voltage - voltage.mean(), first, time)
    return round(ratio) <= _MULTIPLES and abs(ratio - round(ratio)) * first <= 1.0


def _frequency(values: FloatArray, line: int, time: FloatArray) -> float:
    """Of a line of the spectrum [Hz], between its neighbours too."""
    near = (line + np.linspace(-0.5, 0.5, 11)) / (len(time) * float(time[1] - time[0]))
    return float(max(near, key=lambda one: _amplitude(values, one, time)))


def _spectrum(values: FloatArray) -> FloatArray:
    return np.asarray(np.abs(np.fft.rfft(values - values.mean())) ** 2)


def _amplitude(values: FloatArray, frequency: float, time: FloatArray) -> float:
    return 2.0 * abs(complex(np.mean(values * np.exp(-2j * math.pi * frequency * time))))
