"""The numbers by which people compare runs, each with its definition in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ipmclab.confidence import NORMAL_95
from ipmclab.kinds import tell_kinds
from ipmclab.quality.check import check
from ipmclab.quality.extreme import HOW, breaks_of, highest
from ipmclab.quality.kept import kept
from ipmclab.quality.period import periodic_part
from ipmclab.quality.record import GUARD_ROWS, NO_VOLTAGE, Channel, IntArray, Record
from ipmclab.quality.scatter import Scatter, scatter_of
from ipmclab.quality.steady import settle
from ipmclab.quality.usable import noise_only, unmasked
from ipmclab.run import Finding, FloatArray, Run
from ipmclab.units import CHANNELS

_HARMONICS: Final = 5  # of the fundamental, which are reported (convention)
_FALLEN: Final = 0.02  # part of the largest value so far that a first peak has to fall (convention)
_SETTLING: Final = 0.25  # part of the record after the edge that the steady value leaves out (convention)
_FEWEST: Final = 50  # rows from which a steady value is read (convention)
_REST_ROWS: Final = 25  # rows before the first voltage whose mean is the zero (convention)
_SHOWN: Final = 5  # rows at rest from which on they show the zero (convention)

_FROM_REST: Final = (
    "Deviations are from the reading at rest: the mean of the last 25 rows before the voltage first leaves zero "
    "(three rows before it), or zero where there are fewer than five."
)


@dataclass(frozen=True)
class Metric:
    """One number of a run.

    Parameters
    ----------
    name : str
        For example ``"peak_at_first_edge"``.
    channel : str
    value : float [SI unit of the channel, or ``unit``]
    unit : str
        SI unit; empty for a ratio.
    interval : (float, float), optional
        95 %, infinite where open; None where none is known.
    definition : str
        What exactly was computed.
    of_drift : float [unit], optional
        Of half the interval, what the drift of a baseline may be wrong by: the same in every run that it counts for.
    """

    name: str
    channel: str
    value: float
    unit: str
    interval: tuple[float, float] | None
    definition: str
    of_drift: float = 0.0


@dataclass(frozen=True, eq=False)
class _Response:
    """A channel's deviations from rest, where they jump, their noise, and the standard error of the rest."""

    channel: Channel
    values: FloatArray
    breaks: IntArray
    scatter: Scatter
    rest_error: float


@tell_kinds
def measure(run: Run, findings: Sequence[Finding] | None = None) -> tuple[Metric, ...]:
    """The metrics that a run allows, channel by channel.

    A voltage that jumps and then is constant gives the peak at the first edge, the time to it and, where the
    response comes back, the back relaxation after it; one that is constant to the end of the record, or to
    a rest at 0 V that ends it, gives the steady value and the mean of the last tenth. A periodic voltage gives
    amplitude, phase and harmonics 2 to 5; a square gives the current at the end of a half period. Every run
    gives the largest deviation from rest. Rows that ``check`` masks are left out, and so is a channel in
    which it finds nothing but noise (``noise-only``): its largest reading says nothing of the strip.

    Parameters
    ----------
    run : Run
    findings : sequence of Finding, optional
        Those of the record that the run was made of, where it is no longer as it was read; else ``check`` is asked.

    Returns
    -------
    metrics : tuple of Metric

    Examples
    --------
    >>> import numpy as np
    >>> from ipmclab.run import Run
    >>> time = np.arange(2000) / 50.0
    >>> run = Run.from_arrays(time=time, voltage=np.ones(2000), current=0.01 + 0.05 * np.exp(-time / 4.0))
    >>> {metric.name: round(metric.value, 4) for metric in measure(run)}
    {'largest': 0.06, 'peak_at_first_edge': 0.06, 'time_to_peak': 0.0, 'steady_value': 0.01, 'mean_of_last_tenth': 0.01}
    """
    if findings is not None:
        return _measured(run, findings)
    return kept(run, "metrics", lambda: _measured(run, check(run)))


