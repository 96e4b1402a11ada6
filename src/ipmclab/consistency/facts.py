"""Measured facts: single numbers of runs, from runs or from what was published of them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal, Protocol

import numpy as np

from ipmclab.data import measured_contacts, published_measurements
from ipmclab.errors import InputError, suggest
from ipmclab.measurement.uncertain import REPEATS
from ipmclab.quality import measure, shows_zero
from ipmclab.quality.check import check_record
from ipmclab.quality.kept import kept
from ipmclab.quality.period import periodic_part
from ipmclab.quality.record import NO_VOLTAGE, Record
from ipmclab.quality.scale import CODE as UNIT_OFF
from ipmclab.run import Run
from ipmclab.units import CHANNELS

Waveform = Literal["step", "sine", "square", "push", "flick"]

READ_OFF: Final = 0.02
"""Relative standard uncertainty of a number in a text, beside its last digit: read from a record with noise."""

READ_BY: Final = 5.0
"""Largest displacements and forces of sample 2 were read by then [s]; later they relax (Friend, chapter 5)."""

READ_UNTIL: Final = 40.0
"""Those of the other samples may have been read as late as that [s]: nothing says when."""

_RIPPLE: Final = 0.1
"""A first maximum of displacement or force before that [s] is a ripple of the edge, not how far the strip went."""

_FROM_REST: Final = frozenset({"peak_at_first_edge", "largest", "half_period_end"})
"""Metrics that an unknown zero of the sensor moves; the amplitude of a wave it does not."""

_NEEDS: Final[Mapping[str, tuple[str, ...]]] = {
    "step": ("amplitude",),
    "sine": ("amplitude", "frequency"),
    "square": ("amplitude", "frequency"),
    "push": (),
    "flick": (),
}
"""What a fact of each waveform has to state."""

_SAME: Final = 0.02  # relative: numbers that are meant to be one, and what of a sine is no harmonic (convention)
_STEADY: Final = 0.1  # of the height: a mean that a wave about 0 V has by its rounding (convention)

_WARMER: Final = 1.0
_WETTER: Final = 1.0
"""Differences of temperature [K] and relative humidity [percent] that a strip does not show."""


class InAir(Protocol):
    """What may state its temperature [degC] and relative humidity [percent]."""

    @property
    def temperature(self) -> float | None: ...
    @property
    def relative_humidity(self) -> float | None: ...


def in_one_air(one: InAir, other: InAir) -> bool:
    """Whether two runs state no different environments: elsewhere a strip answers otherwise."""
    pairs = (
        (one.temperature, other.temperature, _WARMER),
        (one.relative_humidity, other.relative_humidity, _WETTER),
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
    beside : str
        Which channel was measured beside the current, ``displacement`` or ``force``.
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
    beside: str = ""
    conditions: str = ""
    time: float | None = None
    at_least: bool = False
    place: int | None = None
    doubts: str = ""
    zero_taken: bool = False
    temperature: float | None = None
    relative_humidity: float | None = None

    def __post_init__(self) -> None:
        """Refuse what nothing can be held against."""
        said = self.where or f"{self.metric} of the {self.waveform}"
        if self.waveform not in _NEEDS:
            raise InputError(
                f"unknown waveform {self.waveform!r}",
                code="unknown-waveform",
                where=said,
                repair=suggest(self.waveform, _NEEDS),
            )
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

    def beside_conditions_of(self, other: Fact) -> bool:
        """Whether nothing says that they were measured in different conditions."""
        return self.conditions == other.conditions and in_one_air(self, other)

    def like(self, other: Fact) -> bool:
        """Whether the same voltage was applied in the same conditions."""
        return (
            self.waveform == other.waveform
            and self.beside_conditions_of(other)
            and _near(self.amplitude, other.amplitude)
            and _near(self.frequency, other.frequency)
        )


def zero_told(fact: Fact, agreeing: float) -> str:
    """A clause with the zero of its sensor that would bring a fact to a value [SI]; empty where the zero is known.

    Examples
    --------
    >>> step = Fact("mine", "step", "max_displacement", 3e-3, 1e-4, 1.0, where="run 0", zero_taken=True)
    >>> zero_told(step, 1e-3)
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


