"""The coupling, or the slow modes beside a known one, from force or displacement and the node voltage of a circuit."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from ipmclab.identification.problem.free_run import seen_from_sensor
from ipmclab.identification.problem.record import PreparedRun, fastest_rate, model_hold
from ipmclab.identification.search.searched_run import SearchedRun, of_sensors
from ipmclab.identification.search.varpro import PoleFit, all_minima, near_pairs, pair_minima, search_poles
from ipmclab.model import Actuator, simulate_outputs
from ipmclab.model.numerics.drive import Drive, responses
from ipmclab.model.slow_modes import Quadratic, fastest_two, of_two, slow_modes, slow_poles, slow_values
from ipmclab.run import FloatArray

_IS_SLOW: Final = re.compile(r"relaxation\..*\.(ratio|lead)$")
_NONE: Final = np.empty(0)  # where no poles stand beside those of d(s)
_STATIC: Final = 1e-3  # of what d(s) has at its corner, where the best static part is none that a strip has
_MEETING: Final = 1.3  # ratio of two real poles below which they count as met
_MINIMA: Final = 2  # of real poles that are followed
_PAIRS: Final = 12  # of those with a complex pair, at most
_HOPEFUL: Final = 4.0  # times the least cost of real poles, up to which these are followed
_HOPELESS: Final = 100.0  # times the least cost of real poles: no start leads from there below it
_AS_GOOD: Final = 1.02  # part of the least cost of real poles up to which complex slow ones are tried


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
    slow = {output: slow_poles(actuator, output) for output in ("displacement", "force")}
    moving, pressing = (of_output(motion, output) for output in slow)
    separate = stiffness_is_free and bool(moving) and bool(pressing)
    if slow["displacement"] == slow["force"] == 0:
        every = moving if separate else motion
        minima = _minima(every, 2)
        modulus = {"beam.modulus": actuator["beam.modulus"] * _stiffness(minima[0], pressing)} if separate else {}
        return [_named(start) | modulus for start in _from(every, minima)]
    starts = []
    for of, other in ((moving, pressing), (pressing, moving)):
        if not of or (separate and of is pressing):
            continue
        for start, own in _with_slow_modes(actuator, of, slow[of[0].output]):
            values = _named(start) | own
            if other:
                stiffness, of_other = _with_other(start, other, slow[other[0].output], separate=separate)
                values |= slow_values(actuator, other[0].output, of_other)
                if separate:
                    values["beam.modulus"] = actuator["beam.modulus"] * stiffness
            starts.append(values)
    return starts


def _with_slow_modes(actuator: Actuator, of: Sequence[Motion], slow: int) -> Iterator[tuple[_Start, dict[str, float]]]:
    """Starts of d(s) with the slow modes of one output, those with complex slow poles first, if as good."""
    real = _minima(of, 2 + slow)
    may_turn = slow == 2 and f"relaxation.{of[0].output}_pair.0.ratio" in actuator.parameter_values
    if may_turn:
        # The cost of poles that have met is what rounding leaves of it.
        apart = [one.cost for one in real[:_MINIMA] if not np.min(one.poles[:-1] / one.poles[1:]) < _MEETING]
        for turning in _within_drifts(of, lambda series, common: pair_minima(series, 2, common))[:1]:
            if turning.cost < _AS_GOOD * min(apart, default=np.inf):
                yield _turning(of, turning)
    for start in _from(of, real, slow_may_turn=may_turn):
        yield start, slow_values(actuator, of[0].output, start.slow)


def _turning(of: Sequence[Motion], found: PoleFit) -> tuple[_Start, dict[str, float]]:
    """Two real poles of d(s), and a complex pair (r + lead s)/(1 + 2 zeta tau s + tau^2 s^2) of slow ones."""
    slow, start = _of_pair(found), _start(of, of_two(found.poles, found.residues))
    name, static, tau = f"relaxation.{of[0].output}_pair.0", start.level / start.p2, slow.p2**-0.5
    values = {
        f"{name}.ratio": -slow.level * tau**2 / static,
        f"{name}.lead": -slow.gain * tau**2 / static,
        f"{name}.time_constant": tau,
        f"{name}.damping_ratio": 0.5 * slow.p1 * tau,
    }
    return start, values


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


def _of_pair(found: PoleFit) -> Quadratic:
    assert found.pair is not None
    pair = found.pair
    level = -(pair.residue * pair.pole.conjugate()).real
    return Quadratic(level, pair.residue.real, -2.0 * pair.pole.real, abs(pair.pole) ** 2)


def _start(
    motion: Sequence[Motion], fast: Quadratic, poles: FloatArray = _NONE, residues: FloatArray = _NONE
) -> _Start:
    """A start from the poles of d(s) and those of slow modes beside them."""
    nyquist = fastest_rate(one.record for one in motion)
    # No strip has a static part that is not above zero: nearly none is what is nearest.
    level = fast.level if fast.level > 0.0 else _STATIC * abs(fast.gain) * fast.p2**0.5 or 1e-12
    seen_zero = level / fast.gain if fast.gain > 0 else np.inf
    # A zero beyond the Nyquist rate hardly shows, and one far beyond it not at all: it is put nearer.
    return _Start(level, min(seen_zero, nyquist), fast.p1, fast.p2, slow_modes(poles, residues, level / fast.p2))


def _from(motion: Sequence[Motion], real: Sequence[PoleFit], *, slow_may_turn: bool = False) -> list[_Start]:
    """Starts from minima of real poles, and from those of as many with a complex pair among them for d(s).

    Where the slow modes may be a pair too, the slower two poles are theirs.
    """
    hopeless, starts = _HOPELESS * real[0].cost, []
    for found in real[:_MINIMA]:
        if found.cost < hopeless or found is real[0]:
            own = fastest_two(found.poles, found.residues)
            rest = np.delete(found.poles, own), np.delete(found.residues, own)
            starts.append(_start(motion, of_two(found.poles[own], found.residues[own]), *rest))
    count = len(real[0].poles) - 2
    for found in _within_drifts(motion, lambda series, common: near_pairs(series, count, common, hopeless))[:_PAIRS]:
        fast = _of_pair(found)
        is_slow = slow_may_turn and fast.p2 < float(np.prod(found.poles))
        if found.cost < _HOPEFUL * real[0].cost and not is_slow:
            starts.append(_start(motion, fast, found.poles, found.residues))
    return starts


def _with_other(
    start: _Start, other: Sequence[Motion], slow: int, *, separate: bool
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
        return _stiffness(fast, other) if separate else 1.0, ()
    runs = [one.run for one in other]
    common = of_sensors(runs)
    expected = [fast.residues @ responses(run.drive, poles)[0] for run in runs]
    if separate:
        common = np.vstack([common, np.concatenate(expected)])
        found = search_poles(runs, slow, common)
        stiffness = max(float(found.common[-1]), 1e-3)
    else:
        left = [replace(run, readings=run.readings - part) for run, part in zip(runs, expected, strict=True)]
        found, stiffness = search_poles(left, slow, common), 1.0
    return stiffness, slow_modes(found.poles, found.residues, stiffness * start.level / start.p2)


def _minima(motion: Sequence[Motion], count: int) -> list[PoleFit]:
    """Every different minimum of so many real poles."""
    return _within_drifts(motion, lambda series, common: all_minima(series, count, common))


def _within_drifts(
    motion: Sequence[Motion], search: Callable[[Sequence[SearchedRun], FloatArray], list[PoleFit]]
) -> list[PoleFit]:
    """What a search finds, no sensor drifting by more than its rows at 0 V allow."""
    runs = [one.run for one in motion]
    found = search(runs, of_sensors(runs))
    constants = [(k, what) for k, run in enumerate(runs) for what in run.sensor]
    held = {}
    for (k, what), weight in zip(constants, found[0].common, strict=True) if found else ():
        if what == "drift":
            one, run = motion[k], runs[k]
            slope = float(weight) / float(run.time[-1])
            least, most = one.record.limits("drift", one.output)
            nearest = min(max(slope, least / one.scale), most / one.scale)
            if nearest != slope:
                held[k] = replace(run, readings=run.readings - nearest * run.time, sensor=("offset",))
    if not held:
        return found
    series = [held.get(k, run) for k, run in enumerate(runs)]
    return search(series, of_sensors(series))


def _stiffness(found: PoleFit, pressing: Sequence[Motion]) -> float:
    """Force over what d(s) from the displacement makes of it: the modulus over the one assumed."""
    above = below = 0.0
    for run in (one.run for one in pressing):
        expected = found.residues @ responses(run.drive, found.poles)[0]
        weight = run.weight**2
        mean = np.sum(weight * expected) / np.sum(weight)
        above += float(np.sum(weight * (expected - mean) * run.readings))
        below += float(np.sum(weight * (expected - mean) ** 2))
    return max(above / below, 1e-3) if below > 0 else 1.0


class Motion(NamedTuple):
    """Displacement or force of one record over its static factor, driven by the node voltage."""

    run: SearchedRun
    record: PreparedRun
    output: str
    scale: float


def of_output(motion: Sequence[Motion], output: str) -> list[Motion]:
    """Those of one output."""
    return [one for one in motion if one.output == output]


def motion_series(
    actuator: Actuator,
    records: Sequence[PreparedRun],
    delays: Mapping[int, float],
    *,
    known_part: Actuator | None = None,
) -> list[Motion]:
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
    found: list[Motion] = []
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
            weight = np.where(reading.exact, scale / max(reading.noise, 1e-300), 0.0)
            since, is_free = record.run.time - record.run.time[0], record.start == "free"
            # A zero is arbitrary; a slope is asked for where the record shows one.
            sensor = ("offset", "drift") if ("drift", output) in record.unsettled else ("offset",)
            run = SearchedRun(given, since, values / scale, weight, is_free, sensor=sensor)
            found.append(Motion(run, record, output, scale))
    return found


def relaxation_start(
    actuator: Actuator, records: Sequence[PreparedRun], delays: Mapping[int, float], outputs: Sequence[str]
) -> dict[str, float]:
    """The slow modes of these outputs, for the circuit and the coupling of an actuator.

    What the fast part of the drive leaves of a reading is a sum of responses to the node voltage, whose poles
    variable projection finds.

    Parameters
    ----------
    actuator : Actuator
        With the circuit, the coupling and the beam near their final values; its slow modes are not used.
    records : sequence of PreparedRun
    delays : mapping of place to float [s]
    outputs : sequence of str
        ``displacement``, ``force``, or both.
    """
    values: dict[str, float] = {}
    off = {name: 0.0 for name in actuator.parameter_values if _IS_SLOW.match(name)}
    static = actuator["coupling.gain"] * actuator["coupling.zero"] / actuator["coupling.p2"]
    motion = motion_series(actuator, records, delays, known_part=actuator.replace(**off))
    for output in outputs:
        of, slow = of_output(motion, output), slow_poles(actuator, output)
        if not of or not slow:
            continue
        runs = [one.run for one in of]
        found = search_poles(runs, slow, of_sensors(runs))
        values |= slow_values(actuator, output, slow_modes(found.poles, found.residues, static))
    return values