def _measured(run: Run, findings: Sequence[Finding]) -> tuple[Metric, ...]:
    record = Record.of(run)
    masks = unmasked(run, findings)
    periodic = periodic_part(run)
    metrics: list[Metric] = []
    noise = noise_only(findings)
    for channel in record.channels.values():
        if channel.name in noise:
            continue
        values = np.where(masks[channel.name], channel.readings, np.nan)
        if np.count_nonzero(np.isfinite(values)) < 2:
            continue
        scatter = scatter_of(record, channel, periodic)
        rest, rest_error = _at_rest(record, scatter, values)
        values -= rest
        response = _Response(channel, values, breaks_of(channel, values, record.edges), scatter, rest_error)
        metrics.append(_largest(record, response))
        if record.steps_from_rest and record.constant_after[0]:
            metrics += _first_peak(record, response)
        if periodic is not None:
            metrics += _periodic(record, response, *periodic)
        elif record.held_last is not None:
            metrics += _steady(record, response, *record.held_last)
    return tuple(metrics)


def _at_rest(record: Record, scatter: Scatter, values: FloatArray) -> tuple[float, float]:
    """The reading at rest and its standard error."""
    before = _before(record.run, values)
    return (float(before.mean()), scatter.of_mean(len(before))) if len(before) >= _SHOWN else (0.0, 0.0)


def _before(run: Run, values: FloatArray) -> FloatArray:
    """The readings by which the zero is known: those shortly before the voltage first leaves zero."""
    size = np.abs(run.voltage)
    driven = np.flatnonzero(size > max(NO_VOLTAGE, 0.01 * float(size.max())))
    before = values[: max(int(driven[0]) - GUARD_ROWS, 0)][-_REST_ROWS:] if len(driven) else values[:0]
    return before[np.isfinite(before)]


def shows_zero(run: Run, channel: str) -> bool:
    """Whether a record says what a channel reads at rest; else its metrics are counted from a reading of zero.

    Examples
    --------
    >>> run = Run.from_arrays(time=[0.0, 1.0, 2.0], voltage=[1.0, 1.0, 1.0], current=[0.06, 0.02, 0.01])
    >>> shows_zero(run, "current")
    False
    """
    return run.metadata.origin == "simulated" or len(_before(run, run.channels[channel])) >= _SHOWN


def _metric(channel: Channel, name: str, value: float, error: float, definition: str) -> Metric:
    interval = (float(value - NORMAL_95 * error), float(value + NORMAL_95 * error))
    return Metric(name, channel.name, value, CHANNELS[channel.name].unit, interval, definition)


def _largest(record: Record, response: _Response) -> Metric:
    channel, values, time = response.channel, response.values, record.run.time
    up, down = (highest(channel, response.scatter, time, one, response.breaks) for one in (values, -values))
    return _metric(
        channel,
        "largest",
        up.value if up.value >= down.value else -down.value,
        math.hypot(up.error if up.value >= down.value else down.error, response.rest_error),
        "The largest deviation from rest over the whole record, with its sign (the maximum from rest). "
        + HOW
        + " "
        + _FROM_REST,
    )


def is_later(metric: Metric) -> bool:
    """Whether it is a time to a peak that did not come while the voltage was held: how long that was says nothing."""
    return metric.name == "time_to_peak" and metric.interval is not None


