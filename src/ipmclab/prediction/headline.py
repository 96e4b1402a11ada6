"""Headline numbers: the one number for each quantity that a publication prints of a run, each with its definition.

The thesis seldom says at which edge or time a number was read. How a model is compared with it is stated here,
once, together with how near it has to come.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Final

import numpy as np

from ipmclab.data import PublishedMeasurement, published_measurements
from ipmclab.model import Actuator, simulate
from ipmclab.model.stages.circuit import CONTACT
from ipmclab.run import FloatArray, Run
from ipmclab.units import CHANNELS, Quantity

DURATION: Final = 40.0
"""Length of each run [s] (Friend, appendix A.2): four periods of 0.1 Hz."""

RATE: Final = 50.0
"""Rows a second, as on the thesis's rig [Hz] (Friend, appendix A.2)."""

PERIOD: Final = 10.0
"""Of the sine and of the square [s] (the thesis, chapter 5)."""

SIGNALS: Final = {"step": "step 1 V", "sine": "sine 1 V 0.1 Hz", "square": "square 1 V 0.1 Hz"}

BACK_RELAXATION_FROM: Final = 5.0
"""Up to here model and step agree [s]: said of the displacement (Friend, section 5.2 and figure 5.68).

Of the force the thesis says "after a few seconds"; it is read up to the same time."""

Published = Mapping[tuple[str, str], "Reading"]


@dataclass(frozen=True)
class Reading:
    """How a published number is read from a run.

    Parameters
    ----------
    definition : str
    tolerance : float
        A model agrees that is within this fraction of the published number.
    of : callable
        From time [s] and the channel's readings to the number.
    """

    definition: str
    tolerance: float
    of: Callable[[FloatArray, FloatArray], float]


def at_end(_time: FloatArray, values: FloatArray) -> float:
    """The last reading."""
    return float(values[-1])


def largest(_time: FloatArray, values: FloatArray) -> float:
    """The largest deviation from zero."""
    return float(np.max(np.abs(values)))


def amplitude(time: FloatArray, values: FloatArray) -> float:
    """Half the peak to peak value over the last period."""
    return float(np.ptp(values[time >= DURATION - PERIOD - 0.5 / RATE]) / 2.0)


def before_first_reversal(time: FloatArray, values: FloatArray) -> float:
    """The last reading of the first half period."""
    return float(values[time < PERIOD / 2.0 - 0.5 / RATE][-1])


_PEAK, _STEADY, _DISPLACEMENT, _FORCE = 0.15, 0.20, 0.10, 0.20
"""Of the published number, within which a model agrees (convention)."""
_LAST_PERIOD: Final = "amplitude, last period"
_OF_RECORD: Final = f"largest of the record, {DURATION:g} s"

READINGS: Final[Published] = {
    ("step", "peak_current"): Reading("just after the step", _PEAK, largest),
    ("step", "steady_current"): Reading(f"at the end, {DURATION:g} s", _STEADY, at_end),
    ("step", "max_displacement"): Reading(_OF_RECORD, _DISPLACEMENT, largest),
    ("step", "max_force"): Reading(_OF_RECORD, _FORCE, largest),
    ("sine", "peak_current"): Reading(_LAST_PERIOD, _PEAK, amplitude),
    ("sine", "max_displacement"): Reading(_LAST_PERIOD, _DISPLACEMENT, amplitude),
    ("sine", "max_force"): Reading(_LAST_PERIOD, _FORCE, amplitude),
    ("square", "peak_current"): Reading("largest at a reversal", _PEAK, largest),
    ("square", "half_period_end_current"): Reading("before the first reversal", _STEADY, before_first_reversal),
    ("square", "max_displacement"): Reading(_LAST_PERIOD, _DISPLACEMENT, amplitude),
    ("square", "max_force"): Reading(_LAST_PERIOD, _FORCE, amplitude),
}
"""By waveform and metric of the published table; rows are at k/50 s, a jump acts from row 0 (hold ``zero``)."""


