"""Measured facts: single numbers of runs, from runs or from what was published of them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Final

import numpy as np

from ipmclab.consistency.fact import FROM_REST, SAME, Fact, Waveform
from ipmclab.data import measured_contacts, published_measurements
from ipmclab.measurement.uncertain import REPEATS
from ipmclab.quality import measure, shows_zero
from ipmclab.quality.check import check_record
from ipmclab.quality.kept import kept
from ipmclab.quality.period import periodic_part
from ipmclab.quality.record import NO_VOLTAGE, Record
from ipmclab.quality.scale import CODE as UNIT_OFF
from ipmclab.run import Run
from ipmclab.units import CHANNELS

READ_OFF: Final = 0.02
"""Relative standard uncertainty of a number in a text, in addition to its last digit: read from a record with noise
(convention)."""

READ_BY: Final = 5.0
"""Largest displacements and forces of sample 2 were read by then [s]; later they relax (Friend, chapter 5)."""

READ_UNTIL: Final = 40.0
"""Those of the other samples may have been read as late as that [s]: nothing says when (the length of the records of
the thesis)."""

_RIPPLE: Final = 0.1
"""A first maximum of displacement or force before that [s] is a ripple of the edge, not how far the strip went
(convention)."""


_STEADY: Final = 0.1  # of the height: a mean that a wave about 0 V has by its rounding (convention)


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
                measured_with=row.measured,
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
    if off & {None, "voltage"}:
        return  # with a clock or a voltage that is off nothing of the run is a fact
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
            measured_with=mechanical[0] if len(mechanical) == 1 else "",
            time=times.get(metric.channel) if waveform == "step" else lasted,
            at_least=metric.channel in clipped,
            place=place,
            zero_taken=metric.name in FROM_REST and not shows_zero(run, metric.channel),
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
    if rest < SAME * amplitude:
        return "sine", amplitude, 1.0 / period, lasted
    if len(edges) > 1 and bool(record.constant_after[: len(edges)].all()):
        return "square", 0.5 * height, 1.0 / period, lasted
    return None
