"""A circuit found from currents alone: no starting values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from ipmclab.identification.problem.edge_delay import EdgeDelay, starts_of
from ipmclab.identification.problem.record import LONGEST_DELAY, ZERO, PreparedRun, at_their_rows, drive
from ipmclab.identification.search.searched_run import SearchedRun, moves_of_rows, of_sensors
from ipmclab.identification.search.varpro import PoleFit, search_poles
from ipmclab.model import geometry
from ipmclab.model.admittance import Admittance, Elements, elements
from ipmclab.run import Run

_DELAY_PARTS: Final = 4  # trials within each row
_LEAST_DIRECT: Final = 1e-12  # S, where the current reads zero throughout
_NEARLY_ALL: Final = 0.97  # largest part of the first resistance that may lie in series with the branches
_ROWS_AFTER_EDGE: Final = 2500  # that are searched for where it lies: later ones say nothing of it
_LEAVES: Final = 1.0 / 3.0  # of the squares: where there is none, 0.4 or more (`wrong_model`, waves)
_MET: Final = 1.05  # ratio of poles below which they are one (convention)
_SAME_COST: Final = 4.0  # of chi-square: two standard deviations


class _Allowed(NamedTuple):
    """Between which delays the edges of a record may lie, and before which row they are likeliest to [rows]."""

    low: float
    high: float
    row: int


def current_series(records: Sequence[PreparedRun], delays: Mapping[int, float]) -> list[SearchedRun]:
    """The currents of these records, ready for the search of poles; straight between the rows that were measured."""
    found = []
    for record in records:
        reading = record.readings["current"]
        given = drive(record, delays.get(record.place, 0.0))
        used = np.flatnonzero(reading.exact)
        since = record.run.time - record.run.time[0]
        current = np.interp(since, since[used], reading.values[used])
        weight = np.where(reading.exact, 1.0 / max(reading.noise, 1e-300), 0.0)
        step = None
        if reading.weights is not None:
            weight, step = weight * reading.weights, float(np.diff(since).min())
        sensor = ("offset",) if ZERO in record.unsettled else ()
        found.append(SearchedRun(given, since, current, weight, record.start == "free", step, sensor))
    return found


def find_circuit(
    records: Sequence[PreparedRun], branches: int, series: float | None
) -> tuple[Admittance, dict[int, EdgeDelay]]:
    """Poles and residues of the current, and where the edges of foreign records lie, by their places.

    Parameters
    ----------
    records : sequence of PreparedRun
        Those with a current.
    branches : int
    series : float [ohm] or None
        Electrodes and contact, where they are known: they tell which delays belong to a circuit that can exist.
    """

    def found() -> tuple[Admittance, dict[int, EdgeDelay]]:
        delays = at_their_rows(records)
        timed = [record for record in records if not record.delay_is_free]
        # Each by itself: beside another whose edges are no better known it would only seem to be located.
        allowed = {
            record.place: _locate([*timed, record], record, branches, series)
            for record in records
            if record.place in delays and record.shows_edges
        }
        if allowed:
            delays |= _beside_each_other(records, allowed, starts_of(delays), branches)
        return admittance_of(fitted_poles(current_series(records, starts_of(delays)), branches)), delays

    first, *others = records
    # A fit asks once; each stage that it is then tried with asks the same again.
    return first.keep((*others, branches, series), found)


def _beside_each_other(
    records: Sequence[PreparedRun], allowed: Mapping[int, _Allowed], delays: Mapping[int, float], branches: int
) -> dict[int, EdgeDelay]:
    """The delays of all records together, from those that each allows by itself.

    As the edges of a record move past a row, what that row reads of the current jumps: a search that follows the cost
    stays between two rows. A step shows between which its edge lies. A slow voltage may show it only beside other
    records, from which the circuit is known, and several of these only how they lie to each other.
    """
    short = [_beginning(record) for record in records]
    periods = {record.place: record.period for record in records if record.place in allowed}
    costs: dict[tuple[float, ...], float] = {}

    def cost(rows: tuple[float, ...]) -> float:
        if rows not in costs:
            moved = {place: (row - 0.5) * periods[place] for place, row in zip(periods, rows, strict=True)}
            costs[rows] = fitted_poles(current_series(short, {**delays, **moved}), branches, tries=1).cost
        return costs[rows]

    lowest, best = tuple(float(allowed[place].row) for place in periods), None
    while lowest != best:
        best = lowest
        beside = (tuple(map(float, one)) for one in moves_of_rows(np.array(best)))
        lowest = min([best, *beside], key=cost)
    return {
        place: EdgeDelay.of(allowed[place].low, allowed[place].high, row, periods[place])
        for place, row in zip(periods, lowest, strict=True)
    }


def _locate(records: Sequence[PreparedRun], record: PreparedRun, branches: int, series: float | None) -> _Allowed:
    """The delays of one record that its readings allow.

    Rows on both sides of a step confine its edge, but where it lies between them a step alone does not show: every
    such delay has its circuit, and some of these circuits cannot exist.
    """
    records = [_beginning(one) for one in records]
    steps = np.arange(-LONGEST_DELAY * _DELAY_PARTS, LONGEST_DELAY * _DELAY_PARTS + 1) / _DELAY_PARTS
    delayed = (current_series(records, {record.place: float(step) * record.period}) for step in steps)
    tried = [fitted_poles(series, branches, tries=1) for series in delayed]
    costs = np.array([found.cost for found in tried])
    best = int(np.argmin(costs))
    readings = sum(int(np.count_nonzero(r.readings["current"].exact)) for r in records)
    allowed = costs <= costs[best] * (1.0 + _SAME_COST / readings)
    stretches = np.split(np.arange(len(steps)), 1 + np.flatnonzero(np.diff(allowed)))
    chosen = next(stretch for stretch in stretches if best in stretch)
    if series is not None:
        total = series + record.series_resistance
        physical = [place for place in chosen if elements(total, admittance_of(tried[place])).is_physical()]
        chosen = np.array(physical or chosen)
    # An edge on a row is seen by it: a range of delays is open at its lower end.
    low, high = float(steps[chosen[0]]) - 1.0 / _DELAY_PARTS, float(steps[chosen[-1]])
    return _Allowed(low, high, math.ceil(steps[best]))


def _beginning(record: PreparedRun) -> PreparedRun:
    """A record up to some rows after its first edge: all that is needed to locate it."""
    voltage = record.run.voltage
    # Moved since the first row, not from row to row: a sine after a long rest makes no jump.
    moved = np.abs(voltage - voltage[0])
    edge = int(np.argmax(moved > 0.2 * np.max(moved))) - 1
    stop = edge + _ROWS_AFTER_EDGE
    if stop >= len(voltage):
        return record
    run = record.run
    readings = {
        name: replace(reading, values=reading.values[:stop], used=reading.used[:stop], side=reading.side[:stop])
        for name, reading in record.readings.items()
    }
    short = Run(time=run.time[:stop], voltage=voltage[:stop], hold=run.hold, metadata=run.metadata)
    return replace(record, run=short, readings=readings)


def admittance_of(found: PoleFit) -> Admittance:
    """Of a circuit whose poles were fitted."""
    return Admittance(float(found.common[0]), found.residues, found.poles)


def fitted_poles(series: Sequence[SearchedRun], branches: int, *, tries: int = 3) -> PoleFit:
    """The poles of some currents, whose direct term answers to the voltage itself."""
    direct = np.concatenate([run.drive.present for run in series])
    return search_poles(series, branches, np.vstack([direct, of_sensors(series)]), tries=tries)


def zero_of_wave(record: PreparedRun, branches: int, left: Mapping[tuple[int, str], float]) -> float | None:
    """The zero [A] of a current without rows at 0 V, where it explains most of what so many poles leave of it, and more
    than a drift or a state at the start would.

    Under a constant voltage a zero looks like the dc path, under a wave it does not. Of what a zero explains less, what
    the model lacks may be the cause: that is asked of the noise.

    Parameters
    ----------
    record : PreparedRun
    branches : int
    left : mapping of (place, output) to float [SI]
        Standard deviation of what a model leaves of each output. Near the noise there is no zero to ask for.
    """
    asked = record.zero_is_taken and record.zero_is_unseen and record.voltage_shows_zero
    if not asked or _LEAVES * left[record.place, "current"] ** 2 < record.readings["current"].noise ** 2:
        return None

    def found() -> float | None:
        (series,) = current_series([record], starts_of(at_their_rows([record])))
        of_sensor = (replace(series, sensor=(one,)) for one in ("offset", "drift"))
        tried = (series, *of_sensor, replace(series, free_start=True))
        neither, zero, *others = (fitted_poles([one], branches) for one in tried)
        is_shown = zero.cost < min(_LEAVES * neither.cost, *(other.cost for other in others))
        return float(zero.common[1]) if is_shown else None

    return record.keep(("zero", branches), found)


def circuit_values(fractions: Admittance, values: Mapping[str, float], series: float) -> tuple[dict[str, float], bool]:
    """Parameters of the circuit that shows an admittance, and whether it is physical as it stands.

    Parameters
    ----------
    fractions : Admittance
    values : mapping of name to float [SI]
        Where the dimensions stand.
    series : float [ohm]
        Everything in series with the branches.
    """
    exact = elements(series, fractions)
    physical = exact.is_physical()
    circuit = exact if physical else _nearest(series, fractions)
    # Resistivities and permittivities of lumped elements (Friend, eqs 4.2 to 4.6).
    scale = float(np.real(geometry.area_per_thickness(values)))
    found = {"circuit.dc_resistivity": circuit.leak * scale}
    for number, (resistance, capacitance) in enumerate(zip(circuit.resistances, circuit.capacitances, strict=True)):
        found[f"circuit.branches.{number}.resistivity"] = float(resistance) * scale
        found[f"circuit.branches.{number}.permittivity"] = float(capacitance) / scale
    return found, physical


def _nearest(series: float, fractions: Admittance) -> Elements:
    """A physical circuit near an admittance that noise, or a wrong series resistance, made unphysical."""
    fractions = _shared(fractions)
    direct = fractions.direct if fractions.direct > 0 else float(np.sum(np.abs(fractions.residues / fractions.poles)))
    direct = max(direct, _LEAST_DIRECT)
    if series * direct > _NEARLY_ALL:
        direct = _NEARLY_ALL / series
    weights = np.maximum(-fractions.residues / -fractions.poles, 1e-3 * direct)
    # The current that is left at the end, direct - sum(weights), must stay above zero.
    weights *= min(1.0, 0.99 * direct / float(np.sum(weights)))
    apart = np.sort(fractions.poles)
    for place in range(1, len(apart)):
        apart[place] = max(apart[place], apart[place - 1] / _MET)
    found = elements(series, Admittance(direct, weights * fractions.poles, apart))
    if found.is_physical():
        return found
    count = len(fractions.poles)
    resistance = max(1.0 / direct - series, 0.01 / direct) * count
    return Elements(series, 10.0 * resistance, np.full(count, resistance), -1.0 / (fractions.poles * resistance))


def _shared(fractions: Admittance) -> Admittance:
    """The same with poles that have met as one, in equal parts: what each of them carries is rounding."""
    order = np.argsort(fractions.poles)
    poles, residues = fractions.poles[order], fractions.residues[order]
    for group in np.split(np.arange(len(poles)), 1 + np.flatnonzero(np.diff(np.log(-poles)) <= -math.log(_MET))):
        poles[group], residues[group] = -np.exp(np.mean(np.log(-poles[group]))), np.mean(residues[group])
    return Admittance(fractions.direct, residues, poles)
