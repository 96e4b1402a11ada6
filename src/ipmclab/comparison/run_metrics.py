"""The numbers of one run that the field compares: those of ``measure``, with charge, energy and strain."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from ipmclab.comparison.baseline import Drift, without_drift
from ipmclab.confidence import NORMAL_95
from ipmclab.quality.check import check
from ipmclab.quality.metrics import Metric, harmonics, is_later, measure
from ipmclab.quality.period import periodic_part
from ipmclab.quality.record import Record
from ipmclab.quality.usable import noise_only, unmasked
from ipmclab.run import FloatArray, Run
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    from ipmclab.model.actuator import Actuator

_DRIFTING: Final = ("largest", "peak_at_first_edge", "steady_value", "mean_of_last_tenth")
"""Metrics of the displacement that a drift moves by as much as it has moved until then."""

_SHARE_OF_PEAK: Final = "back_relaxation"
"""And the one that it moves by that as a share of the first peak."""

_MISSING: Final = 0.01
"""Share of the readings that may be missing where a record is integrated."""


def metrics_of_run(run: Run, *, strip: Actuator | None = None, drift: Drift | None = None) -> tuple[Metric, ...]:
    """The metrics of a run.

    Parameters
    ----------
    run : Run
    strip : Actuator, optional
        Whose thickness and sensing length turn a displacement into a strain.
    drift : Drift, optional
        Of a baseline run of the same strip; taken from the displacement, and its uncertainty into the intervals.

    Returns
    -------
    metrics : tuple of Metric
        Those of ``measure``, without the time to a peak that the record does not reach; of the current, charge, energy
        and, where it is periodic, mean power and the charge of half a period; with a strip, the strain at its surface.

    Examples
    --------
    >>> time = np.arange(0.0, 10.0, 0.01)
    >>> voltage = np.where(time >= 1.0, 1.0, 0.0)
    >>> run = Run.from_arrays(time=time, voltage=voltage, current=0.01 * voltage)
    >>> {one.name: round(one.value, 3) for one in metrics_of_run(run) if one.name in ("charge", "energy")}
    {'charge': 0.09, 'energy': 0.09}
    """
    if drift is None:
        metrics = measure(run)
        gains = tuple(_gains(run, metrics))
    else:
        still = without_drift(run, drift)
        found = measure(still, check(run))
        metrics = tuple(_less_drift(one, drift, run, found) for one in found)
        gains = tuple(_less_drift(one, drift, run, found) for one in _gains(still, found))
    reached = (one for one in metrics if not is_later(one))
    return (*reached, *_electrical(run, metrics), *gains, *_strain(metrics, strip))


def _less_drift(metric: Metric, drift: Drift, run: Run, found: tuple[Metric, ...]) -> Metric:
    """A metric of the run without its drift, reported with what the drift may be wrong by."""
    if metric.channel != "displacement":
        return metric
    text = (
        f"{metric.definition} Before, a drift of {1e6 * drift.rate:.4g} um/s was taken from the displacement, as the "
        f"baseline {drift.name} has it."
    )
    if metric.name not in (*_DRIFTING, _SHARE_OF_PEAK) or metric.interval is None:
        return replace(metric, definition=text)
    reach = NORMAL_95 * drift.standard_error * float(run.time[-1] - run.time[0])
    if metric.name == _SHARE_OF_PEAK:
        (peak,) = (abs(one.value) for one in found if (one.channel, one.name) == (metric.channel, "peak_at_first_edge"))
        reach /= peak
    low, high = metric.interval
    interval = (
        metric.value - math.hypot(metric.value - low, reach),
        metric.value + math.hypot(high - metric.value, reach),
    )
    return replace(metric, interval=interval, definition=text, of_drift=reach)


def _electrical(run: Run, metrics: tuple[Metric, ...]) -> Iterator[Metric]:
    findings = check(run)
    if run.current is None or "current" in noise_only(findings):
        return
    there = unmasked(run, findings)["current"]
    if np.count_nonzero(~there) > _MISSING * len(run):
        return
    time, current, voltage = run.time[there], run.current[there], run.voltage[there]
    by = "by the trapezoidal rule, readings as they stand"
    driven = np.flatnonzero(there) < Record.of(run).driven_until
    yield _exact(
        "charge",
        _integral(time[driven], current[driven]),
        "C",
        f"The integral of the current over the record, less a rest at 0 V with which it ends: what goes in, {by}.",
    )
    yield _exact(
        "energy", _integral(time, voltage * current), "J", f"The integral of voltage times current, {by}: what went in."
    )
    until = _end_of_peak(run, metrics)
    if until is not None:
        early = time <= until
        yield _exact(
            "energy_to_peak",
            _integral(time[early], (voltage * current)[early]),
            "J",
            "The integral of voltage times current from row 0 to the first peak of the displacement, where it still "
            f"grows to the end of the hold, {by}.",
        )
    periodic = periodic_part(run)
    if periodic is None:
        return
    period, end = periodic
    count = round(period * run.rate)
    if not 4 <= count < end or len(time) < len(run):
        return
    last = slice(end - count - 1, end)
    yield _exact(
        "charge_of_half_period",
        0.5 * _integral(time[last], np.abs(current[last])),
        "C",
        f"Half the integral of the current's magnitude over the last whole period ({period:.6g} s), {by}.",
    )
    yield _exact(
        "mean_power",
        _integral(time[last], voltage[last] * current[last]) / float(np.ptp(time[last])),
        "W",
        f"The mean of voltage times current over the last whole period ({period:.6g} s), {by}.",
    )


def _end_of_peak(run: Run, metrics: tuple[Metric, ...]) -> float | None:
    """The time of the displacement's first peak [s], as far as the voltage was held; None where it has none."""
    for one in metrics:
        if (one.channel, one.name) == ("displacement", "time_to_peak"):
            peak = run.time[Record.of(run).edges[0]] + one.value
            return float(run.time[np.abs(run.time - peak).argmin()])
    return None


