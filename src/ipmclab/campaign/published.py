"""What the thesis printed of its samples compared with what a campaign gives: the same number, read in the same way."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ipmclab.campaign.blocks import BASELINE
from ipmclab.campaign.campaign import ROOM
from ipmclab.campaign.results import Repeated
from ipmclab.data import PublishedInWords, PublishedMeasurement, published_in_words, published_measurements
from ipmclab.prediction.headline import DURATION, READINGS
from ipmclab.units import CHANNELS, Quantity

READ_AS: Final[Mapping[tuple[str, str], str]] = {
    ("step", "peak_current"): "peak_at_first_edge",
    ("step", "steady_current"): "mean_of_last_tenth",
    ("step", "max_displacement"): "largest",
    ("step", "max_force"): "largest",
    ("sine", "peak_current"): "amplitude",
    ("sine", "max_displacement"): "amplitude",
    ("sine", "max_force"): "amplitude",
    ("square", "peak_current"): "largest",
    ("square", "half_period_end_current"): "half_period_end",
    ("square", "max_displacement"): "amplitude",
    ("square", "max_force"): "amplitude",
}
"""By waveform and metric of the published table: the metric of a run that is the same number."""

CURLED_FOR: Final = 360.0
"""How long a strip curled [s] of which the thesis has a number: 2 mm in 6 minutes (figure 5.42)."""

_SAMPLE: Final = re.compile(r"friend-(\d)$")


@dataclass(frozen=True)
class Reproduced:
    """One printed number next to that of a campaign.

    Parameters
    ----------
    published : PublishedMeasurement
    values : tuple of float [SI]
        Of each repeat.
    number : float [SI]
        As printed.
    """

    published: PublishedMeasurement
    values: tuple[float, ...]
    number: float

    @property
    def quantity(self) -> Quantity:
        """Current, displacement or force."""
        return CHANNELS[_channel(self.published.metric)]

    @property
    def signal(self) -> str:
        """The voltage, such as ``"sine 1 V 0.1 Hz"``."""
        return _signal(self.published)

    @property
    def mean(self) -> float:
        """Over the repeats [SI]."""
        return float(np.mean(self.values))

    @property
    def tolerance(self) -> float:
        """Within what fraction of the printed number the strips of the library were identified."""
        return READINGS[self.published.waveform, self.published.metric].tolerance

    @property
    def difference(self) -> float:
        """Campaign minus printed, as a fraction of the printed number; 0 above a lower bound."""
        difference = (self.mean - self.number) / self.number
        return min(difference, 0.0) if self.published.qualifier == "lower_bound" else difference

    @property
    def agrees(self) -> bool:
        """Whether it is within the tolerance."""
        return abs(self.difference) <= self.tolerance


def reproduced(repeated: Sequence[Repeated]) -> tuple[Reproduced, ...]:
    """Every printed number for which a campaign has a run of the same sample, signal and condition.

    Parameters
    ----------
    repeated : sequence of Repeated
        Samples that are called ``friend-1`` to ``friend-7`` are those of the thesis; its runs last 40 s.
    """
    found: list[Reproduced] = []
    for sample, condition in dict.fromkeys((one.sample, one.condition) for one in repeated):
        match = _SAMPLE.match(sample)
        if match is None:
            continue
        there = [one for one in repeated if (one.sample, one.condition) == (sample, condition)]
        for row in published_measurements(int(match[1]), conditions=_as_published(condition)):
            found += _of(row, there)
    return tuple(found)


@dataclass(frozen=True)
class Curled:
    """About how far the thesis says that a strip curled without a voltage, beside a baseline of a campaign.

    Parameters
    ----------
    published : PublishedInWords
    kind : Repeated
    distance : float [m]
        Mean over the repeats.
    """

    published: PublishedInWords
    kind: Repeated
    distance: float


def curled(repeated: Sequence[Repeated]) -> tuple[Curled, ...]:
    """The baselines of a campaign that last as long as those of which the thesis has a number."""
    found = []
    printed = {row.samples: row for row in published_in_words("baseline_drift") if row.number is not None}
    for one in repeated:
        match = _SAMPLE.match(one.sample)
        row = printed.get((int(match[1]),)) if match else None
        if row is None or (one.measured, one.label) != (row.measured, BASELINE):
            continue
        lasts = {result.run.planned.duration for result in one.results} == {CURLED_FOR}
        distance = one.mean(row.measured, "largest")
        if lasts and _as_published(one.condition) == row.conditions and distance is not None:
            found.append(Curled(row, one, abs(distance[0])))
    return tuple(found)


def unprinted(repeated: Sequence[Repeated], found: Sequence[Reproduced]) -> tuple[str, ...]:
    """Kinds of runs of which nothing is printed."""
    covered = {(one.published.sample, one.published.measured, one.signal, one.published.conditions) for one in found}
    curls = [one.published for one in curled(repeated)]
    covered |= {(one.samples[0], one.measured, BASELINE, one.conditions) for one in curls}
    names = []
    for one in repeated:
        match = _SAMPLE.match(one.sample)
        key = (int(match[1]), one.measured, one.label, _as_published(one.condition)) if match else None
        if key is not None and key not in covered:
            names.append(f"{one.sample}, {one.part}, {one.condition}, {one.label}")
    return tuple(names)


def _of(row: PublishedMeasurement, there: Sequence[Repeated]) -> Iterator[Reproduced]:
    """The number of the first experiment that has this run."""
    channel, name = _channel(row.metric), READ_AS[row.waveform, row.metric]
    for one in there:
        # A current that is steady at 40 s is not yet steady at 8 s.
        lasts = {result.run.planned.duration for result in one.results} == {DURATION}
        is_it = lasts and (one.measured, one.label) == (row.measured, _signal(row))
        metrics = one.metrics(channel, name) if is_it else ()
        if metrics:
            yield Reproduced(row, tuple(abs(metric.value) for metric in metrics), row.value(CHANNELS[channel]))
            return


def _channel(metric: str) -> str:
    return metric.rpartition("_")[2]


def _signal(row: PublishedMeasurement) -> str:
    return f"{row.waveform} {row.amplitude:g} V" + ("" if row.frequency is None else f" {row.frequency:g} Hz")


def _as_published(condition: str) -> str:
    return "room" if condition == ROOM else condition
