"""Where a fit starts: found from the data, never from the values of the free parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ipmclab.identification.problem.edge_delay import EdgeDelay, starts_of
from ipmclab.identification.problem.free import FreeParameters
from ipmclab.identification.problem.means import in_means
from ipmclab.identification.problem.record import PreparedRun, at_their_rows
from ipmclab.identification.problem.response import lumped
from ipmclab.identification.search.starts.start_circuit import circuit_values, find_circuit
from ipmclab.identification.search.starts.start_coupling import coupling_starts, relaxation_start
from ipmclab.identification.search.starts.start_further import further_starts, without_further
from ipmclab.identification.search.starts.start_leak import leak_starts
from ipmclab.model import Actuator, geometry
from ipmclab.model.declared import is_of_leak
from ipmclab.model.stages.circuit import CONTACT, DC, SERIES, SHEET

_SERIES_PARTS: Final = (0.9, 0.5, 0.97, 0.2)
"""Parts of the first resistance V/I(0+) that are tried as series resistance where it is free."""

_DIRECT_SHARES: Final = (0.5, 0.95, 0.1)
"""Shares of the clamped section that are tried as fed at once."""

_LEAK_STARTS: Final = 2
"""Leaks that are tried for each series resistance; one more where that is known."""


@dataclass(frozen=True)
class StartingPoint:
    """Values of the free actuator parameters and of the delays of foreign records.

    ``exact`` when the point is already the least-squares solution of the circuit.
    """

    values: Mapping[str, float]
    delays: Mapping[int, EdgeDelay]
    exact: bool = False


def starting_points(
    actuator: Actuator, names: FreeParameters, records: Sequence[PreparedRun], circuit: StartingPoint | None = None
) -> Iterator[StartingPoint]:
    """Starting points, the most likely first; around a circuit where that is found already."""
    free = set(names.actuator)
    delays = at_their_rows(records)
    # A usual size of each free parameter that has one; what the readings tell of it comes over it.
    declared = actuator.structure.declarations
    usual = {name: size for name in sorted(free) if (size := declared[name].usual) is not None}
    bases = [usual]
    exact = False
    if circuit is not None:
        bases = [{**usual, **circuit.values}]
        delays.update(circuit.delays)
    elif any(name.startswith("circuit.") for name in free):
        with_current = _with_current(records)
        series_known = None
        if free.isdisjoint(SERIES):
            series_known = lumped(actuator.circuit.branches, actuator.parameter_values).series
        fractions, located = find_circuit(with_current, actuator.circuit.branches, series_known)
        delays.update(located)
        bases = []
        for series_values in _series_values(actuator, free, usual, fractions.direct):
            values = {**actuator.parameter_values, **usual, **series_values}
            if actuator.structure.leak:
                bases += _with_leak(actuator, free, with_current, delays, {**usual, **series_values})
                continue
            series = lumped(actuator.circuit.branches, values, with_current[0].series_resistance).series
            electric, exact = circuit_values(fractions, values, series)
            bases.append({**usual, **series_values, **electric})
    elif any(is_of_leak(name) for name in free):
        bases = _with_leak(actuator, free, _with_current(records), delays, usual)
    share = "clamp.direct_share"
    if share in free and circuit is None:
        bases = [{**base, share: part} for base in bases for part in _DIRECT_SHARES]
    known = {record.place: record.known_delay for record in records if record.known_delay is not None}
    shifts = {**known, **starts_of(delays)}
    # Whether the poles and residues of all currents together are the whole problem.
    electrical = {DC, *(name for name in actuator.parameter_values if name.startswith("circuit.branches."))}
    exact = exact and free == electrical and len({record.series_resistance for record in records}) == 1
    for base in bases:
        strip = actuator.replace(**allowed(actuator, {**base, **without_further(actuator, free)}))
        for motion in _motion_starts(strip, free, records, shifts):
            moving = strip.replace(**allowed(strip, motion))
            for further in further_starts(moving, free, records, shifts):
                yield StartingPoint({**base, **motion, **further}, delays, exact)


def known_first(
    actuator: Actuator, names: FreeParameters, records: Sequence[PreparedRun], circuit: StartingPoint | None
) -> list[StartingPoint]:
    """Starting points; where something is known beforehand, first those that hold it while they look for the rest."""
    points = list(starting_points(actuator, names, records, circuit))
    if not names.priors:
        return points
    known = {name: prior.value for name, prior in names.priors.items()}
    rest = names.of(set(names.actuator) - known.keys())
    about = starting_points(actuator.replace(**allowed(actuator, known)), rest, records, circuit)
    return [*(replace(point, values={**point.values, **known}) for point in about), *points]


def _with_current(records: Sequence[PreparedRun]) -> list[PreparedRun]:
    """Those with a current that was measured: one that is at the end of its range throughout shows no circuit."""
    return [one for one in records if "current" in one.readings and one.readings["current"].exact.any()]


def _with_leak(
    actuator: Actuator,
    free: set[str],
    records: Sequence[PreparedRun],
    delays: Mapping[int, EdgeDelay],
    base: Mapping[str, float],
) -> list[dict[str, float]]:
    """Starting points of a circuit that leaks: a few for each series resistance that is tried."""
    strip = actuator.replace(**allowed(actuator, base))
    most = _LEAK_STARTS + free.isdisjoint(SERIES)
    starts = leak_starts(strip, free, [in_means(record) or record for record in records], starts_of(delays), most)
    return [{**base, **_freed(start, free)} for start in starts]


def _motion_starts(
    strip: Actuator, free: set[str], records: Sequence[PreparedRun], shifts: Mapping[int, float]
) -> list[dict[str, float]]:
    """Values of what only displacement and force show, for a circuit that is known; one empty where nothing is free."""
    starts: list[dict[str, float]] = [{}]
    relaxing = {name.split(".")[1].removesuffix("_pair") for name in free if name.startswith("relaxation.")}
    if any(name.startswith("coupling.") for name in free):
        starts = coupling_starts(strip, records, shifts, stiffness_is_free="beam.modulus" in free)
    elif relaxing:
        starts = [relaxation_start(strip, records, shifts, sorted(relaxing))]
    return [_freed(start, free) for start in starts]


def _freed(values: Mapping[str, float], free: set[str]) -> dict[str, float]:
    return {name: value for name, value in values.items() if name in free}


def allowed(actuator: Actuator, values: Mapping[str, float]) -> dict[str, float]:
    """Values of parameters, each no farther than it may be."""
    parameters = actuator.parameters()
    return {
        name: min(max(float(value), parameters[name].lower), parameters[name].upper) for name, value in values.items()
    }


def _series_values(
    actuator: Actuator, free: set[str], base: Mapping[str, float], direct: float
) -> list[dict[str, float]]:
    """Values of the free ones of sheet and contact resistance; one empty mapping where both are fixed."""
    if free.isdisjoint(SERIES):
        return [{}]
    values = {**actuator.parameter_values, **base}
    squares = 2.0 * float(np.real(geometry.squares(values)))
    first = 1.0 / max(direct, 1e-12)
    found = []
    for part in _SERIES_PARTS:
        series = part * first
        if free.issuperset(SERIES):
            found.append({SHEET: 0.9 * series / squares, CONTACT: 0.1 * series})
        elif SHEET in free:
            found.append({SHEET: max(series - values[CONTACT], 0.05 * series) / squares})
        else:
            found.append({CONTACT: max(series - values[SHEET] * squares, 0.01 * series)})
    return found
