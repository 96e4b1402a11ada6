"""Validity: where a model is asked beyond what it holds for. Said in the run and where it is shown, never refused."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.kinds import tell_kinds
from ipmclab.model.assemble import assemble
from ipmclab.model.ports import left_at_rest
from ipmclab.model.stages.beam import Resonance, resonance
from ipmclab.model.stages.leak import ELECTROLYSIS, Leak
from ipmclab.run import Finding, Run
from ipmclab.units import LENGTH

if TYPE_CHECKING:
    from ipmclab.model.actuator import Actuator
    from ipmclab.sample import Sample
    from ipmclab.signals import Signal

FloatArray = npt.NDArray[np.float64]

LEAKS_KNOWN_TO: Final = 3.5
"""Voltage [V] up to which leaks of strips were measured: the thesis and the open records end at 3 V."""

SMALL_BENDING: Final = 0.2
"""Displacement, as a part of the free length, up to which bending counts as small."""

RESONANCE: Final = 1.0 / 3.0
"""Part of the first resonance up to which one mode of the beam is enough."""

RING: Final = 0.01
"""A ring after an edge counts from this part of the largest displacement on."""

CODES: Final = (
    "above-electrolysis",
    "leak-extrapolated",
    "large-bending",
    "laser-lost",
    "near-resonance",
    "resonance-aliased",
)
"""What ``validity`` finds."""


@tell_kinds
def validity(actuator: Actuator, run: Run, signal: Signal | str | None = None) -> tuple[Finding, ...]:
    """Where a predicted run leaves what its actuator holds for.

    Parameters
    ----------
    actuator : Actuator
    run : Run
        Predicted by it.
    signal : Signal or str, optional
        What was applied; that of the run's metadata where it is left out, and the voltage itself where that shows none.

    Returns
    -------
    findings : tuple of Finding
        Empty where the model holds.

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> run = simulate(strip, "step 2 V", duration=4.0, rate=50.0)
    >>> [finding.code for finding in validity(strip, run)]
    ['above-electrolysis']
    >>> leaking = load_actuator("friend-2+leak.exponential")
    >>> validity(leaking, simulate(leaking, "step 2 V", duration=4.0, rate=50.0))
    ()
    """
    return beyond_model(actuator, run, signal)


def beyond_model(actuator: Actuator, run: Run, signal: Signal | str | None = None) -> tuple[Finding, ...]:
    """The same for what a simulation has just made, of which no kind needs to be asked."""
    volts = _largest(run.voltage)
    bending = 0.0 if run.displacement is None else _largest(run.displacement)
    return (
        *_voltage(actuator, run.metadata.sample or actuator.sample, volts),
        *_bending(actuator, run, bending),
        *_speed(actuator, run, volts, signal),
        *_ring(actuator, run, volts, bending),
    )


def sentence(finding: Finding) -> str:
    """A finding in one line: what was found, and what to do."""
    return f"{finding.message}; {finding.repair}" if finding.repair else finding.message


def _largest(values: FloatArray) -> float:
    """The largest magnitude of the readings that there are."""
    # With no copy of a long record; where NumPy has them is found in a third of the time of how large they are.
    largest = max(values.item(values.argmax()), -values.item(values.argmin()))
    if math.isnan(largest):
        there = values[~np.isnan(values)]
        return float(np.abs(there).max(initial=0.0))
    return largest


@dataclass(frozen=True)
class _Limits:
    """What the parameters of an actuator say, whatever is asked of it."""

    leaks_above: float
    resonance: Resonance
    most_at_resonance: float


def _limits(actuator: Actuator) -> _Limits:
    """Kept with the actuator: they are asked for at every simulation."""
    kept: dict[str, _Limits] = actuator.__dict__.setdefault("_validity_limits", {})
    if "value" not in kept:
        first = resonance(actuator.parameter_values)
        kept["value"] = _Limits(_leaks_above(actuator), first, _most_at_resonance(actuator, first.frequency))
    return kept["value"]


def _voltage(actuator: Actuator, sample: Sample | None, largest: float) -> list[Finding]:
    if largest <= ELECTROLYSIS:
        return []
    if largest > _limits(actuator).leaks_above:
        return _extrapolated(largest) if largest > LEAKS_KNOWN_TO else []
    if sample is not None and sample.has_no_water:
        return []
    none = "leak of the model gives no current there" if actuator.structure.leak else "model has no leak"
    return [
        Finding(
            "above-electrolysis",
            "warning",
            f"the voltage reaches {largest:.4g} V, water decomposes above {ELECTROLYSIS:g} V: the {none}, "
            "so a strip with water in it draws more current and moves otherwise",
            "stay below, give the actuator a leak at this voltage, or state a solvent without water in its [sample]",
            channel="voltage",
            values={"largest_voltage": largest, "limit": ELECTROLYSIS}
            | ({"leaks": 1.0} if actuator.structure.leak else {}),
        )
    ]


def _extrapolated(largest: float) -> list[Finding]:
    return [
        Finding(
            "leak-extrapolated",
            "warning",
            f"the voltage reaches {largest:.4g} V, leaks of strips were measured up to 3 V: the current of the leak "
            "there is that of a formula, and a strip heats, dries and may burn",
            "stay below, or measure the leak at this voltage and judge the prediction by that",
            channel="voltage",
            values={"largest_voltage": largest, "limit": LEAKS_KNOWN_TO},
        )
    ]


def _leaks_above(actuator: Actuator) -> float:
    """The voltage [V] beyond which any current leaks: a leak that is switched off is none."""
    form = actuator.structure.leak
    return Leak(form).onset(actuator.parameter_values) if form else math.inf


def _bending(actuator: Actuator, run: Run, bending: float) -> list[Finding]:
    if run.displacement is None:
        return []
    if actuator.structure.laser:
        return _lost(actuator, run.displacement, run)
    length = actuator["geometry.free_length"]
    if bending <= SMALL_BENDING * length:
        return []
    return [
        Finding(
            "large-bending",
            "warning",
            f"the predicted displacement reaches {_mm(bending)}, more than {SMALL_BENDING:g} of the free length of "
            f"{_mm(length)}: the beam is one of small bending",
            "lower the voltage, check the coupling, or add a laser to the actuator, which reads large bending as it is",
            channel="displacement",
            values={"largest_displacement": bending, "limit": SMALL_BENDING * length},
        )
    ]


def _lost(actuator: Actuator, displacement: FloatArray, run: Run) -> list[Finding]:
    from ipmclab.model.stages.laser import Laser

    laser = Laser()
    rows = np.isnan(displacement) | laser.lost(np.nan_to_num(displacement), actuator.parameter_values)
    if not rows.any():
        return []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]])))
    samples = tuple((int(start), int(stop)) for start, stop in edges.reshape(-1, 2))
    last = laser.last_reading(actuator.parameter_values)
    first = float(run.time[samples[0][0]])
    by_range = math.isclose(last, actuator["laser.range"])
    why = "it reads no further" if by_range else "the end of the strip has then come nearer to the clamp than the laser"
    return [
        Finding(
            "laser-lost",
            "warning",
            f"the strip leaves the laser in {int(rows.sum())} of {len(rows)} rows, first at {first:.4g} s, beyond a "
            f"height of {_mm(last)}: {why}",
            "these rows have no reading; lower the voltage, or put the laser nearer to the clamp",
            channel="displacement",
            samples=samples,
            effect="mask",
            values={"count": int(rows.sum()), "first_time": first, "last_reading": last},
        )
    ]


def _speed(actuator: Actuator, run: Run, volts: float, signal: Signal | str | None) -> list[Finding]:
    first = _limits(actuator).resonance.frequency
    stated = highest_frequency(signal if signal is not None else run.metadata.signal)
    fastest = _mean_frequency(run, volts) if stated is None else stated
    if fastest <= RESONANCE * first:
        return []
    goes = "varies at" if stated is None else "goes up to"
    return [
        Finding(
            "near-resonance",
            "warning",
            f"the signal {goes} {fastest:.4g} Hz, more than a third of the first resonance at {first:.4g} Hz: the "
            "model has this one mode only, and the damping of its ring is a guess unless it was identified",
            "stay below, or trust the current alone",
            channel="voltage",
            values={"frequency": fastest, "resonance": first},
        )
    ]


def _ring(actuator: Actuator, run: Run, volts: float, largest: float) -> list[Finding]:
    """A ring after an edge that the rows are too few to show."""
    limits = _limits(actuator)
    first = limits.resonance
    if run.displacement is None or run.hold == "first" or first.damping_ratio >= 1:
        return []
    if 2.0 * volts * limits.most_at_resonance <= RING * largest or run.rate >= 2.0 * first.frequency:
        return []  # no jump is larger than twice the voltage, or the rows show the ring
    jump = max(_largest(np.diff(run.voltage)), abs(float(run.voltage[0])))
    if jump * limits.most_at_resonance <= RING * largest:
        return []
    # After an edge the beam rings by what its drive holds at the resonance.
    amplitude = jump * _gain_at_resonance(actuator, first.frequency)
    if amplitude <= RING * largest or largest == 0.0:
        return []
    image = abs(first.frequency - run.rate * round(first.frequency / run.rate))
    return [
        Finding(
            "resonance-aliased",
            "warning",
            f"after an edge the strip rings by {_mm(amplitude)} at {first.frequency:.4g} Hz; at {run.rate:.4g} rows a "
            f"second that looks like {image:.4g} Hz",
            f"ask for {math.ceil(4.0 * first.frequency):d} rows a second or more",
            channel="displacement",
            values={"resonance": first.frequency, "apparent_frequency": image, "amplitude": amplitude},
        )
    ]


def _most_at_resonance(actuator: Actuator, frequency: float) -> float:
    """What the gain below cannot exceed, at hardly any cost: all of the voltage reaches the node."""
    structure, values = actuator.structure, actuator.parameter_values
    if structure.displacement_modes or structure.displacement_pairs or structure.further:
        return math.inf
    s = 2j * math.pi * frequency
    coupling = values["coupling.gain"] * (s + values["coupling.zero"])
    coupling /= s * s + values["coupling.p1"] * s + values["coupling.p2"]
    return _displacement_per_drive(actuator) * abs(coupling)


def _displacement_per_drive(actuator: Actuator) -> float:
    return 3.0 * actuator["geometry.sensing_length"] ** 2 / actuator["geometry.thickness"] ** 2


def _gain_at_resonance(actuator: Actuator, frequency: float) -> float:
    """The displacement of small bending [m] that a volt at the resonance would drive without the beam."""

    def made() -> float:
        system = assemble(
            actuator.blocks(),
            inputs=["voltage"],
            outputs=["displacement_drive"],
            laws=actuator.structure.laws(actuator.parameter_values),
            at_rest=left_at_rest(["voltage"]),
        )
        s = 2j * math.pi * frequency
        moving = np.linalg.solve(s * np.eye(len(system.states)) - system.a, system.b[:, 0].astype(complex))
        return _displacement_per_drive(actuator) * abs(complex(system.c[0] @ moving + system.d[0, 0]))

    return actuator.keep(("gain at resonance", frequency), made)


def highest_frequency(signal: Signal | str | None) -> float | None:
    """Of the waveforms of a signal [Hz]: 0 where none has a frequency; None where there is no signal.

    Examples
    --------
    >>> highest_frequency("step 1 V for 1 s then sine 1 V 14 Hz"), highest_frequency("noted by hand")
    (14.0, None)
    """
    given: Any = _parsed(signal) if signal is None or isinstance(signal, str) else signal
    parts = getattr(given, "signals", (given,))
    # Voltages from a file or an array have no waveform: they speak for themselves.
    if given is None or any(hasattr(part, "times") for part in parts):
        return None
    return float(given.fastest)


def _parsed(text: str | None) -> Signal | None:
    from ipmclab.errors import InputError
    from ipmclab.signals.text import parse

    if not text or "file " in text:  # which would be read
        return None
    try:
        return parse(text)
    except InputError:  # what was noted with a measured run need not be a signal
        return None


def _mean_frequency(run: Run, largest: float) -> float:
    """The frequency [Hz] of the sine that changes from row to row as much as this voltage does, in the mean square."""
    if len(run) < 2 or largest == 0.0:
        return 0.0
    volts = run.voltage / largest
    steps = volts[1:] - volts[:-1]
    chord = math.sqrt(float(steps @ steps) / len(steps) / (float(volts @ volts) / len(volts)))
    return run.rate / math.pi * math.asin(min(1.0, 0.5 * chord))


def _mm(length: float) -> str:
    return f"{LENGTH.to_display(length):.4g} mm"
