"""The leak and the circuit beside it, found from currents alone: no starting values.

The voltage at the node is measured, u = V - S I with the series resistance S, and so is what leaks for a law that is
tried, w = phi(u). The rest is linear: I - w = Y(s) (V - S w), with the admittance Y of the circuit without its leak.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import numpy as np

from ipmclab.identification.problem.record import PreparedRun
from ipmclab.identification.problem.response import lumped
from ipmclab.identification.search.searched_run import SearchedRun, of_sensors, side_by_side
from ipmclab.identification.search.starts.start_circuit import (
    admittance_of,
    circuit_values,
    current_series,
    fitted_poles,
)
from ipmclab.model import Actuator
from ipmclab.model.admittance import Admittance, admittance
from ipmclab.model.declared import is_of_leak
from ipmclab.model.numerics.drive import Drive, responses
from ipmclab.model.stages.leak import ELECTROLYSIS, current_density
from ipmclab.run import FloatArray

_EDGE: Final = 0.05  # of the largest voltage: a jump at a row
_HINGES: Final = (0.3, 0.5, 0.7, 0.85)  # parts of the largest node voltage
_THRESHOLDS: Final = (0.15, 0.3, 0.45, 0.55, 0.65, 0.75, 0.85, 0.92)  # the same, and that from which water decomposes
_SCALES: Final = (0.02, 0.04, 0.08, 0.15, 0.3, 0.6, 1.2, 2.5)  # V, a factor of two apart: over which a leak grows
_STEEPEST: Final = 30.0  # largest exponent
_LAGS: Final = (0.03, 0.1, 0.3, 1.0)  # parts of the longest record
_ROUNDS: Final = 3  # of circuit and leak, each beside the other
_LEAST: Final = 1e-3  # of the largest current: what a leak that is not seen starts from


@dataclass(frozen=True)
class _Shape:
    """What is not linear in a leak, and the columns [V^2, V^3 or 1] whose factors are its sizes times the area."""

    values: Mapping[str, float]
    sizes: tuple[str, ...]
    columns: FloatArray
    place: tuple[int, int] = (0, 0)


def leak_starts(
    actuator: Actuator, free: set[str], records: Sequence[PreparedRun], delays: Mapping[int, float], most: int
) -> list[dict[str, float]]:
    """Starting points of the circuit's branches and of the leak, the most likely first.

    Parameters
    ----------
    actuator : Actuator
        With the series resistance near its final value; of what is free nothing else is used.
    free : set of str
    records : sequence of PreparedRun
        Those with a current.
    delays : mapping of place to float [s]
    most : int
        How many are wanted at most.
    """
    node = _Node.of(actuator, records, delays)
    structure = actuator.structure
    circuit_is_free = any(name.startswith("circuit.") for name in free)
    known = admittance(lumped(structure.branches, actuator.parameter_values, records[0].series_resistance))[0]

    def circuit_with(leak: FloatArray) -> Admittance:
        return admittance_of(fitted_poles(node.without(leak), structure.branches)) if circuit_is_free else known

    def beside(fractions: Admittance, leak: FloatArray) -> tuple[FloatArray, FloatArray]:
        return node.around(fractions, leak) if circuit_is_free else node.at(fractions)

    if not any(is_of_leak(name) for name in free):
        fractions = circuit_with(_leaks(actuator, node))
        return [circuit_values(fractions, actuator.parameter_values, node.series_resistance)[0]]
    shapes = _shapes(structure.leak, node.voltage)
    if not shapes:  # so large a voltage that any of them would draw what no number holds
        return []
    # A law that bends anywhere, whatever its form, comes first, beside which the circuit is found.
    size = np.abs(node.voltage)
    hinges = [np.sign(node.voltage) * np.maximum(size - part * size.max(), 0.0) for part in _HINGES]
    bending = shapes[0].columns if len(shapes) == 1 else np.array(hinges)
    leak = np.zeros_like(node.voltage)
    for _ in range(_ROUNDS):
        fractions = circuit_with(leak)
        linear, left = beside(fractions, leak)
        columns = np.vstack([linear, node.through(fractions, bending)])
        leak = np.maximum(_factors(columns, left, node.weight)[len(linear) :], 0.0) @ bending
    linear, left = beside(fractions, leak)
    through = node.through(fractions, np.vstack([shape.columns for shape in shapes]))
    found = []
    for shape, columns in _ranked(shapes, through, linear, left, node.weight)[:most]:
        factors = _factors(np.vstack([linear, columns]), left, node.weight)[len(linear) :]
        largest = _LEAST * float(np.abs(node.readings).max())
        least = [largest / max(float(np.abs(column).max()), 1e-300) for column in shape.columns]
        leak = np.maximum(factors, least) @ shape.columns
        values = dict(shape.values)
        growth = 0.0
        if structure.slow_leak:
            slow, lagged = _slow(node, fractions, leak, linear, left)
            growth = slow["leak.slow.growth"]
            # Both parts together are what was found above; the steady part alone is less.
            part = float(np.sum(leak * leak)) / max(float(np.sum(leak * (leak + growth * lagged))), 1e-300)
            values |= slow
            factors, leak = factors * part, part * (leak + growth * lagged)
        for name, factor, smallest in zip(shape.sizes, factors, least, strict=True):
            values[name] = max(float(factor), smallest) / _area(actuator)
        if circuit_is_free:
            values |= circuit_values(circuit_with(leak), actuator.parameter_values, node.series_resistance)[0]
        found.append(values)
    return found


@dataclass(frozen=True, eq=False)
class _Node:
    """The currents of all records, and the voltages at the rows behind the series resistance [ohm]."""

    series: Sequence[SearchedRun]
    voltage: FloatArray
    series_resistance: float

    @classmethod
    def of(cls, actuator: Actuator, records: Sequence[PreparedRun], delays: Mapping[int, float]) -> _Node:
        series = current_series(records, delays)
        resistances = [
            lumped(actuator.structure.branches, actuator.parameter_values, record.series_resistance).series
            for record in records
        ]
        nodes = [run.drive.present - one * run.readings for run, one in zip(series, resistances, strict=True)]
        return cls(series, np.concatenate(nodes), resistances[0])

    @property
    def readings(self) -> FloatArray:
        return np.concatenate([run.readings for run in self.series])

    @property
    def weight(self) -> FloatArray:
        return np.concatenate([run.weight for run in self.series])

    def without(self, leak: FloatArray) -> list[SearchedRun]:
        """The runs as a circuit without its leak sees them: drawn less, at a voltage that is lower by as much."""
        found = []
        for run, piece, _ in side_by_side(self.series):
            lower, drop = _driven(run, leak[piece]), self.series_resistance
            lowered = {
                name: getattr(run.drive, name) - drop * getattr(lower, name) for name in ("start", "end", "present")
            }
            found.append(replace(run, drive=replace(run.drive, **lowered), readings=run.readings - leak[piece]))
        return found

    def at(self, fractions: Admittance) -> tuple[FloatArray, FloatArray]:
        """What sensors add, and what a circuit without a leak leaves of the currents."""
        answer = np.concatenate([_answer(fractions, run.drive) for run in self.series])
        return of_sensors(self.series), self.readings - answer

    def around(self, fractions: Admittance, leak: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How the currents change with the circuit and the sensors, and what is left of them without the leak."""
        rows = []
        for run in self.without(leak):
            state, slope = responses(run.drive, fractions.poles)
            rows.append(np.vstack([run.drive.present, state, slope]))
        of_sensor, left = self.at(fractions)
        return np.vstack([np.concatenate(rows, axis=1), of_sensor]), left

    def through(self, fractions: Admittance, columns: FloatArray) -> FloatArray:
        """What each part of a leak adds to the current, w - S Y w: it also loads the electrodes."""
        found = np.empty_like(columns)
        for number, column in enumerate(columns):
            for run, piece, _ in side_by_side(self.series):
                drawn = _answer(fractions, _driven(run, column[piece]))
                found[number, piece] = column[piece] - self.series_resistance * drawn
        return found

    def lagged(self, values: FloatArray, time_constant: float) -> FloatArray:
        """Values at the rows behind 1/(1 + tau s)."""
        found = np.empty_like(values)
        for run, piece, _ in side_by_side(self.series):
            given = _driven(run, values[piece])
            found[piece] = responses(given, np.array([-1.0 / time_constant]))[0][0] / time_constant
        return found


