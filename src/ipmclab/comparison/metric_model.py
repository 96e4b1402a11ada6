"""One metric over all factors that were varied: its effects, the next strip, strips unlike the others.

A magnitude (a peak, a charge) is compared by its logarithm: effects multiply, and strips differ by factors. What may
have either sign, or is a share, is compared as it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from ipmclab.comparison.display import metric_label
from ipmclab.comparison.factors import Factor, levels_of
from ipmclab.comparison.mixed import RESIDUAL, Estimate, MixedFit, fit_mixed
from ipmclab.comparison.mixed_blocks import FloatArray
from ipmclab.comparison.over_strips import EachLeftOut, each_left_out
from ipmclab.comparison.own_scatter import OwnScatter, own_scatter
from ipmclab.comparison.table import RunRow
from ipmclab.quality.metrics import Metric

STRIP: Final = "strip"
MOUNTING: Final = "mounting"

MAGNITUDES: Final = (
    "largest",
    "peak_at_first_edge",
    "amplitude",
    "time_to_peak",
    "charge",
    "charge_of_half_period",
    "energy",
    "mean_power",
    "strain",
    "strain_amplitude",
    "mean_of_last_tenth",
    "half_period_end",
    "half_period_end_last",
)
"""Metrics whose size is compared, by its logarithm."""

_TOGETHER: Final = 1e-3
"""Share of a factor that may be its own where the other factors explain the rest, below which it has no effect of its
own to be reported."""

_SAME: Final = 0.02
"""Share of the way from the lowest level to the highest that is no other level: air is never the same twice."""

_UNLIKE: Final = 0.05
"""How often a campaign in which all strips are alike names one as unlike, at most (Holm)."""


@dataclass(frozen=True)
class Effect:
    """What changing one factor does to a metric, the others held.

    Parameters
    ----------
    factor : Factor
    low, high : float [SI]
        From the lowest level that was measured to the highest.
    value : float
        The factor by which a magnitude grows, or the difference of another metric [SI].
    interval : (float, float), optional
        95 %; None where these runs cannot determine it, for the ``reason``.
    p_value : float, optional
        How often chance alone does as much.
    reason : str
    """

    factor: Factor
    low: float
    high: float
    value: float
    interval: tuple[float, float] | None
    p_value: float | None
    reason: str = ""


@dataclass(frozen=True)
class StripDeviation:
    """How far a strip is from what the others let expect.

    Parameters
    ----------
    sample : str
    value : float
        The factor by which its mean differs, or the difference [SI].
    p_value : float
        By Student's t, without the strip, for as many strips as were looked at (Holm).
    is_unlike : bool
    """

    sample: str
    value: float
    p_value: float
    is_unlike: bool


@dataclass(frozen=True, eq=False)
class MetricModel:
    """One metric of runs with one waveform, and the mixed model of it.

    Parameters
    ----------
    key : str
        ``channel.name`` of the metric.
    waveform : str
    metric : Metric
        One of them, for unit and definition.
    rows : tuple of RunRow
    factors : tuple of Factor
        Those that differ between the rows and can be distinguished.
    together : mapping of factor name to tuple of names
        Factors that change together with others, which therefore stand for both.
    is_ratio : bool
        Whether logarithms are compared.
    """

    key: str
    waveform: str
    metric: Metric
    rows: tuple[RunRow, ...]
    factors: tuple[Factor, ...]
    together: Mapping[str, tuple[str, ...]]
    is_ratio: bool
    values: FloatArray
    design: FloatArray
    ends: Mapping[str, tuple[float, float]]
    fit: MixedFit

    @property
    def label(self) -> str:
        """What people call the metric."""
        return metric_label(self.key)

    @property
    def samples(self) -> tuple[str, ...]:
        """The strips that have a name, in the order of the rows; a run without one counts as a strip of its own."""
        return tuple(dict.fromkeys(row.sample for row in self.rows if row.sample))

    def effects(self) -> tuple[Effect, ...]:
        """The effect of each factor, from its lowest level to its highest."""
        return tuple(self._effect(place, factor) for place, factor in enumerate(self.factors, start=1))

    def _effect(self, place: int, factor: Factor) -> Effect:
        estimate = self._each_left_out.effect(place)
        if estimate is None:
            estimate = self.fit.contrast(np.eye(self.design.shape[1])[place])
            estimate = replace(estimate, freedom=min(estimate.freedom, self._most_freedom(place)))
        low, high = self.ends[factor.name]
        reason = self._why_open(place)
        value, interval = self._back(estimate)
        if reason:
            return Effect(factor, low, high, value, None, None, reason)
        return Effect(factor, low, high, value, interval, estimate.p_value)

    @cached_property
    def _each_left_out(self) -> EachLeftOut:
        return each_left_out(self.values, self.design, _groups(self.rows), self.fit.variances)

    def _most_freedom(self, place: int) -> float:
        """Degrees of freedom that a factor has at most, as the analysis of variance counts them.

        One that differs between strips only has no more than there are strips, whatever runs each has. In an
        unbalanced campaign whose strips come out more alike than repeats, the approximation alone would say more.
        """
        strips, mountings = [row.strip for row in self.rows], _mountings(self.rows)
        columns = self.design[:, 1:].T
        if _is_constant_within(self.design[:, place], strips):
            return _freedom_of_strips(self.design, strips)
        if _is_constant_within(self.design[:, place], mountings):
            of_strips = sum(_is_constant_within(column, strips) for column in columns)
            of_mountings = sum(_is_constant_within(column, mountings) for column in columns) - of_strips
            return max(float(len(set(mountings)) - len(set(strips)) - of_mountings), 1.0)
        return math.inf

    def _back(self, estimate: Estimate) -> tuple[float, tuple[float, float]]:
        if not self.is_ratio:
            return estimate.value, estimate.interval
        low, high = estimate.interval
        return _exp(estimate.value), (_exp(low), _exp(high))

    def _why_open(self, place: int) -> str:
        """Why the scatter that an effect must be compared with is not known; empty where it is."""
        column = self.design[:, place]
        if _is_constant_within(column, [row.strip for row in self.rows]):
            if self._strips_are_known:
                return ""
            return (
                "it differs between strips only, and no two strips have the same: how far strips of one make differ is "
                "not known; measure a second strip of one kind"
            )
        mountings = _mountings(self.rows)
        if MOUNTING in self.fit.unseen and _is_constant_within(column, mountings) and _repeats(mountings):
            return (
                "it differs between mountings only, and no two mountings have the same: how far mountings differ is "
                "not known; mount the strip again"
            )
        return ""

    @property
    def _strips_are_known(self) -> bool:
        """Whether the runs show how far strips of one make differ; with one run each, the repeats have it."""
        return STRIP not in self.fit.unseen or not _repeats([row.strip for row in self.rows])

    def next_strip(self, condition: Mapping[str, float]) -> tuple[float, tuple[float, float]] | None:
        """What a strip that was not measured will read, once, in a mounting of its own.

        Parameters
        ----------
        condition : mapping of factor to float [SI]
            Every one of ``factors``.

        Returns
        -------
        value, interval : float, (float, float), or None
            The interval holds the reading of a new strip in 95 of 100 cases. None where fewer than three strips show
            how far strips differ.
        """
        if not self._strips_are_known or len(self.samples) < 3:
            return None
        strips = [row.strip for row in self.rows]
        return self._back(_of_strips(self.fit.new_reading(self.row_of(condition)), self.design, strips))

    def row_of(self, condition: Mapping[str, float]) -> FloatArray:
        """The row of the design for a condition: a value [SI] of every one of ``factors``."""
        return np.array([1.0, *(_place(factor, condition[factor.name], self.ends) for factor in self.factors)])

    def conditions(self) -> list[dict[str, float]]:
        """The conditions that were measured, each once: the levels of the factors."""
        columns = [levels_of(factor, [row.values[factor.name] for row in self.rows]) for factor in self.factors]
        found = dict.fromkeys(zip(*columns, strict=True)) if columns else {(): None}
        return [dict(zip([factor.name for factor in self.factors], one, strict=True)) for one in found]

    def strip_deviations(self) -> tuple[StripDeviation, ...]:
        """Each strip against a model of the others, the farthest first; empty for fewer than four strips."""
        if not self._strips_are_known or len(self.samples) < 4:
            return ()
        found = []
        for sample in self.samples:
            own = np.array([row.sample == sample for row in self.rows])
            x = self.design[~own]
            if len(x) <= x.shape[1] or np.linalg.matrix_rank(x) < x.shape[1]:
                continue  # the strip alone has a level of a factor: nothing shows what to expect of it
            others = [row for row in self.rows if row.sample != sample]
            if float(np.ptp(self.values[~own])) == 0.0:
                continue  # the others read the same everywhere, as a channel does that is not connected
            fit = fit_mixed(self.values[~own], x, _groups(others))
            strips = [row.strip for row in others]
            if STRIP in fit.unseen and _repeats(strips):
                continue
            mine = [row for row in self.rows if row.sample == sample]
            shares = shares_of(mine)
            expected = _of_strips(fit.new_reading(self.design[own].mean(axis=0), shares), x, strips)
            scatter = own_scatter(self.values[own] - self.design[own] @ fit.coefficients, _mountings(mine))
            usual = sum(shares[name] * fit.variances.get(name, 0.0) for name in (RESIDUAL, MOUNTING))
            found.append((sample, _welch(expected, float(self.values[own].mean()), scatter, usual)))
        return self.judged([(sample, deviation.value, deviation.p_value) for sample, deviation in found])

    def judged(self, found: Sequence[tuple[str, float, float]]) -> tuple[StripDeviation, ...]:
        """Strips, how far each is out, and how likely that is: the farthest first, with Holm's correction."""
        results, largest = [], 0.0
        for place, (sample, deviation, chance) in enumerate(sorted(found, key=lambda one: one[2])):
            largest = max(largest, min(1.0, (len(found) - place) * chance))
            results.append(
                StripDeviation(sample, _exp(deviation) if self.is_ratio else deviation, largest, largest < _UNLIKE)
            )
        return tuple(results)


