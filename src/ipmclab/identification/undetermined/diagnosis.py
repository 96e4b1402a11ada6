"""What the readings leave open, named."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import takewhile
from typing import Final

import numpy as np

from ipmclab.fit.fit import DETERMINED, Direction
from ipmclab.identification.problem.record import PreparedRun, fastest_rate
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.identification.search.valleys import Rival
from ipmclab.identification.uncertainty.covariance import MOVED, Uncertainty
from ipmclab.identification.undetermined.closed_form import others, sparse
from ipmclab.identification.undetermined.cures import cures_of, fast_modes, measured, said_of
from ipmclab.identification.undetermined.exchange import HARDLY, series_against_branches
from ipmclab.model import Actuator
from ipmclab.model.declared import is_of_circuit, is_proportional
from ipmclab.model.kinds import kind_of
from ipmclab.model.stages.circuit import SERIES
from ipmclab.model.stages.coupling import STATIC
from ipmclab.run import FloatArray
from ipmclab.ties import largest_first, names_by_size, upright

_NAMED: Final = 0.1  # part of a direction, from which it is named after a parameter


def relative_errors(unknowns: Sequence[Unknown], values: FloatArray, found: Uncertainty) -> FloatArray:
    """Standard error of each asked unknown as a part of its value; infinite where a free direction moves it.

    A linear unknown (a delay, an offset, a contact resistance) can be zero: its error counts against its
    value or its scale, whichever is larger. A ratio of a slow mode is one of d(0): where that may be of any size (its
    slow pole at zero), a ratio of nothing with no error says nothing.
    """
    size = sizes(unknowns, values)
    is_any = _error_of_static([unknown.base for unknown in unknowns], found) > HARDLY
    ratios = np.array([is_proportional(unknown.base) for unknown in unknowns], dtype=bool)
    errors = np.sqrt(np.maximum(found.covariance.diagonal(), 0.0)) / size
    moved = np.any(np.abs(found.null / size) > MOVED, axis=0)
    return np.where(moved | (ratios & is_any), np.inf, errors)


def sizes(unknowns: Sequence[Unknown], values: FloatArray) -> FloatArray:
    """Against what the error of each entry counts."""
    return np.array([unknown.size(float(value)) for unknown, value in zip(unknowns, values, strict=True)])


def directions(
    unknowns: Sequence[Unknown],
    values: FloatArray,
    found: Uncertainty,
    sharper: Uncertainty,
    records: Sequence[PreparedRun],
    actuator: Actuator,
    rivals: Sequence[Rival] = (),
    exact: Sequence[str] = (),
) -> tuple[Direction, ...]:
    """Combinations that the readings do not determine: first those about which they say nothing at all.

    A combination is also named when its standard error makes one of its parameters undetermined. What would cure one
    about which nothing is said is asked of the model, ``actuator``: which further output would show it. ``sharper`` is
    what is found, with the errors of single parameters towards the side that determines them; it says which are open.
    What several give together (d(0)) follows from ``found``: errors taken from one side do not cancel in it.
    ``rivals`` are other fits as good, ``exact`` fixed parameters without a stated uncertainty.
    """
    names = [unknown.name for unknown in unknowns]
    size = sizes(unknowns, values)
    known = dict(zip(names, values, strict=True))
    fast = fast_modes(actuator, records)
    named = [_null_direction(unknowns, row, records, actuator) for row in sparse(found.null / size)]
    covariance = sharper.covariance / (size[:, None] * size)
    # Of each entry to the farthest other fit that is as good.
    own = np.array([unknown.entry(float(value)) for unknown, value in zip(unknowns, values, strict=True)])
    away = np.array([own, *(rival.vector_of(unknowns, own) for rival in rivals)]) - own
    to_rivals = np.abs(away).max(axis=0) / size
    nameless = np.any(np.abs(found.null / size) > MOVED, axis=0)
    exchanged = series_against_branches(
        names, covariance, np.where(nameless, 0.0, to_rivals), DETERMINED, _outputs(records)
    )
    if exchanged is not None:
        # What else is open is reported as if the series resistance were known.
        named.append(exchanged[0])
        covariance = exchanged[1]
    errors = np.sqrt(np.maximum(covariance.diagonal(), 0.0))
    variances, vectors = np.linalg.eigh(covariance)
    open_ones = errors > DETERMINED
    moved = np.abs(vectors) * np.sqrt(np.maximum(variances, 0.0))
    chosen = [place for place in largest_first(variances) if np.any(moved[:, place] > DETERMINED)]
    if open_ones.any() and not chosen:
        chosen = [int(np.argmax(variances))]
    for place in chosen:
        row, error = vectors[:, place], float(np.sqrt(variances[place]))
        named.append(_direction(names, row, error, records, fast))
        held = _uncertain_value(row, found, size)
        if held:
            cure = measured(held) or f"measure {held} better"
            what = named[-1].sentence.split("; ")[0]
            said = f"{what}: the stated uncertainty of {held} leaves it open; {cure}"
            named[-1] = replace(named[-1], sentence=said, cures=(f"measure {held}",))
    against = _gain_against_zero(names, known, found, errors, records, exact)
    if against is not None:
        named = [*(direction for direction in named if not _is_gain_against_zero(direction)), against]
    # What moves only a little along a direction that has a name may still move too much.
    left = [k for k in np.flatnonzero(open_ones) if not any(names_it(direction, names[k]) for direction in named)]
    while left:
        variances, vectors = np.linalg.eigh(covariance[np.ix_(left, left)])
        row = np.zeros(len(names))
        row[left] = vectors[:, -1]
        named.append(_direction(names, row, float(np.sqrt(variances[-1])), records, fast))
        left = [k for k in left if not names_it(named[-1], names[k])]
    return tuple(named)


def in_order(named: Sequence[Direction], names: Sequence[str]) -> list[Direction]:
    """The same, those first of which the readings say nothing by the first of their large parts among some names.

    None of them comes before another, and a branch gets its number only in the report.
    """
    open_ones = list(takewhile(lambda direction: math.isinf(direction.error), named))

    def first(direction: Direction) -> int:
        parts = np.array([abs(direction.coefficients.get(name, 0.0)) for name in names])
        return int(np.argmax(parts >= 0.5 * parts.max(initial=0.0)))

    return [*sorted(open_ones, key=first), *named[len(open_ones) :]]


def names_it(direction: Direction, name: str) -> bool:
    """Whether a direction is why a parameter is not determined."""
    part = abs(direction.coefficients.get(name, 0.0))
    return part > _NAMED or (part > MOVED and np.isinf(direction.error))


def direction_of_one(
    names: Sequence[str], name: str, why: str, records: Sequence[PreparedRun], fast: Collection[str]
) -> Direction:
    """A parameter that is not determined for a reason of its own."""
    way = measured(name)
    sentence = f"{name} is not determined: {why}; {way or _cure([name], [name], records, fast)}"
    cures = (f"measure {name.split('[')[0]}",) if way else ()
    return Direction(dict.fromkeys(names, 0.0) | {name: 1.0}, sentence, np.inf, cures)


def _is_gain_against_zero(direction: Direction) -> bool:
    gain, zero = (direction.coefficients.get(f"coupling.{name}", 0.0) for name in ("gain", "zero"))
    return gain * zero < 0 and gain * gain + zero * zero > 0.95


def _direction(
    names: Sequence[str], row: FloatArray, error: float, records: Sequence[PreparedRun], fast: Collection[str]
) -> Direction:
    row = upright(row / np.linalg.norm(row))
    coefficients = dict(zip(names, map(float, row), strict=True))
    return Direction(coefficients, _sentence(coefficients, error, records, fast), error)


def _uncertain_value(row: FloatArray, found: Uncertainty, size: FloatArray) -> str:
    """The fixed value whose stated uncertainty leaves a combination open that the readings determine; or none."""
    large = np.abs(row) > _NAMED * np.abs(row).max()
    of_readings = np.sqrt(found.of_readings) / size
    if not found.slopes or np.any(of_readings[large] > DETERMINED):
        return ""
    leverages = {name: float(np.abs(found.leverage[name][large]).max()) for name in found.slopes}
    return max(leverages, key=leverages.__getitem__) if max(leverages.values()) > 0.0 else ""


def _null_direction(
    unknowns: Sequence[Unknown], row: FloatArray, records: Sequence[PreparedRun], actuator: Actuator
) -> Direction:
    names = [unknown.name for unknown in unknowns]
    plain = _direction(names, row, np.inf, records, fast_modes(actuator, records))
    moved = [name for name in names if abs(plain.coefficients[name]) > MOVED]
    if any(name.startswith("observation.") for name in moved) or _at_bounds(unknowns, moved, actuator):
        return plain
    cures = cures_of(names, row, _shown_by(unknowns, row, records, actuator))
    if not cures:
        return plain
    what = plain.sentence.split("; ")[0]
    return replace(plain, sentence=f"{what}; {said_of(cures, moved)}", cures=tuple(cure.name for cure in cures))


def _at_bounds(unknowns: Sequence[Unknown], moved: Sequence[str], actuator: Actuator) -> bool:
    """Whether one of these went to the end of its range, where other measurements say nothing of it either."""
    return any(
        min(entry - unknown.limits[0], unknown.limits[1] - entry) < MOVED
        for unknown in unknowns
        if unknown.log and unknown.name in moved and unknown.base in actuator.parameter_values
        for entry in [unknown.entry(actuator[unknown.base])]
    )


def _shown_by(
    unknowns: Sequence[Unknown], row: FloatArray, records: Sequence[PreparedRun], actuator: Actuator
) -> tuple[str, ...]:
    """Outputs that no run has and that would show a combination, in one run or another."""
    largest = max(float(np.abs(record.run.voltage).max()) for record in records)
    found: list[str] = []
    for record in records:
        own = [(u.base, part) for u, part in zip(unknowns, row, strict=True) if u.place in (None, record.place)]
        own = [(base, part) for base, part in own if base in actuator.parameter_values]
        bases, parts = [base for base, _ in own], np.array([part for _, part in own])
        if not np.any(np.abs(parts) > MOVED):
            continue
        there = [*_outputs(records), *(name for one in records for name in one.run.channels)]
        found += [name for name in others(actuator, bases, there, parts, voltage=largest) if name not in found]
        if not any(unknown.place is not None for unknown in unknowns):
            break
    return tuple(found)


def _outputs(records: Sequence[PreparedRun]) -> list[str]:
    return list(dict.fromkeys(output for record in records for output in record.readings))


def _sentence(
    coefficients: Mapping[str, float], error: float, records: Sequence[PreparedRun], fast: Collection[str]
) -> str:
    moved = names_by_size({n: c for n, c in coefficients.items() if abs(c) > MOVED})
    large = [name for name in moved if abs(coefficients[name]) > _NAMED] or moved[:1]
    listed = ", ".join(large)
    rest = [name for name in moved if name not in large]
    also = f" (and, less, {', '.join(rest)})" if rest and np.isinf(error) else ""
    if len(large) == 1 and not also:
        what, it = f"{listed} is not determined", "it"
    else:
        what, it = f"{listed}{also} can move together without changing what was read", "the combination"
    if error < HARDLY:
        what += f": {it} is known to a factor of {np.exp(error):.3g} only"
    elif np.isfinite(error):
        what += f": {it} is hardly known at all"
    # An edge that follows what else is open is no reason for it.
    asked = [
        name
        for name in moved
        if name in large or (abs(coefficients[name]) > 0.01 and not name.startswith("observation."))
    ]
    return f"{what}; {_cure(large, asked, records, fast)}"


def _cure(large: Sequence[str], asked: Sequence[str], records: Sequence[PreparedRun], fast: Collection[str]) -> str:
    """What to record: as their stage says where what moves most is of one, else by all that are ``asked``."""
    own = {"" if (kind := kind_of(name)) is None else kind.to_determine for name in large}
    if len(own) == 1 and (cure := own.pop()):
        return cure
    moved = {name.split("[")[0] for name in asked}
    outputs = set(_outputs(records))
    circuit = {name for name in moved if is_of_circuit(name)}
    series = moved & set(SERIES)
    if "observation.delay" in moved:
        return (
            'state hold in the import map if you know it ("zero" where the voltage steps from row to row, "first" '
            "where it moves linearly: a wrong one gives wrong values), or give runs that show the rows before and "
            "after each edge"
        )
    if len(series) == 2:
        return "sheet and contact resistance lie in series: fix one of them at a measured value"
    if series and circuit - series:
        have = "current alone" if outputs == {"current"} else "these runs"
        return (
            f"{have} cannot separate the series resistance from the branches (two branches show five numbers, not "
            f"six): fix {min(series)} at a measured value, or add runs with force or displacement if the coupling "
            "is known from elsewhere"
        )
    if "beam.modulus" in moved and "coupling.gain" in moved:
        missing = "displacement" if "displacement" not in outputs else "force"
        return f"only the product of d and Young's modulus is determined: add runs with {missing}, or fix beam.modulus"
    if moved & {"beam.density", "beam.modulus", "beam.damping_ratio"}:
        return "record displacement fast enough to see the beam ring, or fix the beam at measured values"
    if {"coupling.gain", "coupling.zero"} <= moved and not circuit:
        return "record faster, so that the zero shows, or fix coupling.zero"
    if {name.split(".")[0] for name in moved} == {"geometry"}:
        return "fix the dimensions at measured values"
    if moved <= {*fast}:
        return "record more edges, at a higher rate, or with less noise"
    return "record longer, with steps and slow and fast signals, or with less noise"


def _gain_against_zero(
    names: Sequence[str],
    values: Mapping[str, float],
    found: Uncertainty,
    errors: FloatArray,
    records: Sequence[PreparedRun],
    exact: Sequence[str],
) -> Direction | None:
    """Gain against zero, where only their product is determined.

    That is so when the zero of d(s) lies beyond the Nyquist rate of every record that could show it: there a zero at Z
    acts as an edge that comes 1/Z earlier, less than a third of a sample. No record is timed that well, so a small
    formal error of Z would be false.
    """
    if "coupling.zero" not in names or "coupling.gain" not in names:
        return None
    nyquist = fastest_rate(records)
    zero = values["coupling.zero"]
    if zero > nyquist:
        why = f"the zero at {zero:.4g} 1/s lies beyond the Nyquist rate of these runs, {nyquist:.4g} 1/s"
        rate = 3.0 * min(zero, 10.0 * nyquist) / np.pi
    elif errors[names.index("coupling.zero")] > DETERMINED and _error_of_static(names, found) <= DETERMINED:
        why = f"the zero does not show in these runs, whose Nyquist rate is {nyquist:.4g} 1/s"
        rate = 3.0 * nyquist / np.pi
    else:
        return None
    half, power = float(np.sqrt(0.5)), 10.0 ** np.floor(np.log10(rate))
    sentence = (
        f"coupling.gain and coupling.zero can move against each other: {why}, so only d(0) = K_d Z_d/P_2d"
        f"{_static(names, values, found, exact)} is known; record at {np.ceil(rate / power) * power:g} S/s or more"
    )
    coefficients = dict.fromkeys(names, 0.0) | {"coupling.gain": half, "coupling.zero": -half}
    return Direction(coefficients, sentence, np.inf)


def _static(names: Sequence[str], values: Mapping[str, float], found: Uncertainty, exact: Sequence[str]) -> str:
    """d(0) in numbers, where all of it is free and nothing else can move it, and on what that error leans."""
    error = _error_of_static(names, found)
    if not set(STATIC) <= set(names) or math.isinf(error):
        return ""
    weights = np.array([STATIC.get(name, 0.0) for name in names])
    level = values["coupling.gain"] * values["coupling.zero"] / values["coupling.p2"]
    leans = [name for name in exact if abs(float(weights @ found.leverage[name])) > error]
    exact_words = f", with {' and '.join(leans)} taken as exact" if leans else ""
    return f" = {level:.4g} m/V (standard error {100.0 * error:.2g} %{exact_words})"


def _error_of_static(names: Sequence[str], found: Uncertainty) -> float:
    """Standard error of the logarithm of d(0), as far as what is free moves it; infinite where nothing limits that."""
    weights = np.array([STATIC.get(name, 0.0) for name in names])
    if np.any(np.abs(found.null @ weights) > MOVED):
        return math.inf
    return math.sqrt(max(float(weights @ found.covariance @ weights), 0.0))