def _answer(fractions: Admittance, given: Drive) -> FloatArray:
    """The current of a circuit [A]."""
    return np.asarray(fractions.direct * given.present + fractions.residues @ responses(given, fractions.poles)[0])


def _driven(run: SearchedRun, values: FloatArray) -> Drive:
    """A run driven by values at its rows in place of the voltage: flat where an edge ends a step of that."""
    given = run.drive
    knots = np.concatenate([[0.0], np.cumsum(given.durations[given.kind])])
    first = 0 if given.rows is None else int(given.rows[0])
    found = np.interp(knots - knots[first], run.time, values, left=0.0)
    jumps = np.abs(given.start[1:] - given.end[:-1]) > _EDGE * float(np.abs(given.start).max())
    flat = np.append(jumps, abs(given.present[-1] - given.end[-1]) > _EDGE * float(np.abs(given.start).max()))
    return replace(given, start=found[:-1], end=np.where(flat, found[:-1], found[1:]), present=values)


def _leaks(actuator: Actuator, node: _Node) -> FloatArray:
    """What a known leak draws at the node [A]."""
    form = actuator.structure.leak
    names = [name for name in actuator.parameter_values if name.startswith(f"leak.{form}.")]
    found = _area(actuator) * current_density(form, [actuator[name] for name in names], node.voltage)
    if actuator.structure.slow_leak:
        slow = node.lagged(found, actuator["leak.slow.time_constant"])
        found = found + actuator["leak.slow.growth"] * slow
    return found