def _gains(run: Run, metrics: tuple[Metric, ...]) -> Iterator[Metric]:
    """Gain of the fundamental, channel by channel, where the response has a phase."""
    periodic = periodic_part(run)
    if periodic is None:
        return
    period, end = periodic
    last = slice(end - round(period * run.rate), end)
    time = run.time[last]
    drive = abs(harmonics(time, run.voltage[last], period, 1)[0])
    for one in metrics:
        if one.name != "phase" or one.interval is None:
            continue
        gain = float(abs(harmonics(time, run.channels[one.channel][last], period, 1)[0]) / drive)
        # The phase of a fundamental in noise scatters by as much [rad] as its size does, as a share.
        half = 0.5 * (one.interval[1] - one.interval[0]) * gain
        yield Metric(
            "gain",
            one.channel,
            gain,
            f"{CHANNELS[one.channel].unit}/V",
            (gain - half, gain + half),
            f"Amplitude of the fundamental over that of the voltage, over the last whole period ({period:.6g} s).",
        )


def _exact(name: str, value: float, unit: str, definition: str) -> Metric:
    return Metric(name, "current", value, unit, None, definition)


def _integral(time: FloatArray, values: FloatArray) -> float:
    return float(np.trapezoid(values, time))


def _strain(metrics: tuple[Metric, ...], strip: Actuator | None) -> Iterator[Metric]:
    if strip is None:
        return
    known = strip.parameters()
    thickness, length = known["geometry.thickness"].value, known["geometry.sensing_length"].value
    for one in metrics:
        if one.channel != "displacement" or one.name not in ("largest", "amplitude"):
            continue
        strains = [surface_strain(value, thickness, length) for value in (one.value, *(one.interval or ()))]
        drifted = surface_strain(one.value + one.of_drift, thickness, length)
        yield Metric(
            "strain" if one.name == "largest" else "strain_amplitude",
            "displacement",
            strains[0],
            "",
            (strains[1], strains[2]) if one.interval else None,
            f"Strain at the surface of a strip of {1e3 * thickness:.4g} mm that bends along a circle through its "
            f"clamp: thickness times displacement over (sensing length^2 + displacement^2), with {one.name}.",
            abs(drifted - strains[0]),
        )


def surface_strain(displacement: float, thickness: float, sensing_length: float) -> float:
    """The strain at the surface of a strip that bends along a circle.

    The curvature of a circle that leaves the clamp straight and passes through the measured point is
    ``2 δ / (L_s^2 + δ^2)``; half the thickness times it is the strain.

    Parameters
    ----------
    displacement, thickness, sensing_length : float [m]

    Examples
    --------
    >>> f"{surface_strain(1e-3, 0.2e-3, 20e-3):.3e}"
    '4.988e-04'
    """
    return thickness * displacement / (sensing_length**2 + displacement**2)
