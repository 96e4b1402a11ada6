"""A fact: one measured number of one strip under one signal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal, Protocol

from ipmclab.errors import InputError, unknown_name
from ipmclab.units import CHANNELS

Waveform = Literal["step", "sine", "square", "push", "flick"]
FROM_REST: Final = frozenset({"peak_at_first_edge", "largest", "half_period_end"})
"""Metrics that an unknown zero of the sensor moves; the amplitude of a wave it does not."""


_NEEDS: Final[Mapping[str, tuple[str, ...]]] = {
    "step": ("amplitude",),
    "sine": ("amplitude", "frequency"),
    "square": ("amplitude", "frequency"),
    "push": (),
    "flick": (),
}
"""What a fact of each waveform has to state."""


SAME: Final = 0.02  # relative: numbers that are meant to be one, and what of a sine is no harmonic (convention)
_WARMER: Final = 1.0  # K (convention)
_WETTER: Final = 1.0
"""Differences of temperature [K] and relative humidity [percent] that a strip does not show (convention)."""


class InAir(Protocol):
    """What may state its temperature [degC] and relative humidity [percent]."""

    @property
    def temperature(self) -> float | None: ...
    @property
    def relative_humidity(self) -> float | None: ...


def in_one_air(one: InAir, other: InAir, *, warmer: float = _WARMER, wetter: float = _WETTER) -> bool:
    """Whether two runs state no different environments: elsewhere a strip answers otherwise."""
    pairs = (
        (one.temperature, other.temperature, warmer),
        (one.relative_humidity, other.relative_humidity, wetter),
    )
    return all(first is None or second is None or abs(first - second) <= most for first, second, most in pairs)


@dataclass(frozen=True)
class Fact:
    """One number of one strip under one signal.

    Parameters
    ----------
    sample : str or None
        Id of the strip; None where the run does not say.
    waveform : "step", "sine", "square", "push" or "flick"
        What was done; ``push`` is a force-displacement test, ``flick`` a free ring at 0 V.
    metric : str
        ``peak_current``, ``steady_current`` or ``half_period_end_current`` [A], ``max_displacement`` [m] or
        ``max_force`` [N] (of a sine or a square the amplitude), ``stiffness`` [N/m] of a push,
        ``resonance`` [Hz] of a flick.
    value : float [SI]
        Its size, above 0.
    uncertainty : float [SI]
        One standard uncertainty.
    amplitude : float [V], optional
    frequency : float [Hz], optional
        None for a step.
    where : str
        Where it comes from: a figure, a run.
    measured_with : str
        Which channel was measured in addition to the current, ``displacement`` or ``force``.
    conditions : str
        Facts of other conditions are not compared.
    time : float [s], optional
        When the number was read; for a sine or a square how long it lasted.
    at_least : bool
        Whether the instrument clipped, so that the truth may be larger.
    place : int, optional
        Of the run in the call; None for a number that does not come from a run.
    doubts : str
        What is wrong with how it was measured.
    zero_taken : bool
        Whether it was counted from a reading of zero, as the record does not say what the sensor reads at rest.
    temperature, relative_humidity : float [degC], [percent], optional
        Of the run. Facts that state different ones are not compared.

    Raises
    ------
    InputError
        An unknown waveform, a voltage that is not stated, a value that is not above 0.
    """

    sample: str | None
    waveform: Waveform
    metric: str
    value: float
    uncertainty: float
    amplitude: float | None = None
    frequency: float | None = None
    where: str = ""
    measured_with: str = ""
    conditions: str = ""
    time: float | None = None
    at_least: bool = False
    place: int | None = None
    doubts: str = ""
    zero_taken: bool = False
    temperature: float | None = None
    relative_humidity: float | None = None

    def __post_init__(self) -> None:
        """Refuse what nothing can be compared with."""
        said = self.where or f"{self.metric} of the {self.waveform}"
        if self.waveform not in _NEEDS:
            raise unknown_name("waveform", self.waveform, _NEEDS, where=said)
        for name in _NEEDS[self.waveform]:
            if getattr(self, name) is None:
                raise InputError(
                    f"the {name} of the {self.waveform} is missing",
                    code="missing-value",
                    where=said,
                    repair=f"give {name}, in {'V' if name == 'amplitude' else 'Hz'}",
                )
        if not (0.0 < self.value < math.inf and self.uncertainty >= 0.0):
            raise InputError(
                f"the {self.metric} is {self.value:g} with a standard uncertainty of {self.uncertainty:g}",
                code="out-of-range",
                where=said,
                repair="give the size of what was measured, above 0, and an uncertainty of 0 or more, in SI units",
            )

    @property
    def signal(self) -> str:
        """The voltage as a text that ``simulate`` takes, such as ``"sine 1 V 0.1 Hz"``."""
        frequency = "" if self.frequency is None else f" {self.frequency:.6g} Hz"
        return f"{self.waveform} {self.amplitude:.6g} V{frequency}"

    @property
    def swing(self) -> float:
        """Largest voltage [V] that can stand across the series resistance: a square reverses a charged strip."""
        return abs(self.amplitude or 0.0) * (1.0 if self.waveform == "step" else 2.0)

    def in_conditions_of(self, other: Fact) -> bool:
        """Whether nothing says that they were measured in different conditions."""
        return self.conditions == other.conditions and in_one_air(self, other)

    def like(self, other: Fact) -> bool:
        """Whether the same voltage was applied in the same conditions."""
        return (
            self.waveform == other.waveform
            and self.in_conditions_of(other)
            and _near(self.amplitude, other.amplitude)
            and _near(self.frequency, other.frequency)
        )


def zero_that_agrees(fact: Fact, agreeing: float) -> str:
    """A clause with the zero of its sensor that would bring a fact to a value [SI]; empty where the zero is known.

    Examples
    --------
    >>> step = Fact("mine", "step", "max_displacement", 3e-3, 1e-4, 1.0, where="run 0", zero_taken=True)
    >>> zero_that_agrees(step, 1e-3)
    '; run 0 rests too short before the voltage to show the zero of its displacement: one of 2 mm explains it as well'
    """
    if not fact.zero_taken:
        return ""
    name = "current" if fact.metric.endswith("_current") else fact.metric.removeprefix("max_")
    channel = CHANNELS[name]
    zero = channel.to_display(abs(fact.value - agreeing))
    return (
        f"; {fact.where} rests too short before the voltage to show the zero of its {channel.name}: one of {zero:.2g} "
        f"{channel.display_unit} explains it as well"
    )


def with_zero_first(experiment: str, zero_clause: str) -> str:
    """What decides, after a record that shows the zero where one was taken for granted."""
    first = "record it again with 5 s at 0 V before the first edge, which shows the zero; if it stays, "
    return first + experiment if zero_clause else experiment


def _near(one: float | None, other: float | None) -> bool:
    if one is None or other is None:
        return one is other
    return abs(one - other) <= SAME * max(abs(one), abs(other))