def with_zero_first(experiment: str, told: str) -> str:
    """What decides, after a record that shows the zero where one was taken for granted."""
    first = "record it again with 5 s at 0 V before the first edge, which shows the zero; if it stays, "
    return first + experiment if told else experiment


def _near(one: float | None, other: float | None) -> bool:
    if one is None or other is None:
        return one is other
    return abs(one - other) <= _SAME * max(abs(one), abs(other))


def published_facts(sample: int, *, conditions: str | None = None) -> tuple[Fact, ...]:
    """What Friend's thesis states of one of its samples.

    Parameters
    ----------
    sample : int
        The thesis's number, 1 to 7.
    conditions : str, optional
        ``"room"``, or for example ``"20 degC, 80 %RH"``; those of most of its runs where it is left out.

    Examples
    --------
    >>> [fact.value for fact in published_facts(2) if fact.metric == "peak_current" and fact.waveform == "step"]
    [0.2048, 0.06701]
    """
    facts = []
    rows = published_measurements(sample, conditions=conditions or "room")
    if conditions is None and not rows:
        rows = published_measurements(sample, conditions="20 degC, 80 %RH")
    for row in rows:
        value = row.value(CHANNELS[row.metric.rpartition("_")[2]])
        facts.append(
            Fact(
                sample=f"friend-{sample}",
                waveform=_waveform(row.waveform),
                metric=row.metric,
                value=value,
                uncertainty=math.hypot(READ_OFF * value, _rounding(row.number) * value),
                amplitude=row.amplitude,
                frequency=row.frequency,
                where=f"figure {row.figure}",
                beside=row.measured,
                conditions=row.conditions,
                time=READ_BY if sample == 2 and row.waveform == "step" else None,
                at_least=row.qualifier == "lower_bound",
            )
        )
    return tuple(facts)


def published_of(actuator: str) -> tuple[Fact, ...]:
    """What Friend's thesis states of a strip of the library, or of a variant of one.

    Of a strip that was identified from printed numbers those of its own figures count: another state of the same
    sample is another strip.

    Parameters
    ----------
    actuator : str
        Name in the library.

    Examples
    --------
    >>> len(published_of("friend-3-measured+relaxation.displacement")), published_of("mine")
    (14, ())
    """
    name = actuator.partition("+")[0].strip()
    sample = re.fullmatch(r"friend-([1-7])(-measured.*|-appendix)?", name)
    if sample is None:
        return ()
    facts = published_facts(int(sample.group(1)))
    figures = {f"figure {figure}" for figure in measured_contacts(name)}
    return tuple(fact for fact in facts if fact.where in figures) if figures else facts


def _rounding(number: str) -> float:
    """Relative standard uncertainty of a printed number by its last digit.

    Examples
    --------
    >>> round(_rounding("7 mA"), 3), round(_rounding("67.01 mA"), 6)
    (0.041, 4.3e-05)
    """
    digits = number.split()[0]
    return 0.5 * 10.0 ** -len(digits.partition(".")[2]) / math.sqrt(3.0) / abs(float(digits))


def _waveform(text: str) -> Waveform:
    known: dict[str, Waveform] = {"step": "step", "sine": "sine", "square": "square"}
    return known[text]


def facts_of_runs(runs: Sequence[Run]) -> tuple[Fact, ...]:
    """The numbers of runs under a step from rest, a sine or a square; other runs have none.

    Parameters
    ----------
    runs : sequence of Run

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate
    >>> run = simulate(load_actuator("friend-2"), "step 1 V", duration=20.0, rate=50.0)
    >>> [(fact.metric, fact.signal) for fact in facts_of_runs([run])][:2]
    [('peak_current', 'step 1 V'), ('max_displacement', 'step 1 V')]
    """
    each = (kept(run, f"facts {place}", partial(_all_facts_of, run, place)) for place, run in enumerate(runs))
    return tuple(fact for of_run in each for fact in of_run)


def label_of(run: Run, place: int) -> str:
    """A run as messages name it."""
    return f"run {place} ({run.name})" if run.name else f"run {place}"


