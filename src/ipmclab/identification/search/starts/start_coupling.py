"""The coupling found from force or displacement and the node voltage of a known circuit."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, islice
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.problem.free_run import seen_from_sensor
from ipmclab.identification.problem.record import PreparedRun, model_hold
from ipmclab.identification.search.starts.complex_pairs import best_pairs
from ipmclab.identification.search.starts.slow_modes import slow_modes, slow_poles, slow_values
from ipmclab.identification.search.starts.start_turning import TurningFit, search_turning
from ipmclab.identification.search.varpro import PoleFit, SearchedRun, all_minima, search_poles
from ipmclab.model import Actuator, simulate_outputs
from ipmclab.model.numerics.drive import Drive, responses

FloatArray = npt.NDArray[np.float64]

_MEETING: Final = 1.3  # ratio of two real poles below which they may be a complex pair
_MINIMA: Final = 2  # that are followed
_PAIRS: Final = 3  # of complex poles that are followed, where real ones meet
_HOPELESS: Final = 100.0  # times the least cost, where poles that stand apart have it: no start leads below those
_AS_GOOD: Final = 1.02  # part of the least cost of real poles up to which complex ones are tried: where poles meet


def coupling_starts(
    actuator: Actuator, records: Sequence[PreparedRun], delays: Mapping[int, float], *, stiffness_is_free: bool
) -> list[dict[str, float]]:
    """Starting points of d(s) = K_d (s + Z_d)/(s^2 + P_1d s + P_2d) and its slow modes, the most likely first.

    Force and displacement are both d(s) V_appl times a number here, less their slow modes: the beam's own resonance
    is left to the fit. The node voltage comes from the circuit, and the poles from variable projection.

    Parameters
    ----------
    actuator : Actuator
        With the circuit and the beam near their final values; its structure says how many slow modes there are.
    records : sequence of PreparedRun
    delays : mapping of place to float [s]
    stiffness_is_free : bool
        Whether Young's modulus is to be started too, where displacement tells d(s) without it.
    """
    motion = motion_series(actuator, records, delays)
    slow = {output: len(slow_poles(actuator, output)) for output in ("displacement", "force")}
    moving, pressing = motion.of("displacement"), motion.of("force")
    separate = stiffness_is_free and bool(moving.series) and bool(pressing.series)
    if slow["displacement"] == slow["force"] == 0:
        every = moving if separate else motion
        found = _from(every, _worth_it(_minima(every, 2)))
        stiffness = _stiffness(_minima(moving, 2)[0], pressing.series) if separate else 1.0
        return [_named(start) | _modulus(actuator, stiffness, separate) for start in found]
    starts = []
    for of, other in ((moving, pressing), (pressing, moving)):
        if not of.series or (separate and of is pressing):
            continue
        for start, own in _with_slow_modes(actuator, of, slow[of.output]):
            values = _named(start) | own
            if other.series:
                stiffness, of_other = _with_other(start, other, slow[other.output], separate=separate)
                values |= slow_values(actuator, other.output, of_other) | _modulus(actuator, stiffness, separate)
            starts.append(values)
    return starts


def _worth_it(minima: Sequence[PoleFit]) -> list[PoleFit]:
    """The minima of real poles that are tried: where the best ones meet, complex ones may lie beside any of them."""
    best = minima[0]
    if _meet(best):
        return list(minima[:_MINIMA])
    return [found for found in minima[:_MINIMA] if found.cost < _HOPELESS * best.cost]


def _with_slow_modes(actuator: Actuator, of: MotionSeries, slow: int) -> Iterator[tuple[_Start, dict[str, float]]]:
    """Starts of d(s) with the slow modes of one output, those with complex poles first where they explain as much."""
    real = _minima(of, 2 + slow)[:_MINIMA]
    if slow == 2 and f"relaxation.{of.output}_pair.0.ratio" in actuator.parameter_values:
        turning = search_turning(of.series, sensors(of))
        # The cost of poles that have met is what rounding leaves of it.
        apart = [found.cost for found in real if not _meet(found)]
        if turning is not None and turning.cost < _AS_GOOD * min(apart, default=np.inf):
            yield _turning(of, turning)
    for start in _from(of, real):
        yield start, slow_values(actuator, of.output, start.slow)


def _turning(of: MotionSeries, found: TurningFit) -> tuple[_Start, dict[str, float]]:
    p1, p2 = float(-np.sum(found.poles)), float(np.prod(found.poles))
    level, gain = -float(found.residues @ found.poles[::-1]), float(np.sum(found.residues))
    level = level if level > 0 else 1e-12
    nyquist = float(np.pi * max(record.run.rate for record, _ in of.labels))
    name, static = f"relaxation.{of.output}_pair.0", level / p2
    values = {
        f"{name}.ratio": -found.constant / static,
        f"{name}.lead": -found.lead / static,
        f"{name}.time_constant": found.time_constant,
        f"{name}.damping_ratio": found.damping_ratio,
    }
    return _Start(level, min(level / gain, nyquist) if gain > 0 else nyquist, p1, p2), values


def _modulus(actuator: Actuator, stiffness: float, separate: bool) -> dict[str, float]:
    return {"beam.modulus": actuator["beam.modulus"] * stiffness} if separate else {}


@dataclass(frozen=True)
class _Start:
    """K_d Z_d, Z_d, P_1d and P_2d, and the slow modes as (ratio, time constant [s])."""

    level: float
    zero: float
    p1: float
    p2: float
    slow: tuple[tuple[float, float], ...] = ()


def _named(start: _Start) -> dict[str, float]:
    return {
        "coupling.gain": start.level / start.zero,
        "coupling.zero": start.zero,
        "coupling.p1": start.p1,
        "coupling.p2": start.p2,
    }


def _from(motion: MotionSeries, minima: Sequence[PoleFit]) -> list[_Start]:
    nyquist = float(np.pi * max(record.run.rate for record, _ in motion.labels))
    starts: list[_Start] = []
    for found in minima:
        fast, level, gain = _fast_pair(found)
        p1, p2 = float(-np.sum(found.poles[fast])), float(np.prod(found.poles[fast]))
        modes = slow_modes(np.delete(found.poles, fast), np.delete(found.residues, fast), level / p2)
        seen_zero = level / gain if gain > 0 else np.inf
        # A zero beyond the Nyquist rate hardly shows, and one far beyond it not at all: it is put nearer.
        starts.append(_Start(level, min(seen_zero, nyquist), p1, p2, modes))
    if any(_meet(found) for found in minima):
        starts += islice(_complex(motion, len(minima[0].poles) - 2, nyquist), _PAIRS)
    return starts


def _meet(found: PoleFit) -> bool:
    """Whether two of the poles are equal: then complex ones may follow the readings better."""
    return bool(np.min(found.poles[:-1] / found.poles[1:]) < _MEETING)


def _complex(motion: MotionSeries, slow: int, nyquist: float) -> Iterator[_Start]:
    """Starts with complex poles and the slow modes beside them."""
    for found in best_pairs(motion.series, sensors(motion), slow):
        if found.constant > 0.0:
            corner = 1.0 / found.time_constant
            zero = min(found.constant / found.lead, nyquist) if found.lead > 0.0 else nyquist
            modes = slow_modes(found.poles, found.residues, found.constant)
            yield _Start(found.constant * corner**2, zero, 2.0 * found.damping_ratio * corner, corner**2, modes)


def _fast_pair(found: PoleFit) -> tuple[list[int], float, float]:
    """Which two poles are those of d(s), its K_d Z_d and its K_d.

    Any two would do, for which is called slow is a name: the fastest two that a positive d(0) can have.
    """
    every = []
    for pair in combinations(range(len(found.poles)), 2):
        fast = list(pair)
        level = -float(found.residues[fast] @ found.poles[fast[::-1]])
        every.append((fast, level, float(np.sum(found.residues[fast]))))
    for fast, level, gain in every:
        if level > 0:
            return fast, level, gain
    fast, level, gain = every[0]
    return fast, abs(level) or 1e-12, gain


def _with_other(
    start: _Start, other: MotionSeries, slow: int, *, separate: bool
) -> tuple[float, tuple[tuple[float, float], ...]]:
    """Stiffness over the one assumed, and slow modes, of the other output for a d(s) that is known."""
    root = np.sqrt(complex(start.p1**2 / 4.0 - start.p2))
    # Poles that meet or are complex are put apart on the real axis: this is a start.
    apart = max(float(root.real), 0.05 * start.p1)
    poles = np.array([-start.p1 / 2.0 - apart, min(-start.p1 / 2.0 + apart, -1e-3 * start.p1)])
    gain = start.level / start.zero
    first = (start.level + gain * poles[0]) / (poles[0] - poles[1])
    fast = PoleFit(poles, np.array([first, gain - first]), np.zeros(0), 0.0)
    if not slow:
        return _stiffness(fast, other.series) if separate else 1.0, ()
    expected = [fast.residues @ responses(run.drive, poles)[0] for run in other.series]
    common = sensors(other)
    if separate:
        common = np.vstack([common, np.concatenate(expected)])
        found = search_poles(other.series, slow, common)
        stiffness = max(float(found.common[-1]), 1e-3)
    else:
        left = [replace(run, readings=run.readings - part) for run, part in zip(other.series, expected, strict=True)]
        found, stiffness = search_poles(left, slow, common), 1.0
    return stiffness, slow_modes(found.poles, found.residues, stiffness * start.level / start.p2)


def _minima(motion: MotionSeries, count: int) -> list[PoleFit]:
    """Every different minimum of so many poles, no sensor drifting by more than its rows at 0 V allow."""
    found = all_minima(motion.series, count, sensors(motion))
    held = dict(_beyond(motion, found[0].common))
    if not held:
        return found
    series = [
        replace(run, readings=run.readings - held[k] * run.time) if k in held else run
        for k, run in enumerate(motion.series)
    ]
    return all_minima(series, count, sensors(motion, without=held))


def _beyond(motion: MotionSeries, common: FloatArray) -> Iterator[tuple[int, float]]:
    """The series whose slope is none that its rows at 0 V allow, and the nearest one that is."""
    for (k, is_slope), weight in zip(_columns(motion), common, strict=True):
        if not is_slope:
            continue
        slope = float(weight) / float(motion.series[k].time[-1])
        record, output = motion.labels[k]
        least, most = record.limits("drift", output)
        nearest = min(max(slope, least / motion.scales[k]), most / motion.scales[k])
        if nearest != slope:
            yield k, nearest


def _columns(motion: MotionSeries, without: Container[int] = ()) -> list[tuple[int, bool]]:
    """Of each column that sensors add the series, and whether it is a slope."""
    return [
        (k, is_slope)
        for k, (record, output) in enumerate(motion.labels)
        for is_slope in (False, True)
        if not is_slope or (("drift", output) in record.unsettled and k not in without)
    ]


def sensors(motion: MotionSeries, *, without: Container[int] = ()) -> FloatArray:
    """What sensors add: a constant for each series, for a zero is arbitrary, and a slope where the record shows one.

    Parameters
    ----------
    motion : MotionSeries
    without : container of int
        Series whose slope is known.

    Returns
    -------
    columns : float array, shape (n_column, n_total)
    """
    ends = np.cumsum([0, *(len(run.time) for run in motion.series)])
    what = _columns(motion, without)
    columns = np.zeros((len(what), ends[-1]))
    for column, (k, is_slope) in zip(columns, what, strict=True):
        time = motion.series[k].time
        column[ends[k] : ends[k + 1]] = time / time[-1] if is_slope else 1.0
    return columns


def _stiffness(found: PoleFit, pressing: Sequence[SearchedRun]) -> float:
    """Force over what d(s) from the displacement makes of it: the modulus over the one assumed."""
    above = below = 0.0
    for run in pressing:
        expected = found.residues @ responses(run.drive, found.poles)[0]
        weight = run.weight**2
        mean = np.sum(weight * expected) / np.sum(weight)
        above += float(np.sum(weight * (expected - mean) * run.readings))
        below += float(np.sum(weight * (expected - mean) ** 2))
    return max(above / below, 1e-3) if below > 0 else 1.0


@dataclass(frozen=True)
class MotionSeries:
    """Displacement and force over their static factors, driven by the node voltage; which run and output each is, and
    the factors."""

    series: Sequence[SearchedRun]
    labels: Sequence[tuple[PreparedRun, str]]
    scales: Sequence[float]

    def of(self, output: str) -> MotionSeries:
        """Those of one output."""
        chosen = [place for place, (_, name) in enumerate(self.labels) if name == output]
        series, labels, scales = self.series, self.labels, self.scales
        return MotionSeries([series[k] for k in chosen], [labels[k] for k in chosen], [scales[k] for k in chosen])

    @property
    def output(self) -> str:
        """Of which output they are, where all are of one."""
        return self.labels[0][1]


def motion_series(
    actuator: Actuator,
    records: Sequence[PreparedRun],
    delays: Mapping[int, float],
    *,
    known_part: Actuator | None = None,
) -> MotionSeries:
    """Displacement and force of all records as the searches for poles see them.

    Parameters
    ----------
    actuator : Actuator
    records : sequence of PreparedRun
    delays : mapping of place to float [s]
    known_part : Actuator, optional
        What this one answers is taken off the readings.
    """
    height, width = actuator["geometry.thickness"], actuator["geometry.width"]
    sensing = actuator["geometry.sensing_length"]
    scales = {
        "displacement": 3.0 * sensing**2 / height**2,
        "force": 3.0 * height * width * actuator["beam.modulus"] / (4.0 * sensing),
    }
    found: list[SearchedRun] = []
    labels: list[tuple[PreparedRun, str]] = []
    factors: list[float] = []
    for record in records:
        wanted = [output for output in scales if output in record.readings]
        if not wanted:
            continue
        strip = seen_from_sensor(actuator if known_part is None else known_part, record.series_resistance)
        node, *known = simulate_outputs(
            strip,
            record.run.time,
            record.run.voltage,
            model_hold(record),
            outputs=["applied_voltage", *wanted],
            delay=delays.get(record.place, 0.0),
        )
        durations, kind = np.unique(np.diff(record.run.time), return_inverse=True)
        given = Drive(durations, kind.astype(np.int64), node[:-1], node[1:], node)
        for output, answer in zip(wanted, known, strict=True):
            reading = record.readings[output]
            scale = scales[output]
            values = reading.values if known_part is None else reading.values - answer
            found.append(
                SearchedRun(
                    given,
                    record.run.time - record.run.time[0],
                    values / scale,
                    np.where(reading.exact, scale / max(reading.noise, 1e-300), 0.0),
                    record.start == "free",
                )
            )
            labels.append((record, output))
            factors.append(scale)
    return MotionSeries(found, labels, factors)
