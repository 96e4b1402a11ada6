"""A model compared with what the thesis states about its sample 2: each number with its definition.

The thesis prints one number for each quantity and seldom says at which edge or time it was read.
The readings below are the ones under which its own tables come nearest to it; each says what it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from ipmclab.data import published_measurements
from ipmclab.model import Actuator, simulate
from ipmclab.prediction import headline
from ipmclab.prediction.headline import BACK_RELAXATION_FROM, DURATION, RATE, SIGNALS, Reading, at_end
from ipmclab.run import FloatArray
from ipmclab.units import CHANNELS, Quantity

AGREES: Final = 0.20
"""A model within this fraction of the thesis's number reproduces it."""


def _largest_before_relaxation(time: FloatArray, values: FloatArray) -> float:
    return float(np.max(values[time <= BACK_RELAXATION_FROM]))


_AT_END = Reading(f"at the end, {DURATION:g} s", AGREES, at_end)

READINGS: Final[Mapping[tuple[str, str], Reading]] = {
    **headline.READINGS,
    # A model without back relaxation continues rising where the strip does not.
    ("step", "max_force"): Reading(f"largest up to {BACK_RELAXATION_FROM:g} s", AGREES, _largest_before_relaxation),
}
"""By waveform and metric of the published table."""


@dataclass(frozen=True)
class Comparison:
    """One published number with the model's.

    Parameters
    ----------
    figure, measured, waveform, metric : str
        As in the published table.
    definition : str
        Where the model's number was read.
    published, model : float [SI unit of the quantity]
    quantity : Quantity
    qualifier : "stated", "lower_bound" or "upper_bound"
        What is known about the published number.
    """

    figure: str
    measured: str
    waveform: str
    metric: str
    definition: str
    published: float
    model: float
    quantity: Quantity
    qualifier: Literal["stated", "lower_bound", "upper_bound"]

    @property
    def name(self) -> str:
        """The quantity in words, such as ``"step peak current"``."""
        return f"{self.waveform} {self.metric.replace('_', ' ')}"

    @property
    def against(self) -> str:
        """Model against published, such as ``"12.6 against 7 mA"``."""
        unit = self.quantity.display_unit
        return (
            f"{self.quantity.to_display(self.model):.3g} against {self.quantity.to_display(self.published):.3g} {unit}"
        )

    @property
    def difference(self) -> float:
        """Model minus published, as a fraction of the published number."""
        return (self.model - self.published) / self.published

    @property
    def agrees(self) -> bool:
        """Whether the model reproduces the number within ``AGREES``, or is within the bound."""
        if self.qualifier == "lower_bound":
            return self.difference >= -AGREES
        if self.qualifier == "upper_bound":
            return self.difference <= AGREES
        return abs(self.difference) <= AGREES


def compare_with_thesis(actuator: Actuator) -> tuple[Comparison, ...]:
    """Simulate the thesis's runs of sample 2 in room conditions and read its quantities from them.

    Parameters
    ----------
    actuator : Actuator
        A model of sample 2.

    Returns
    -------
    comparisons : tuple of Comparison
        In the order of the thesis's figures, the force runs first.
    """
    runs = {name: simulate(actuator, signal, duration=DURATION, rate=RATE) for name, signal in SIGNALS.items()}
    compared = []
    for row in sorted(published_measurements(2), key=lambda row: row.measured != "force"):
        run = runs[row.waveform]
        channel = row.metric.rpartition("_")[2]
        reading = READINGS[row.waveform, row.metric]
        comparison = Comparison(
            figure=row.figure,
            measured=row.measured,
            waveform=row.waveform,
            metric=row.metric,
            definition=reading.definition,
            published=row.value(CHANNELS[channel]),
            model=reading.of(run.time, run.channels[channel]),
            quantity=CHANNELS[channel],
            qualifier=row.qualifier,
        )
        compared.append(comparison)
        if (row.waveform, row.metric) == ("step", "max_force"):
            # The measured force falls after a few seconds: at the end it is below its largest value.
            compared.append(
                replace(
                    comparison,
                    metric="final_force",
                    definition=_AT_END.definition,
                    model=_AT_END.of(run.time, run.channels[channel]),
                    qualifier="upper_bound",
                )
            )
    return tuple(compared)