@dataclass(frozen=True)
class HeadlineRun:
    """A published run: its signal, and what was printed of it.

    Parameters
    ----------
    figure : str
    measured : "displacement" or "force"
    waveform : "step", "sine" or "square"
    amplitude : float [V]
    numbers : tuple of PublishedMeasurement
    """

    figure: str
    measured: str
    waveform: str
    amplitude: float
    numbers: tuple[PublishedMeasurement, ...]

    @property
    def signal(self) -> str:
        """The voltage, such as ``"sine 1 V 0.1 Hz"``."""
        frequency = self.numbers[0].frequency
        return f"{self.waveform} {self.amplitude:g} V" + ("" if frequency is None else f" {frequency:g} Hz")

    def value(self, metric: str) -> float:
        """A published number [SI].

        Raises
        ------
        KeyError
            Nothing of that name was printed.
        """
        for row in self.numbers:
            if row.metric == metric:
                return row.value(quantity_of(metric))
        raise KeyError(metric)

    def simulate(self, actuator: Actuator, contact_resistance: float = 0.0) -> Run:
        """The run as a model has it, with its own contact resistance [ohm]."""
        strip = actuator.replace(**{CONTACT: contact_resistance})
        return simulate(strip, self.signal, duration=DURATION, rate=RATE)


@dataclass(frozen=True)
class Comparison:
    """One published number with a model's.

    Parameters
    ----------
    run : HeadlineRun
    metric : str
    model : float [SI]
    published : float [SI]
    """

    run: HeadlineRun
    metric: str
    model: float
    published: float
    lower_bound: bool = False

    @property
    def reading(self) -> Reading:
        """How the number is read, and how near a model has to come."""
        return READINGS[self.run.waveform, self.metric]

    @property
    def quantity(self) -> Quantity:
        """Current, displacement or force."""
        return quantity_of(self.metric)

    @property
    def difference(self) -> float:
        """Model minus published, as a fraction of the published number; 0 above a lower bound."""
        difference = (self.model - self.published) / self.published
        return min(difference, 0.0) if self.lower_bound else difference

    @property
    def agrees(self) -> bool:
        """Whether the model is within the reading's tolerance."""
        return abs(self.difference) <= self.reading.tolerance


def quantity_of(metric: str) -> Quantity:
    """The quantity of a metric: ``peak_current`` is a current."""
    return CHANNELS[metric.rpartition("_")[2]]


def headline_runs(sample: int, measured: str | None = None) -> tuple[HeadlineRun, ...]:
    """The runs of a sample of which the thesis prints a current, in the order of its figures.

    Of sample 2 those at room conditions, of the others those at 20 degC and 80 %RH: at others no current is printed.

    Parameters
    ----------
    sample : int
        1 to 7.
    measured : "displacement" or "force", optional
        Only the runs that measured this.

    Examples
    --------
    >>> [f"{run.figure}: {run.signal}" for run in headline_runs(2, "force")]
    ['5.18: step 1 V', '5.19: sine 1 V 0.1 Hz', '5.20: square 1 V 0.1 Hz']
    """
    rows = published_measurements(sample, conditions="room" if sample == 2 else "20 degC, 80 %RH")
    found = []
    for (figure, kind), members in groupby(rows, key=lambda row: (row.figure, row.measured)):
        numbers = tuple(members)
        has_current = any(row.metric.endswith("current") for row in numbers)
        if has_current and measured in (None, kind):
            found.append(HeadlineRun(figure, kind, numbers[0].waveform, numbers[0].amplitude, numbers))
    return tuple(found)


def compare(actuator: Actuator, run: HeadlineRun, contact_resistance: float = 0.0) -> tuple[Comparison, ...]:
    """What a model gives for a published run, number by number.

    Parameters
    ----------
    actuator : Actuator
    run : HeadlineRun
    contact_resistance : float [ohm]
        Of this run: clamping differs from run to run.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> step, sine, square = headline_runs(2, "force")
    >>> [f"{row.metric} {100 * row.difference:.0f} %" for row in compare(load_actuator("friend-2"), sine)]
    ['max_force 8 %', 'peak_current 17 %']
    """
    return read(run, run.simulate(actuator, contact_resistance))


def read(run: HeadlineRun, simulated: Run) -> tuple[Comparison, ...]:
    """The printed numbers of a run next to those of a record of it, number by number."""
    found = []
    for row in run.numbers:
        channel = row.metric.rpartition("_")[2]
        model = READINGS[run.waveform, row.metric].of(simulated.time, simulated.channels[channel])
        bound = row.qualifier == "lower_bound"
        found.append(Comparison(run, row.metric, model, row.value(CHANNELS[channel]), bound))
    return tuple(found)