def model_metric(key: str, waveform: str, rows: Sequence[RunRow], factors: Sequence[Factor]) -> MetricModel | None:
    """The model of one metric over runs with one waveform.

    Parameters
    ----------
    key : str
        ``channel.name`` of the metric.
    waveform : str
    rows : sequence of RunRow
        Rows of other waveforms, or without the metric or a factor that most have, are left out.
    factors : sequence of Factor
        In the order in which they are preferred where two of them change together.

    Returns
    -------
    model : MetricModel or None
        None where there are not enough runs for a scatter.
    """
    used_rows = [row for row in rows if row.waveform == waveform and key in row.metrics]
    used_rows = [row for row in used_rows if math.isfinite(row.metrics[key].value)]
    used = [factor for factor in factors if 2 * sum(factor.name in row.values for row in used_rows) > len(used_rows)]
    used_rows = [row for row in used_rows if all(factor.name in row.values for factor in used)]
    used = [
        factor for factor in used if len(set(levels_of(factor, [row.values[factor.name] for row in used_rows]))) > 1
    ]
    if len(used_rows) < 3:
        return None
    ends = {factor.name: _ends(factor, used_rows) for factor in used}
    columns = {
        factor: np.array([_place(factor, row.values[factor.name], ends) for row in used_rows]) for factor in used
    }
    kept, together = _distinguished(columns)
    design = np.column_stack([np.ones(len(used_rows)), *(columns[factor] for factor in kept)])
    values = np.array([row.metrics[key].value for row in used_rows])
    name = key.partition(".")[2]
    is_ratio = name in MAGNITUDES and bool(np.all(values != 0.0))
    values = np.log(np.abs(values)) if is_ratio else values
    if len(used_rows) < design.shape[1] + 2 or float(np.ptp(values)) == 0.0:
        return None
    fit = fit_mixed(values, design, _groups(used_rows))
    metric = used_rows[0].metrics[key]
    return MetricModel(key, waveform, metric, tuple(used_rows), kept, together, is_ratio, values, design, ends, fit)


