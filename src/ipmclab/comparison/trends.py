"""Which law a metric follows along a factor: exponential as the thesis says, or another.

Four laws with one parameter of shape each, and none at all, fitted alike: errors multiply, and each group of runs that
differ in nothing but this factor has a size of its own. They are compared by AICc and by the error at levels that were
left out. A flat course is one of every law: that the runs call for no shape excludes none. Friend calls the growth
with humidity, voltage and temperature exponential, each observed at three levels of one strip: with two free numbers a
law, three readings decide nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

from ipmclab.comparison.factors import FACTORS, Factor, levels_of
from ipmclab.comparison.mixed_blocks import FloatArray
from ipmclab.comparison.table import RunRow

IntArray = npt.NDArray[np.intp]

_TELLS: Final = 6.0
"""A law counts as excluded where another has an AICc lower by this: it makes the readings twenty times as likely.

What is true is then excluded by a given law once in twenty campaigns at most, whatever the law. By 2, from which on
Burnham and Anderson (2002, p. 70) speak of less support, it was excluded in up to a third.
"""

_BOUNDS: Final = (-20.0, 20.0)
"""Range of a shape: by what the logarithm of an exponential changes from the lowest level to the highest."""


@dataclass(frozen=True)
class Law:
    """One way in which a metric may follow a factor.

    Parameters
    ----------
    name : str
    shape : callable
        Logarithm of the law's course for a parameter, at places from 0 (the lowest level) to 1, and for the ratio of
        the highest level to the lowest; NaN where the law is not positive.
    """

    name: str
    shape: Callable[[float, FloatArray, float], FloatArray]


def _log(values: FloatArray) -> FloatArray:
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(values > 0.0, np.log(np.maximum(values, 1e-300)), np.nan)


def _logarithmic(place: FloatArray, ratio: float) -> FloatArray:
    return np.log1p(place * (ratio - 1.0)) / math.log(ratio)


_FLAT: Final = "constant"

LAWS: Final = (
    Law(_FLAT, lambda _, place, __: np.zeros_like(place)),
    Law("linear", lambda b, place, _: _log(1.0 + math.expm1(b) * place)),
    Law("exponential", lambda b, place, _: b * place),
    Law("power", lambda b, place, ratio: b * _logarithmic(place, ratio)),
    Law("logarithmic", lambda b, place, ratio: _log(1.0 + math.expm1(b) * _logarithmic(place, ratio))),
)
"""All but the first reach exp(b) times their start at the highest level."""


@dataclass(frozen=True)
class LawFit:
    """One law, fitted.

    Parameters
    ----------
    law : str
    change : float
        By what factor the metric grows from the lowest level to the highest.
    aicc : float
        Above that of the best law; infinite where there are too few runs.
    held_out : float
        Root mean square error of the logarithm at levels that were left out; NaN where none can be.
    """

    law: str
    change: float
    aicc: float
    held_out: float


@dataclass(frozen=True)
class Trend:
    """The course of a metric along a factor.

    Parameters
    ----------
    key, waveform : str
    factor : Factor
    levels : tuple of float [SI]
    runs : int
    laws : tuple of LawFit
        The best first.
    not_excluded : tuple of str
        Laws that the runs do not exclude; all of them where they show nothing.
    """

    key: str
    waveform: str
    factor: Factor
    levels: tuple[float, ...]
    runs: int
    laws: tuple[LawFit, ...]
    not_excluded: tuple[str, ...]

    def __str__(self) -> str:
        """One sentence."""
        if len(self.not_excluded) == len(self.laws):
            return f"{self.runs} runs at {len(self.levels)} levels do not distinguish the laws"
        if len(self.not_excluded) == 1:
            return f"{self.not_excluded[0]}: every other law is excluded"
        excluded = [one.law for one in self.laws if one.law not in self.not_excluded]
        return f"{' or '.join(self.not_excluded)}; excluded: {', '.join(excluded)}"


def trend_of(key: str, waveform: str, rows: Sequence[RunRow], factor: Factor) -> Trend | None:
    """Hold the laws against the runs.

    Parameters
    ----------
    key, waveform : str
        Of the metric and the runs.
    rows : sequence of RunRow
    factor : Factor

    Returns
    -------
    trend : Trend or None
        None for fewer than three levels of the factor, a metric that is zero somewhere, or a factor that is not above
        zero.
    """
    used = [
        row
        for row in rows
        if row.waveform == waveform and factor.name in row.values and key in row.metrics and row.metrics[key].value
    ]
    if not used:
        return None
    along = levels_of(factor, [row.values[factor.name] for row in used])
    groups = _alike(used, factor)
    # A group at one level says nothing of the course.
    seen: dict[tuple[object, ...], set[float]] = {}
    for group, level in zip(groups, along, strict=True):
        seen.setdefault(group, set()).add(level)
    kept = [place for place, group in enumerate(groups) if len(seen[group]) > 1]
    x = np.array([along[place] for place in kept])
    levels = tuple(sorted(set(x.tolist())))
    if len(levels) < 3 or levels[0] <= 0.0:
        return None
    logs = np.log(np.abs([used[place].metrics[key].value for place in kept]))
    order = {group: number for number, group in enumerate(dict.fromkeys(groups[place] for place in kept))}
    member = np.array([order[groups[place]] for place in kept], dtype=np.intp)
    place = (x - levels[0]) / (levels[-1] - levels[0])
    fits = [_fit(law, place, levels[-1] / levels[0], logs, member) for law in LAWS]
    # A law for which there are too few runs cannot be excluded by one that needs fewer.
    best = min(one.aicc for one in fits) if all(math.isfinite(one.aicc) for one in fits) else math.inf
    fits = [replace(one, aicc=one.aicc - best if math.isfinite(best) else math.inf) for one in fits]
    fits.sort(key=lambda one: (one.aicc, one.held_out))
    of_shape = min(one.aicc for one in fits if one.law != _FLAT)
    open_ones = tuple(
        one.law
        for one in fits
        if not math.isfinite(best) or one.aicc <= _TELLS + (0.0 if one.law == _FLAT else of_shape)
    )
    return Trend(key, waveform, factor, levels, len(kept), tuple(fits), open_ones)


def _alike(rows: Sequence[RunRow], factor: Factor) -> list[tuple[object, ...]]:
    """For each run, what it shares with those that differ from it in this factor alone."""
    columns: list[list[object]] = [[row.sample for row in rows], [row.mounting for row in rows]]
    for other in FACTORS.values():
        if other.name == factor.name:
            continue
        known = [row.values.get(other.name) for row in rows]
        there = [value for value in known if value is not None]
        levels = iter(levels_of(other, there) if there else [])
        columns.append([None if value is None else round(next(levels, 0.0), 12) for value in known])
    return list(zip(*columns, strict=True))


def _fit(law: Law, place: FloatArray, ratio: float, logs: FloatArray, member: IntArray) -> LawFit:
    shape = _best_shape(law, place, ratio, logs, member)
    left = _left(law.shape(shape, place, ratio), logs, member)
    count, groups = len(logs), len(set(member.tolist()))
    free = groups + (law.name != _FLAT) + 1
    variance = float(left @ left) / count
    room = count - free - 1
    aicc = math.inf if room <= 0 else count * math.log(max(variance, 1e-30)) + 2.0 * free * (1.0 + (free + 1.0) / room)
    change = math.exp(shape) if law.name != _FLAT else 1.0
    return LawFit(law.name, change, aicc, _held_out(law, place, ratio, logs, member))


def _best_shape(law: Law, place: FloatArray, ratio: float, logs: FloatArray, member: IntArray) -> float:
    if law.name == _FLAT:
        return 0.0

    def loss(shape: float) -> float:
        left = _left(law.shape(shape, place, ratio), logs, member)
        return float(left @ left)

    # The course of each law bends with its shape in one direction only: a coarse grid finds the valley.
    grid = np.linspace(*_BOUNDS, 41)
    at = int(np.argmin([loss(float(one)) for one in grid]))
    ends = grid[max(at - 1, 0)], grid[min(at + 1, len(grid) - 1)]
    return float(minimize_scalar(loss, bounds=ends, method="bounded", options={"xatol": 1e-9}).x)


def _left(course: FloatArray, logs: FloatArray, member: IntArray) -> FloatArray:
    """What a course leaves, each group with a size of its own."""
    residual = logs - course
    counts = np.bincount(member)
    with np.errstate(invalid="ignore", divide="ignore"):
        own = np.bincount(member, residual) / counts
    return residual - own[member]


def _held_out(law: Law, place: FloatArray, ratio: float, logs: FloatArray, member: IntArray) -> float:
    """Error at each level as the other levels of the same groups let expect."""
    errors: list[float] = []
    for level in np.unique(place):
        out = place == level
        if len(np.unique(place[~out])) < 2:
            return math.nan
        shape = _best_shape(law, place[~out], ratio, logs[~out], member[~out])
        residual = logs - law.shape(shape, place, ratio)
        counts = np.bincount(member[~out], minlength=member.max() + 1)
        with np.errstate(invalid="ignore", divide="ignore"):
            means = np.bincount(member[~out], residual[~out], minlength=len(counts)) / counts
        own_group = member[out][counts[member[out]] > 0]
        errors += (residual[out][counts[member[out]] > 0] - means[own_group]).tolist()
    finite = [one for one in errors if math.isfinite(one)]
    return math.sqrt(float(np.mean(np.square(finite)))) if len(finite) == len(errors) and errors else math.nan