def _area(actuator: Actuator) -> float:
    """Where the electrodes leak, all places together [m^2]."""
    return float(sum(np.real(area) for _, _, area in actuator.structure.law_ports(actuator.parameter_values)))


def _shapes(form: str, voltage: FloatArray) -> list[_Shape]:
    """The laws of one form that are tried."""
    size, most = np.abs(voltage), float(np.abs(voltage).max())
    if form == "cubic":
        columns = np.array([voltage * size, voltage**3])
        return [_Shape({"leak.cubic.linear": 0.0}, ("leak.cubic.quadratic", "leak.cubic.cubic"), columns)]
    thresholds = sorted([*(part * most for part in _THRESHOLDS), *([ELECTROLYSIS] if most > ELECTROLYSIS else [])])
    found = []
    for (i, threshold), (j, scale) in product(enumerate(thresholds), enumerate(_SCALES)):
        if (most - threshold) / scale > _STEEPEST:
            continue
        column = current_density(form, (1.0, threshold, scale), voltage)
        values = {f"leak.{form}.threshold": threshold, f"leak.{form}.voltage_scale": scale}
        found.append(_Shape(values, (f"leak.{form}.current_density",), column[None], (i, j)))
    return found


def _ranked(
    shapes: Sequence[_Shape], through: FloatArray, linear: FloatArray, left: FloatArray, weight: FloatArray
) -> list[tuple[_Shape, FloatArray]]:
    """The shapes, each with its columns, in the order of what they explain with a positive size, no two neighbours."""
    if len(shapes) == 1:
        return [(shapes[0], through)]
    basis = np.linalg.qr((linear * weight).T)[0] if len(linear) else np.zeros((len(left), 0))
    columns = through * weight
    columns = columns - (columns @ basis) @ basis.T
    target = left * weight
    gains = columns @ target / np.maximum(np.linalg.norm(columns, axis=1), 1e-300)
    separate: list[int] = []
    for place in np.argsort(-gains):
        i, j = shapes[place].place
        if all(max(abs(i - shapes[o].place[0]), abs(j - shapes[o].place[1])) > 1 for o in separate):
            separate.append(int(place))
    return [(shapes[place], through[place][None]) for place in separate]


def _slow(
    node: _Node, fractions: Admittance, leak: FloatArray, linear: FloatArray, left: FloatArray
) -> tuple[dict[str, float], FloatArray]:
    """How much of a leak comes slowly and how slowly, and the leak behind that lag."""
    longest = max(float(run.time[-1]) for run in node.series)
    tried = []
    for part in _LAGS:
        lagged = node.lagged(leak, part * longest)
        columns = np.vstack([linear, node.through(fractions, np.vstack([leak, lagged]))])
        factors = _factors(columns, left, node.weight)
        cost = float(np.sum(((left - factors @ columns) * node.weight) ** 2))
        growth = float(np.clip(factors[-1] / factors[-2], 0.05, 50.0)) if factors[-2] > 0 else 50.0
        tried.append((cost, part, growth, lagged))
    _, part, growth, lagged = min(tried, key=lambda one: one[0])
    return {"leak.slow.growth": growth, "leak.slow.time_constant": part * longest}, lagged


def _factors(columns: FloatArray, left: FloatArray, weight: FloatArray) -> FloatArray:
    """Weighted least squares with columns of length one."""
    table = (columns * weight).T
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    return np.asarray(np.linalg.lstsq(table / size, left * weight, rcond=1e-10)[0] / size)