def _ends(factor: Factor, rows: Sequence[RunRow]) -> tuple[float, float]:
    levels = levels_of(factor, [row.values[factor.name] for row in rows])
    return min(levels), max(levels)


def _place(factor: Factor, value: float, ends: Mapping[str, tuple[float, float]]) -> float:
    """Where a value is between the lowest level (0) and the highest (1)."""
    low, high = (factor.coordinate(end) for end in ends[factor.name])
    return (factor.coordinate(value) - low) / (high - low)


def _distinguished(
    columns: Mapping[Factor, FloatArray],
) -> tuple[tuple[Factor, ...], dict[str, tuple[str, ...]]]:
    """The factors that have a part of their own, and for those that have none, with which ones they change."""
    kept: list[Factor] = []
    together: dict[str, tuple[str, ...]] = {}
    for factor, column in columns.items():
        basis = np.column_stack([np.ones(len(column)), *(columns[one] for one in kept)])
        weights, *_ = np.linalg.lstsq(basis, column, rcond=None)
        own = float(np.sum((column - basis @ weights) ** 2))
        if own > _TOGETHER * float(np.sum((column - column.mean()) ** 2)):
            kept.append(factor)
            continue
        explaining = [one.name for one, weight in zip(kept, weights[1:], strict=True) if abs(weight) > 0.01]
        together[factor.name] = tuple(explaining)
    return tuple(kept), together


