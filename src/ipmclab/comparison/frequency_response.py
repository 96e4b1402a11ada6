"""The frequency response from one run with a periodic multisine: best linear approximation, noise, distortion.

Periods that repeat differ by noise alone; a line that is not driven shows what is nonlinear, even at even multiples,
odd at odd ones that were left out. Pintelon and Schoukens, System Identification (2nd edition, 2012), section 4.3.2
(the fast method with an odd random-phase multisine that leaves detection lines out).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.kinds import tell_kinds
from ipmclab.model.assemble import System
from ipmclab.model.numerics.reduce import small_signal
from ipmclab.model.ports import choose_outputs
from ipmclab.quality.check import check
from ipmclab.quality.period import periodic_part
from ipmclab.quality.usable import usable
from ipmclab.run import FloatArray, Run
from ipmclab.units import CHANNELS

ComplexArray = npt.NDArray[np.complex128]
IntArray = npt.NDArray[np.signedinteger]

_DRIVEN: Final = 0.02
"""A line with this share of the largest amplitude of the voltage is driven; the smallest of a multisine have more."""

_SAME: Final = 0.1
"""Share of the voltage's scatter by which a period may differ from the last one and be its repetition."""

_NEIGHBOURS: Final = 4
"""Lines on each side over which the noise is averaged: it changes slowly with frequency."""

_NEAREST: Final = 2
"""Lines on each side over which distortion is averaged: it falls with frequency, as the output does."""

_ALPHA: Final = 0.01
"""How often a period that has settled is taken for one that has not."""

_FEWEST_LINES: Final = 5


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """How a channel answers to the voltage, frequency by frequency.

    Parameters
    ----------
    channel : str
    frequency : float array, shape (n_driven,) [Hz]
        The driven lines.
    response : complex array, shape (n_driven,) [SI unit of the channel per V]
        The best linear approximation at this amplitude: readings over the voltages of their rows, so that the hold of
        the voltage is part of it.
    noise_error : float array, shape (n_driven,) [as the response]
        Standard error of the magnitude by noise; over the magnitude, that of the phase [rad].
    standard_error : float array, shape (n_driven,) [as the response]
        The same by noise and by nonlinear distortion: how far another choice of phases would move it.
    output, noise : float array, shape (n_driven,) [SI unit of the channel]
        Amplitude of the channel at the driven lines, and the standard deviation of the noise in it.
    even_frequency, even : float array, shape (n_even,) [Hz], [SI unit of the channel]
        Amplitude at even multiples.
    odd_frequency, odd : float array, shape (n_odd,) [Hz], [SI unit of the channel]
        Amplitude at odd multiples that were left out.
    noise_rms, even_rms, odd_rms, output_rms : float [SI unit of the channel]
        Of all lines up to the highest driven one together; of distortion what is above the noise.
    period : float [s]
    periods, skipped : int
        Periods that count, and those before them, which still held the transient.
    """

    channel: str
    frequency: FloatArray
    response: ComplexArray
    noise_error: FloatArray
    standard_error: FloatArray
    output: FloatArray
    noise: FloatArray
    even_frequency: FloatArray
    even: FloatArray
    odd_frequency: FloatArray
    odd: FloatArray
    noise_rms: float
    even_rms: float
    odd_rms: float
    output_rms: float
    period: float
    periods: int
    skipped: int

    def __str__(self) -> str:
        """Two lines: what was driven, and how large noise and distortion are."""
        shares = [
            f"{name} not measured"
            if math.isnan(level)
            else f"{100.0 * level / max(self.output_rms, 1e-300):.2g} % {name}"
            for name, level in (("noise", self.noise_rms), ("even", self.even_rms), ("odd distortion", self.odd_rms))
        ]
        return (
            f"{CHANNELS[self.channel].name}: {len(self.frequency)} frequencies from {self.frequency[0]:.4g} Hz to "
            f"{self.frequency[-1]:.4g} Hz, {self.periods} periods after {self.skipped}\n"
            f"of its output: {', '.join(shares)}"
        )


