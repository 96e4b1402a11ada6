"""A number and what makes it uncertain: one contribution of each source, so that what two numbers share is not counted
twice.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.confidence import NORMAL_95, wider_for_few
from ipmclab.measurement.amount import shown
from ipmclab.measurement.written import Written
from ipmclab.ties import names_by_size

FloatArray = npt.NDArray[np.float64]

REPEATS: Final = 0.03
"""Relative standard uncertainty that a number of a run has in addition to its noise: gains, and where exactly it was
read."""

_STEP: Final = 1e-5  # of a value, over which a derivative is taken
_MOST_PLACES: Final = 6  # after the decimal point
_NOTHING: Final = 1e-9  # of a variance
_APART: Final = "#"  # what follows it numbers the parts of one source, which a reader wants as one


@dataclass(frozen=True)
class Uncertain:
    """A number whose standard uncertainty is made of contributions (GUM, section 5).

    Parameters
    ----------
    value : float [SI]
    parts : mapping of source to float [SI]
        How far the number moves with one standard uncertainty of the source, with its sign: two numbers that
        share a source move together.
    assumed : frozenset of str
        Sources of which nobody stated the uncertainty.
    written : mapping of source to Written
        What is in a file for the numbers that it was made of.

    Examples
    --------
    >>> length, width = Uncertain(30e-3, {"length": 0.5e-3}), Uncertain(5e-3, {"width": 0.1e-3})
    >>> area = derived(lambda a, b: a * b, length, width)
    >>> round(area.uncertainty / area.value, 4), round(derived(lambda s, a: s / a, area, length).value, 6)
    (0.026, 0.005)
    """

    value: float
    parts: Mapping[str, float] = field(default_factory=dict)
    assumed: frozenset[str] = frozenset()
    written: Mapping[str, Written] = field(default_factory=dict, compare=False, repr=False)

    @property
    def uncertainty(self) -> float:
        """One standard uncertainty [SI]."""
        return math.sqrt(sum(part * part for part in self.parts.values()))

    @property
    def interval(self) -> tuple[float, float]:
        """95 %, not below zero: nothing that is measured here is negative."""
        reach = NORMAL_95 * self.uncertainty
        return max(self.value - reach, 0.0), self.value + reach

    @property
    def shares(self) -> dict[str, float]:
        """What part of the variance each source has, the largest first."""
        whole = self.uncertainty**2
        if math.isinf(whole):
            return {}
        found: dict[str, float] = {}
        for source, part in self.parts.items():
            name = source.partition(_APART)[0]
            found[name] = found.get(name, 0.0) + (part * part / whole if whole else 0.0)
        return {name: found[name] for name in names_by_size(found) if found[name] > _NOTHING}

    def without(self, sources: Iterable[str]) -> Uncertain:
        """The number as it is when some sources are exact."""
        gone = set(sources)
        kept = {source: part for source, part in self.parts.items() if source not in gone}
        return replace(self, parts=kept, assumed=self.assumed - gone)

    def said(self, unit: str, factor: float = 1.0) -> str:
        """The number with its uncertainty: ``"1.333 ± 0.016 ohm/sq"``; ``factor`` is the unit in SI units."""
        value, error = self.value / factor, self.uncertainty / factor
        if math.isinf(error):
            return "not determined"
        if not error > 0.0:
            return f"{shown(value, 5)} {unit}".rstrip()
        places = 1 - math.floor(math.log10(error))  # of the second digit of the error
        if 0 <= places <= _MOST_PLACES:
            return f"{value:.{places}f} ± {error:.{places}f} {unit}".rstrip()
        digits = max(2, math.floor(math.log10(abs(value))) + places + 1) if value else 2
        return f"{shown(value, digits)} ± {shown(error, 2)} {unit}".rstrip()


def exact(value: float) -> Uncertain:
    """A number without uncertainty."""
    return Uncertain(value)


def derived(function: Callable[..., float], *inputs: Uncertain) -> Uncertain:
    """What follows from other numbers, to first order in their uncertainties.

    Parameters
    ----------
    function : function of floats
        One for each input; smooth over their uncertainties.
    *inputs : Uncertain
    """
    values = [one.value for one in inputs]
    parts: dict[str, float] = {}
    for place, one in enumerate(inputs):
        if not one.parts:
            continue
        step = _STEP * (abs(one.value) or one.uncertainty)
        ends = [function(*values[:place], one.value + sign * step, *values[place + 1 :]) for sign in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / (2.0 * step)
        for source, part in one.parts.items():
            parts[source] = parts.get(source, 0.0) + slope * part
    assumed = frozenset[str]().union(*(one.assumed for one in inputs))
    written = {source: readings for one in inputs for source, readings in one.written.items()}
    return Uncertain(function(*values), parts, assumed, written)


def mean_of(values: Sequence[float], source: str) -> Uncertain:
    """The mean of repeated readings, wider for few of them, so that twice the uncertainty holds 95 % (Student).

    Examples
    --------
    >>> round(mean_of([2.0, 2.2, 2.1], "readings").uncertainty, 3)
    0.127
    """
    count = len(values)
    mean = float(np.mean(values))
    if count < 2:
        return Uncertain(mean)
    scatter = wider_for_few(count - 1) * float(np.std(values, ddof=1)) / math.sqrt(count)
    return Uncertain(mean, {source: scatter} if scatter else {})


def weighted_mean(several: Sequence[Uncertain]) -> Uncertain:
    """The mean of numbers that stand for the same thing, each with the weight of what is its own."""
    if len(several) == 1:
        return several[0]
    common = set.intersection(*(set(one.parts) for one in several))
    own = np.array([one.without(common).uncertainty for one in several])
    weights = 1.0 / own**2 if own.all() else np.ones(len(several))
    weights = weights / weights.sum()

    def mean(*values: float) -> float:
        return float(weights @ np.array(values))

    return derived(mean, *several)