def _groups(rows: Sequence[RunRow]) -> dict[str, list[str]]:
    return {STRIP: [row.strip for row in rows], MOUNTING: _mountings(rows)}


def _mountings(rows: Sequence[RunRow]) -> list[str]:
    """The mounting of each run; a number may be used again for another strip."""
    return [f"{row.strip}\0{row.mounting}" for row in rows]


def shares_of(rows: Sequence[RunRow]) -> dict[str, float]:
    """How much of each component of variance the mean of one strip's runs has."""
    counts = np.unique(_mountings(rows), return_counts=True)[1] / len(rows)
    return {RESIDUAL: 1.0 / len(rows), MOUNTING: float(np.sum(counts**2)), STRIP: 1.0}


def _of_strips(expected: Estimate, design: FloatArray, strips: Sequence[str]) -> Estimate:
    """What a new strip will read, known no better than by as many strips as there are.

    Where the strips of a few come out more alike than repeats are, the approximation by Satterthwaite counts repeats:
    of 3 to 5 strips that differed its 95 % held the next one in 90 to 96 %, and named one as unlike in up to 13 %.
    """
    return replace(expected, freedom=min(expected.freedom, _freedom_of_strips(design, strips)))


def _welch(expected: Estimate, mean: float, own: OwnScatter, usual: float) -> Estimate:
    """How far the mean of a strip is from what was expected, where its own readings may scatter more than is usual."""
    among, more = expected.standard_error**2, float(own.beyond(usual))
    if more == 0.0:
        return replace(expected, value=mean - expected.value)
    freedom = (among + more) ** 2 / (among**2 / expected.freedom + more**2 / own.freedom)
    # Two variances together are known better than one; but more scatter is no reason to name a strip sooner.
    return Estimate(mean - expected.value, math.sqrt(among + more), min(freedom, expected.freedom))


def _freedom_of_strips(design: FloatArray, strips: Sequence[str]) -> float:
    """By how many more strips than are needed for what differs between strips only, the mean included."""
    return max(float(len(set(strips)) - sum(_is_constant_within(column, strips) for column in design.T)), 1.0)


def _is_constant_within(column: FloatArray, groups: Sequence[str]) -> bool:
    codes: dict[str, int] = {}
    group = np.array([codes.setdefault(one, len(codes)) for one in groups])
    low, high = np.full(len(codes), np.inf), np.full(len(codes), -np.inf)
    np.minimum.at(low, group, column)
    np.maximum.at(high, group, column)
    return bool(np.all(high - low < _SAME))


def _repeats(groups: Sequence[str]) -> bool:
    return len(set(groups)) < len(groups)


def _exp(value: float) -> float:
    return math.exp(min(value, 700.0))