@tell_kinds
def frequency_response(run: Run, channel: str = "displacement", *, skip: int | None = None) -> FrequencyResponse:
    """The best linear approximation of a strip from one run with a periodic signal.

    Parameters
    ----------
    run : Run
        Of a periodic signal, best a multisine with ``harmonics=odd phases=random left_out=4``: three periods or more,
        each of a whole number of rows.
    channel : str
    skip : int, optional
        Periods to leave out at the start. Where it is not given, those that differ from the later ones by more than
        noise; two periods always remain.

    Returns
    -------
    response : FrequencyResponse

    Raises
    ------
    InputError
        A channel that the run does not have; readings that are missing, or that ``check`` masks; a voltage
        without a period, a period that is no whole number of rows, fewer than two of them.

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate
    >>> signal = "multisine 1 V 0.05 Hz 2 Hz harmonics=odd phases=random left_out=4"
    >>> run = simulate(load_actuator("friend-2"), signal, duration=160.0, rate=50.0)
    >>> found = frequency_response(run, "displacement")
    >>> f"{1e3 * abs(found.response[0]):.3f} mm/V at {found.frequency[0]:g} Hz"
    '0.456 mm/V at 0.05 Hz'
    """
    values = getattr(run, channel, None) if channel in CHANNELS else None
    if values is None:
        raise InputError(
            f"the run has no {channel}",
            code="missing-channel",
            where=run.name or "run",
            repair=f"ask for one of {', '.join(name for name in run.channels if name != 'voltage')}",
        )
    rows, period, end = _rows_of_period(run)
    count = _whole_periods(run.voltage[:end], rows)
    if count < 2 or (skip is not None and not 0 <= skip <= count - 2):
        raise InputError(
            f"the record ends with {count} whole period{'' if count == 1 else 's'} of {period:.6g} s"
            + ("" if skip is None else f", {skip} to be left out"),
            code="too-short",
            where=run.name or "run",
            repair="two periods must remain; record three or more",
        )
    last = slice(end - count * rows, end)
    gaps = np.count_nonzero(~usable(run, check(run)).get(channel, np.isfinite(values))[last])
    if gaps:
        raise InputError(
            f"{gaps} readings of the {CHANNELS[channel].name} are missing, or are no values",
            code="missing-readings",
            where=run.name or "run",
            repair="see what ipmclab check says of them; take a run without gaps, or cut it",
        )
    voltages, readings = (series[last].reshape(count, rows) for series in (run.voltage, values))
    drive = np.abs(_spectra(voltages, 0.0).mean(axis=0))
    drive[0] = 0.0  # an offset drives nothing that repeats
    driven = np.flatnonzero(drive > max(_DRIVEN * float(drive.max()), 1e-9))
    if not len(driven):
        raise InputError(
            "the voltage does not change", code="not-driven", where=run.name or "run", repair="take a driven run"
        )
    most = int(driven[-1]) + 1
    skipped = _transient(readings, most) if skip is None else skip
    u = _spectra(voltages[skipped:], 0.0)[:, :most]
    y = _spectra(readings[skipped:], _drift(readings[skipped:]))[:, :most]
    return _approximation(channel, u, y, driven, period, skipped)


def _rows_of_period(run: Run) -> tuple[int, float, int]:
    """Rows of a period, the period [s], and the row after the last one."""
    periodic = periodic_part(run)
    if periodic is None:
        raise InputError(
            "the voltage is not periodic",
            code="not-periodic",
            where=run.name or "run",
            repair="record for example: multisine 1 V 0.05 Hz 2 Hz harmonics=odd phases=random left_out=4",
        )
    period, end = periodic
    rows = round(period * run.rate)
    if not run.is_uniform or rows < 4 or abs(rows - period * run.rate) > 1e-3:
        raise InputError(
            f"a period of {period:.6g} s has {period * run.rate:.6g} rows at {run.rate:g} Hz",
            code="period-of-rows",
            where=run.name or "run",
            repair="choose a rate with a whole number of equally spaced rows in a period",
        )
    return rows, period, end


def _whole_periods(voltage: FloatArray, rows: int) -> int:
    """How many periods at the end of a record have the voltage of the last one: a rest before them has not."""
    count = len(voltage) // rows
    blocks = voltage[len(voltage) - count * rows :].reshape(count, rows)
    deviation = np.sqrt(np.mean((blocks - blocks[-1]) ** 2, axis=1)) if count else np.zeros(0)
    other = np.flatnonzero(deviation > _SAME * np.std(blocks[-1])) if count else deviation
    return count - (int(other[-1]) + 1 if len(other) else 0)


def _drift(blocks: FloatArray) -> float:
    """By how much the mean changes from period to period, along a straight line."""
    return float(np.polyfit(np.arange(len(blocks)), blocks.mean(axis=1), 1)[0])


def _spectra(blocks: FloatArray, drift: float) -> ComplexArray:
    """Complex amplitude of each multiple of the lowest frequency in each period, without a straight drift."""
    rows = blocks.shape[1]
    straight = drift * (np.arange(rows) / rows)
    return np.asarray(np.fft.rfft(blocks - straight, axis=1) * (2.0 / rows), dtype=np.complex128)


def _transient(blocks: FloatArray, most: int) -> int:
    """How many first periods differ from the later ones by more than the later ones among each other."""
    from scipy.special import fdtri

    for first in range(len(blocks) - 2):
        y = _spectra(blocks[first:], _drift(blocks[first + 1 :]))[:, 1:most]
        later = y[1:]
        noise = float(np.mean(np.var(later, axis=0, ddof=1)))
        deviation = float(np.mean(np.abs(y[0] - later.mean(axis=0)) ** 2)) / (1.0 + 1.0 / len(later))
        lines = y.shape[1]
        if deviation <= noise * float(fdtri(2 * lines, 2 * lines * (len(later) - 1), 1.0 - _ALPHA)):
            return first
    return len(blocks) - 2


