"""The frequency response from single sines: one run a frequency."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ipmclab.comparison.factors import FACTORS, levels_of
from ipmclab.comparison.mixed_blocks import FloatArray
from ipmclab.comparison.table import RunRow
from ipmclab.confidence import NORMAL_95
from ipmclab.quality.metrics import Metric

_CONDITIONS = ("voltage", "humidity", "temperature", "clamp_pressure")


@dataclass(frozen=True, eq=False)
class SineResponse:
    """How a channel of one strip answers to sines of one amplitude.

    Parameters
    ----------
    sample, channel : str
    conditions : mapping of factor to float [SI]
    frequency : float array, shape (n,) [Hz]
        From low to high, each once.
    gain : float array, shape (n,) [SI unit of the channel per V]
        Mean over the repeats.
    phase : float array, shape (n,) [rad]
        Below 0 where the response is late; without jumps.
    gain_error, phase_error : float array, shape (n,)
        Standard error of the mean: by the scatter of repeats, or where there is one run, by its noise.
    bandwidth : float [Hz], optional
        See ``bandwidth_of``.
    """

    sample: str
    channel: str
    conditions: dict[str, float]
    frequency: FloatArray
    gain: FloatArray
    phase: FloatArray
    gain_error: FloatArray
    phase_error: FloatArray
    bandwidth: float | None


def sine_responses(rows: Sequence[RunRow]) -> tuple[SineResponse, ...]:
    """The responses that rows of sines hold: two frequencies or more of one strip under one condition.

    Parameters
    ----------
    rows : sequence of RunRow
    """
    sine_rows = [row for row in rows if row.waveform in ("sine", "cosine") and "frequency" in row.values]
    columns = {}
    for name in _CONDITIONS:
        values = [row.values.get(name, math.nan) for row in sine_rows]
        there = [value for value in values if math.isfinite(value)]
        levels = iter(levels_of(FACTORS[name], there))
        columns[name] = [next(levels) if math.isfinite(value) else None for value in values]
    groups: dict[tuple[object, ...], list[RunRow]] = {}
    for place, row in enumerate(sine_rows):
        key: tuple[object, ...] = (row.sample, *(columns[name][place] for name in _CONDITIONS))
        groups.setdefault(key, []).append(row)
    found = []
    for key, members in groups.items():
        conditions = {name: value for name, value in zip(_CONDITIONS, key[1:], strict=True) if isinstance(value, float)}
        for channel in ("displacement", "force", "current"):
            response = _response(str(key[0]), channel, conditions, members)
            if response is not None:
                found.append(response)
    return tuple(found)


def _response(sample: str, channel: str, conditions: dict[str, float], rows: Sequence[RunRow]) -> SineResponse | None:
    by: dict[float, list[RunRow]] = {}
    for row in rows:
        if f"{channel}.gain" in row.metrics and f"{channel}.phase" in row.metrics:
            by.setdefault(round(row.values["frequency"], 9), []).append(row)
    if len(by) < 2:
        return None
    frequency = np.array(sorted(by))
    both = [
        [_mean([row.metrics[f"{channel}.{name}"] for row in by[one]], turns=name == "phase") for one in sorted(by)]
        for name in ("gain", "phase")
    ]
    gain, gain_error = (np.array(column) for column in zip(*both[0], strict=True))
    phase, phase_error = (np.array(column) for column in zip(*both[1], strict=True))
    return SineResponse(
        sample,
        channel,
        conditions,
        frequency,
        gain,
        np.unwrap(phase),
        gain_error,
        phase_error,
        bandwidth_of(frequency, gain),
    )


def _mean(metrics: Sequence[Metric], *, turns: bool) -> tuple[float, float]:
    values = np.array([one.value for one in metrics])
    if len(values) > 1:
        # Phases of repeats may lie on both sides of half a turn.
        values = np.unwrap(values) if turns else values
        return float(values.mean()), float(values.std(ddof=1)) / math.sqrt(len(values))
    interval = metrics[0].interval
    return float(values[0]), 0.0 if interval is None else (interval[1] - interval[0]) / (2.0 * NORMAL_95)


def bandwidth_of(frequency: npt.ArrayLike, gain: npt.ArrayLike) -> float | None:
    """Where the gain has first fallen by 3 dB from that at the lowest frequency, between points along a power law.

    Parameters
    ----------
    frequency : float array, shape (n,) [Hz]
        From low to high.
    gain : float array, shape (n,)

    Returns
    -------
    bandwidth : float [Hz] or None
        None where it has not fallen as far.

    Examples
    --------
    >>> bandwidth_of([0.1, 1.0, 10.0], [1.0, 1.0, 0.1])
    1.4125375446227544
    """
    f, g = np.asarray(frequency, dtype=np.float64), np.asarray(gain, dtype=np.float64)
    least = g[0] * 10.0 ** (-3.0 / 20.0)
    below = np.flatnonzero(g <= least)
    if not len(below):
        return None
    at = int(below[0])
    share = math.log(g[at - 1] / least) / math.log(g[at - 1] / g[at])
    return float(f[at - 1] * (f[at] / f[at - 1]) ** share)