def _all_facts_of(run: Run, place: int) -> tuple[Fact, ...]:
    return tuple(_facts_of(run, place))


def _facts_of(run: Run, place: int) -> Iterable[Fact]:
    record = Record.of(run)
    applied = _applied(record)
    if applied is None:
        return
    waveform, amplitude, frequency, lasted = applied
    findings = check_record(record)
    clipped = {finding.channel for finding in findings if finding.effect == "lower_bound"}
    noise = {finding.channel for finding in findings if finding.code == "noise-only"}
    off = {finding.channel for finding in findings if finding.code == UNIT_OFF}
    if None in off:
        return  # with a clock that is off nothing of the run is a fact
    noise |= off
    names = {
        ("step", "peak_at_first_edge", "current"): "peak_current",
        ("step", "peak_at_first_edge", "displacement"): "max_displacement",
        ("step", "peak_at_first_edge", "force"): "max_force",
        ("sine", "amplitude", "current"): "peak_current",
        ("sine", "amplitude", "displacement"): "max_displacement",
        ("sine", "amplitude", "force"): "max_force",
        ("square", "largest", "current"): "peak_current",
        ("square", "half_period_end", "current"): "half_period_end_current",
        ("square", "amplitude", "displacement"): "max_displacement",
        ("square", "amplitude", "force"): "max_force",
    }
    metrics = measure(run)
    times = {metric.channel: metric.value for metric in metrics if metric.name == "time_to_peak"}
    mechanical = [name for name in ("displacement", "force") if name in record.channels.keys() - noise]
    sample = run.metadata.sample
    for metric in metrics:
        name = names.get((waveform, metric.name, metric.channel))
        if name is None or metric.channel in noise or metric.value == 0.0:
            continue
        if waveform == "step" and name.startswith("max_") and times.get(metric.channel, _RIPPLE) < _RIPPLE:
            continue
        low, high = metric.interval or (metric.value, metric.value)
        yield Fact(
            sample=sample.id if sample else None,
            waveform=waveform,
            metric=name,
            value=abs(metric.value),
            uncertainty=math.hypot((high - low) / 3.92, REPEATS * metric.value),
            amplitude=amplitude,
            frequency=frequency,
            where=label_of(run, place),
            beside=mechanical[0] if len(mechanical) == 1 else "",
            time=times.get(metric.channel) if waveform == "step" else lasted,
            at_least=metric.channel in clipped,
            place=place,
            zero_taken=metric.name in _FROM_REST and not shows_zero(run, metric.channel),
            temperature=run.metadata.temperature,
            relative_humidity=run.metadata.relative_humidity,
        )


def _applied(record: Record) -> tuple[Waveform, float, float | None, float | None] | None:
    """What voltage a run has: waveform, amplitude [V], frequency [Hz], and how long [s] a wave lasts."""
    if not record.excited:
        return None
    driven = np.flatnonzero(np.abs(record.run.voltage) > NO_VOLTAGE)
    period, end = periodic_part(record.run) or (None, int(driven[-1]) + 1)
    # A rest behind the signal is none of it.
    voltage, edges = record.run.voltage[:end], record.edges[record.edges < end]
    if len(edges) and not record.steps_from_rest:
        return None
    if period is None:
        one_step = len(edges) == 1 and bool(record.constant_after[0])
        return ("step", abs(float(np.median(voltage[edges[0] :]))), None, None) if one_step else None
    rows, lasted = round(period / record.period), end * record.period
    if rows < 8 or end < rows:
        return None
    last = voltage[-rows:]
    mean, height = float(np.mean(last)), float(np.ptp(last))
    if abs(mean) > _STEADY * height:
        return None
    waves = np.abs(np.fft.rfft(last - mean)) * 2.0 / rows
    amplitude, rest = float(waves[1]), float(np.sqrt(np.sum(waves[2:] ** 2)))
    if rest < _SAME * amplitude:
        return "sine", amplitude, 1.0 / period, lasted
    if len(edges) > 1 and bool(record.constant_after[: len(edges)].all()):
        return "square", 0.5 * height, 1.0 / period, lasted
    return None