def _first_peak(record: Record, response: _Response) -> list[Metric]:
    channel, values, breaks = response.channel, response.values, response.breaks
    edge, end = int(record.edges[0]), int(record.ends[0])
    start = max(edge - GUARD_ROWS, 0)
    stretch = values[start:end]
    if not np.isfinite(stretch).any():
        return []
    direction = _direction(record, response)
    towards = direction * stretch
    so_far = np.fmax.accumulate(towards)
    rows = np.arange(len(towards))
    since = rows - np.maximum.accumulate(np.where(towards == so_far, rows, 0))
    clear = response.scatter.clear(since, rows + 1)
    fallen = np.flatnonzero(so_far - towards > np.maximum(clear, _FALLEN * so_far))
    inside = breaks[(breaks > start) & (breaks < end)] - start
    until = int(fallen[0]) if len(fallen) else None
    peak = highest(channel, response.scatter, record.run.time[start:end], towards, inside, until)
    value = direction * peak.value
    until_peak = float(record.run.time[start + peak.row] - record.run.time[edge])
    metrics = [
        _metric(
            channel,
            "peak_at_first_edge",
            value,
            math.hypot(peak.error, response.rest_error),
            "The first maximum after the first edge of the voltage, in the direction in which the response starts: the "
            "largest deviation from rest before the response has come back from it by 2 % (and by eight standard "
            "deviations of white noise), or before the voltage changes. " + HOW + " " + _FROM_REST,
        ),
        Metric(
            "time_to_peak",
            channel.name,
            until_peak,
            "s",
            None if len(fallen) else (until_peak, math.inf),
            "Time from the row of the first edge of the voltage to the row of peak_at_first_edge. Where the response "
            "has not come back from it when the voltage changes, the interval is open: the peak may be later.",
        ),
    ]
    last = stretch[-max(1, (end - edge) // 10) :]
    last = last[np.isfinite(last)]
    is_rounding = abs(value) <= np.finfo(np.float64).eps * float(np.nanmax(np.abs(stretch)))
    if channel.name == "current" or not len(fallen) or not len(last) or is_rounding:
        return metrics
    remains = float(last.mean())
    scatter = math.hypot(response.scatter.of_mean(len(last)), peak.error * remains / value)
    error = math.hypot(scatter, response.rest_error * (1.0 - remains / value)) / abs(value)
    share = 1.0 - remains / value
    metrics.append(
        Metric(
            "back_relaxation",
            channel.name,
            share,
            "",
            (share - NORMAL_95 * error, share + NORMAL_95 * error),
            "What is lost of peak_at_first_edge by the end of the stretch of constant voltage, as a fraction of that "
            "peak: 1 - (mean of the last tenth of the stretch) / peak. Above 1 the response has passed through rest. "
            + _FROM_REST,
        )
    )
    return metrics


def _direction(record: Record, response: _Response) -> float:
    """1 or -1: the way the response starts, where it is clear of the noise; that of the voltage otherwise."""
    edge, end, values = int(record.edges[0]), int(record.ends[0]), response.values
    after = values[max(edge - GUARD_ROWS, 0) : end]
    rows = np.arange(len(after))
    clear = np.flatnonzero(np.abs(after) > response.scatter.clear(_REST_ROWS + rows, rows + 1))
    return math.copysign(1.0, float(after[clear[0]]) if len(clear) else float(record.heights[0]))


def _steady(record: Record, response: _Response, edge: int, end: int) -> list[Metric]:
    channel, values = response.channel, response.values[:end]
    tail = values[-(end // 10) :]
    start = edge + int(_SETTLING * (end - edge))
    rows = start + np.flatnonzero(np.isfinite(values[start:]))
    if end - edge <= len(tail) or len(rows) < _FEWEST or not np.isfinite(tail).any():
        return []
    limit, (low, high) = settle(record.run.time[rows], values[rows])
    rest = NORMAL_95 * response.rest_error
    interval = (limit - math.hypot(limit - low, rest), limit + math.hypot(high - limit, rest))
    mean = float(np.nanmean(tail))
    count = int(np.isfinite(tail).sum())
    unit = CHANNELS[channel.name].unit
    return [
        Metric(
            "steady_value",
            channel.name,
            limit,
            unit,
            interval,
            "The limit of c + a exp(-t / tau), fitted to the response from a quarter of the last stretch of constant "
            "voltage that is no rest at 0 V to its end. The interval is open where slower settling cannot be "
            "excluded. " + _FROM_REST,
        ),
        _metric(
            channel,
            "mean_of_last_tenth",
            mean,
            math.hypot(response.scatter.of_mean(count), response.rest_error),
            "The mean of the last tenth of the record, without a rest at 0 V at its end. " + _FROM_REST,
        ),
    ]


def _periodic(record: Record, response: _Response, period: float, end: int) -> list[Metric]:
    channel, values = response.channel, response.values
    count = round(period / record.period)
    if count < 4 or count > end:
        return []
    first = end - count
    time, last = record.run.time[first:end], values[first:end]
    if not np.isfinite(last).all():
        return []
    inside = response.breaks[(response.breaks > first) & (response.breaks < end)] - first
    up, down = (highest(channel, response.scatter, time, one, inside) for one in (last, -last))
    metrics = [
        _metric(
            channel,
            "amplitude",
            0.5 * (up.value + down.value),
            0.5 * math.hypot(up.error, down.error),
            f"Half the peak to peak value over the last whole period ({period:.6g} s) of the voltage. " + HOW,
        )
    ]
    orders = min(_HARMONICS, (count - 1) // 2)
    waves = harmonics(time, last, period, orders)
    drive = harmonics(time, record.run.voltage[first:end], period, 1)
    size = abs(waves[0])
    error = response.scatter.of_wave(count) * math.sqrt(2.0 / count)
    if size > 5.0 * error and abs(drive[0]) > 0.0:
        phase = float(np.angle(waves[0] / drive[0]))
        half = NORMAL_95 * error / float(size)
        metrics.append(
            Metric(
                "phase",
                channel.name,
                phase,
                "rad",
                (phase - half, phase + half),
                "Phase of the fundamental against that of the voltage, over the last whole period; negative when the "
                "response is late.",
            )
        )
        for order in range(2, orders + 1):
            # Noise adds its own power to that of a harmonic, most of it to one that is as small.
            own = response.scatter.of_wave(count / order) * math.sqrt(2.0 / count) / float(size)
            read, reach = float(abs(waves[order - 1]) / size), NORMAL_95 * own
            ratio = math.sqrt(max(read**2 - 2.0 * own**2, 0.0))
            metrics.append(
                Metric(
                    f"harmonic_{order}",
                    channel.name,
                    ratio,
                    "",
                    (max(0.0, ratio - reach), read + reach),
                    f"Amplitude of harmonic {order} over that of the fundamental, over the last whole period, less the "
                    "power that noise adds, above which the interval reaches as it may have added none.",
                )
            )
    if channel.name == "current":
        metrics += _half_period_ends(record, response, period, end)
    return metrics


def harmonics(
    time: FloatArray, values: FloatArray, period: float, orders: int
) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
    """Complex amplitudes of the harmonics 1 to ``orders``, by least squares with a constant."""
    angle = 2.0 * math.pi / period * time
    waves = [wave(order * angle) for order in range(1, orders + 1) for wave in (np.cos, np.sin)]
    basis = np.column_stack([np.ones_like(time), *waves])
    # Over a whole period these are as good as orthogonal: the normal equations lose no digit, and are quicker by far.
    fitted = np.linalg.lstsq(basis.T @ basis, basis.T @ values, rcond=None)[0]
    return np.asarray(fitted[1::2] - 1j * fitted[2::2], dtype=np.complex128)


def _half_period_ends(record: Record, response: _Response, period: float, end: int) -> list[Metric]:
    """Only for a square: two edges in a period, the voltage constant between them; no rest after its last period."""
    channel, values = response.channel, response.values
    edges, ends = record.edges, record.ends
    half = 0.5 * period / record.period
    whole = record.constant_after & (np.abs(ends - edges - half) <= 1.5) & (ends <= end + 1.5)
    together = np.flatnonzero(whole[:-1] & whole[1:])
    if not len(together) or not whole[0]:
        return []
    rows = max(1, round(0.02 * half))
    stretches = [values[stop - rows : stop] for stop in ends[[0, together[-1], together[-1] + 1]]]
    read = [stretch[np.isfinite(stretch)] for stretch in stretches]
    if not all(len(stretch) for stretch in read):
        return []
    first, before, last = (float(np.median(stretch)) for stretch in read)
    errors = [math.sqrt(math.pi / 2.0) * response.scatter.of_mean(len(stretch)) for stretch in read]
    words = f"median of the last {rows} row{'s' if rows > 1 else ''} of it"
    return [
        _metric(
            channel,
            "half_period_end",
            first,
            math.hypot(errors[0], response.rest_error),
            f"The current at the end of the first half period of the square: {words}. " + _FROM_REST,
        ),
        _metric(
            channel,
            "half_period_end_last",
            0.5 * abs(last - before),
            0.5 * math.hypot(errors[1], errors[2]),
            f"The current at the end of a half period of the square: {words}; half the difference between the last two "
            "whole half periods that follow each other.",
        ),
    ]