def _approximation(
    channel: str, u: ComplexArray, y: ComplexArray, driven: IntArray, period: float, skipped: int
) -> FrequencyResponse:
    count = len(y)
    u_mean, y_mean = u.mean(axis=0), y.mean(axis=0)
    response = y_mean[driven] / u_mean[driven]
    lines = np.arange(1, u.shape[1])
    # What the voltage has at lines that are not driven goes through the strip, too: it is no distortion.
    through = np.interp(lines, driven, response.real) + 1j * np.interp(lines, driven, response.imag)
    left = y[:, 1:] - through * u[:, 1:]
    noise = _smooth(np.var(left, axis=0, ddof=1), _NEIGHBOURS) / count
    level = left.mean(axis=0)
    is_driven = np.isin(lines, driven)
    even = ~is_driven & (lines % 2 == 0)
    odd = ~is_driven & (lines % 2 == 1) & (lines > lines[is_driven][0])
    stochastic = _distortion_at(lines[is_driven], lines[odd], np.abs(level[odd]) ** 2 - noise[odd])
    at = noise[is_driven]
    size = np.abs(u_mean[driven])
    return FrequencyResponse(
        channel=channel,
        frequency=driven / period,
        response=response,
        noise_error=np.sqrt(0.5 * at) / size,
        standard_error=np.sqrt(0.5 * (at + stochastic)) / size,
        output=np.abs(y_mean[driven]),
        noise=np.sqrt(at),
        even_frequency=lines[even] / period,
        even=np.abs(level[even]),
        odd_frequency=lines[odd] / period,
        odd=np.abs(level[odd]),
        noise_rms=math.sqrt(0.5 * float(noise.sum())),
        even_rms=_above(level[even], noise[even]) if np.any(even) else math.nan,
        odd_rms=_above(level[odd], noise[odd]) if np.any(odd) else math.nan,
        output_rms=math.sqrt(0.5 * float(np.sum(np.abs(y_mean[driven]) ** 2))),
        period=period,
        periods=count,
        skipped=skipped,
    )


def _smooth(variance: FloatArray, neighbours: int) -> FloatArray:
    width = min(2 * neighbours + 1, len(variance))
    kernel = np.ones(width)
    return np.convolve(variance, kernel, "same") / np.convolve(np.ones_like(variance), kernel, "same")


def _distortion_at(driven: IntArray, odd: IntArray, variance: FloatArray) -> FloatArray:
    """The variance of odd distortion at the driven lines, which the lines that were left out show."""
    if len(odd) < _FEWEST_LINES:
        return np.zeros(len(driven))
    return np.interp(driven, odd, np.maximum(_smooth(variance, _NEAREST), 0.0))


def _above(level: ComplexArray, noise: FloatArray) -> float:
    return math.sqrt(max(0.5 * float(np.sum(np.abs(level) ** 2 - noise)), 0.0))


def response_in_rows(
    system: System, frequency: npt.ArrayLike, rate: float, channel: str = "displacement", *, hold: str = "zero"
) -> ComplexArray:
    """What ``frequency_response`` would find of a linear strip without noise, in closed form.

    Parameters
    ----------
    system : System
        For example ``actuator.system``; with a leak, that of small voltages.
    frequency : float array, shape (n_frequency,) [Hz]
    rate : float [Hz]
        Of the rows.
    channel : str
    hold : "zero" or "zero-before"
        What the voltage does between rows.

    Returns
    -------
    response : complex array, shape (n_frequency,) [SI unit of the channel per V]

    Raises
    ------
    InputError
        Another hold, or an unknown channel.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> system = load_actuator("friend-2").system
    >>> round(1e3 * abs(complex(response_in_rows(system, [0.05], 50.0)[0])), 3)
    0.456
    """
    from scipy.linalg import expm

    if hold not in ("zero", "zero-before"):
        raise InputError(
            f"rows of hold {hold!r}", code="unknown-hold", where="hold", repair="use 'zero' or 'zero-before'"
        )
    linear = small_signal(system)
    states = len(linear.states)
    joined = np.zeros((states + 1, states + 1))
    joined[:states, :states], joined[:states, states] = linear.a, linear.b[:, 0]
    stepped = expm(joined / rate)
    z = np.exp(2j * np.pi * np.atleast_1d(np.asarray(frequency, dtype=np.float64)) / rate)
    moved = stepped[None, :states, states:] * (z[:, None, None] if hold == "zero-before" else 1.0)
    state = np.linalg.solve(z[:, None, None] * np.eye(states) - stepped[:states, :states], moved.astype(complex))
    answer = (linear.c @ state + linear.d[:, :1])[:, choose_outputs([channel])[0], 0]
    return np.asarray(answer, dtype=np.complex128)
