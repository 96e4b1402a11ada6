"""What the readings determine, together with the parameters that they leave open: each with its interval.

A quantity g of the parameters has, to first order, the variance of its gradient under their covariance, on the scale of
its logarithm where it cannot be negative. It is said to be known only where no direction about which the readings say
nothing moves it, where other fits as good agree on it, and where its error is that of a parameter that is determined.
Its interval holds the values that it has where the profile of a parameter of the circuit that is not determined ends.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from ipmclab.confidence import NORMAL_95, wider_for_few
from ipmclab.fit.fit import DETERMINED
from ipmclab.fit.known import Known
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import PreparedRun
from ipmclab.identification.search.doubts import largest_current, largest_swing
from ipmclab.identification.search.valleys import Rival
from ipmclab.identification.uncertainty.covariance import MOVED, Uncertainty
from ipmclab.model import Actuator
from ipmclab.model.quantities import AT_ONCE, derived, quantities_of_each
from ipmclab.named_matrix import Table, matrix_of
from ipmclab.quality.record import Record as Checked
from ipmclab.run import FloatArray
from ipmclab.ties import largest_first

_STEP: Final = 1e-4  # of an entry, for a derivative: entries are logarithms, or of order one
_ROUNDING: Final = 1e-6  # part of a quantity that moves with an entry: less is rounding
_SAME: Final = 1e-9  # part of a value, in which runs agree but for rounding


@dataclass(frozen=True, eq=False)
class Point:
    """A fit, and what is known at it.

    Parameters
    ----------
    problem : Problem
    theta : float array, shape (n,)
        The whole vector.
    found : Uncertainty
        Of the entries that were asked for.
    stated : mapping of name to mapping of name to float [SI]
        Covariance of the fixed parameters with a stated uncertainty.
    rivals : sequence of Rival
        Other fits as good.
    ends : sequence of float array, shape (n,)
        Where the profiles of parameters of the circuit end that are not determined: so far no gradient leads.
    of_sensor : mapping of place to float array, shape (n_time,) [A]
        What the sensor of the current adds to its readings in each run that has them.
    """

    problem: Problem
    theta: FloatArray
    found: Uncertainty
    stated: Table
    rivals: Sequence[Rival] = ()
    ends: Sequence[FloatArray] = ()
    of_sensor: Mapping[int, FloatArray] = field(default_factory=dict)


def known_quantities(actuator: Actuator, points: Sequence[Point]) -> tuple[Known, ...]:
    """The quantities that some runs determine.

    Parameters
    ----------
    actuator : Actuator
        That was identified.
    points : sequence of Point
        The fit; then what else may be true (a stage that does not show), which an interval is to hold too.

    Returns
    -------
    known : tuple of Known
    """
    found: dict[str, dict[int, Known]] = {}
    alike: dict[tuple[object, ...], list[PreparedRun]] = {}
    unknowns = [one for one in points[0].problem.unknowns if one.base in actuator.parameter_values]
    for record in points[0].problem.records:
        own = tuple(one.name for one in unknowns if one.belongs_to(record.place))
        alike.setdefault((own, tuple(record.readings), record.run.rate), []).append(record)
    for together in alike.values():
        for one in _of_runs(actuator, points, together):
            found.setdefault(one.name, {}).update({record.place: one for record in together})
    records = points[0].problem.records
    each_its_own = any(not one.belongs_to(record.place) for one in unknowns for record in records)
    quantities_found = []
    for name, of_runs in found.items():
        first = next(iter(of_runs.values()))
        # Where runs have values of their own, what only some of them determine is a number of these.
        of_all = len(of_runs) == len(records) or not each_its_own
        if of_all and all(abs(one.value - first.value) <= _SAME * abs(first.value) for one in of_runs.values()):
            quantities_found.append(first)
        else:
            quantities_found += [replace(one, name=f"{name}[{place}]") for place, one in of_runs.items()]
    return tuple(quantities_found)


def _of_runs(actuator: Actuator, points: Sequence[Point], alike: Sequence[PreparedRun]) -> list[Known]:
    """What is known of runs that share all parameters: what one of them lasts for, and no peak contradicts."""
    # How long a run lasts from the first edge of its voltage on [s].
    longest = max(float(run.time[-1] - run.time[Checked.of(run).first_edge]) for run in (one.run for one in alike))
    each = [_known_at(point, _AtRecord(actuator, point.problem, alike[0], longest)) for point in points]
    known = []
    for name, one in each[0].items():
        if any(name not in other for other in each):
            continue
        low = min(other[name].interval[0] for other in each)
        high = max(other[name].interval[1] for other in each)
        if not math.isfinite(high - low) or low <= 0.0 <= high:
            continue  # a logarithm that went beyond all numbers, or a gain that may have either sign
        half = 0.5 * (math.log(high / low) if derived(name).positive else (high - low) / abs(one.value))
        # As well as a parameter that is called determined.
        if half <= NORMAL_95 * DETERMINED and not (name == AT_ONCE and _peak_contradicts(points[0], alike, low)):
            known.append(replace(one, interval=(low, high)))
    return known


def _peak_contradicts(point: Point, records: Sequence[PreparedRun], resistance: float) -> bool:
    """Whether the strip drew more current than a circuit whose high-frequency resistance is so high [ohm]."""
    return any(
        largest_current(record, point.of_sensor[record.place])[1] > largest_swing(record.run.voltage) / resistance
        for record in records
        if record.place in point.of_sensor
    )


_Neighbours = tuple[Mapping[str, float], Mapping[str, float], float]
"""The parameters on both sides of one of them, and how far these are apart."""


@dataclass(frozen=True, eq=False)
class _AtRecord:
    """The quantities that one run shows, each on the scale of its errors: a logarithm, or the value itself."""

    actuator: Actuator
    problem: Problem
    record: PreparedRun
    longest: float

    def at(self, theta: FloatArray, **fixed: float) -> Mapping[str, float]:
        """The parameters for a vector, and for other fixed values."""
        return {**self.problem.values(theta, self.record.place), **fixed}

    def quantities(self, points: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
        """Of each of some sets of parameters."""
        read, highest = tuple(self.record.readings), 0.5 * self.record.run.rate
        each = quantities_of_each(self.actuator, points, read, highest, self.longest)
        # A capacitance of rounding alone, a resistance of none: no logarithm.
        return [
            {
                name: math.log(value) if derived(name).positive else value
                for name, value in found.items()
                if math.isfinite(value) and (value > 0.0 or not derived(name).positive)
            }
            for found in each
        ]

    def along(self, theta: FloatArray, entry: int) -> _Neighbours:
        """On both sides of an entry, no farther than its bounds."""
        unknown = self.problem.unknowns[entry]
        ends = [unknown.entry(unknown.value(float(theta[entry]) + step)) for step in (-_STEP, _STEP)]
        below, above = (self.at(np.where(np.arange(len(theta)) == entry, end, theta)) for end in ends)
        return below, above, ends[1] - ends[0]

    def along_fixed(self, theta: FloatArray, name: str, value: float, variance: float) -> _Neighbours:
        """On both sides of a fixed value [1/SI]; above one that is 0."""
        step = _STEP * (abs(value) or math.sqrt(variance))
        ends = value - step if value else 0.0, value + step
        below, above = (self.at(theta, **{name: end}) for end in ends)
        return below, above, ends[1] - ends[0]


def _known_at(point: Point, at_record: _AtRecord) -> dict[str, Known]:
    """Each quantity of one run that moves with what is free, and with nothing about which the readings say nothing."""
    problem, found, theta = point.problem, point.found, point.theta
    base = problem.values(theta, at_record.record.place)
    stated = [name for name in point.stated if name in base]
    exact = [name for name in found.leverage if name not in point.stated and base.get(name)]
    held = (*stated, *exact)
    moved = [at_record.along(theta, place) for place, _ in problem.asked]
    variances = [point.stated[name][name] if name in stated else 0.0 for name in held]
    fixed = [at_record.along_fixed(theta, name, base[name], one) for name, one in zip(held, variances, strict=True)]
    neighbours = [*moved, *fixed]
    others = [rival.vector_of(problem.unknowns, theta) for rival in point.rivals]
    there = [base, *(at_record.at(one) for one in (*others, *point.ends))]
    every = at_record.quantities([*there, *(side for below, above, _ in neighbours for side in (below, above))])
    here, *elsewhere = every[: len(there)]
    sides = every[len(there) :]
    # None of one that does not exist on both sides, or where these are one.
    slopes = [
        {name: (above[name] - value) / width for name, value in below.items() if name in above and width}
        for (_, _, width), below, above in zip(neighbours, sides[::2], sides[1::2], strict=True)
    ]
    own, of_held = slopes[: len(moved)], slopes[len(moved) :]
    follows = np.array([found.slopes[name] for name in held]).reshape(len(held), len(own))
    together = matrix_of(point.stated, stated)
    quantities_found = {}
    for name, value in here.items():
        scale = 1.0 if derived(name).positive else max(abs(value), 1e-300)
        numbers = [one.get(name, math.nan) for one in (*own, *of_held, *elsewhere)]
        if not all(map(math.isfinite, numbers)):
            continue
        free, direct = np.array(numbers[: len(own)]), np.array(numbers[len(own) : len(slopes)])
        also = numbers[len(slopes) :]
        if np.all(np.abs(free) <= _ROUNDING * scale) or np.any(np.abs(found.null @ free) > MOVED * scale):
            continue
        of_stated = direct[: len(stated)]
        crossed = 2.0 * float(free @ follows[: len(stated)].T @ together @ of_stated)
        variance = float(free @ found.covariance @ free) + crossed + float(of_stated @ together @ of_stated)
        freedom = float(np.min(found.freedom[np.abs(free) > MOVED * scale], initial=math.inf))
        few = wider_for_few(freedom) if math.isfinite(freedom) else 1.0
        reach = NORMAL_95 * few * math.sqrt(max(variance, 0.0))
        moves = np.abs(follows @ free + direct)[len(stated) :] * [0.01 * abs(base[name]) for name in exact]
        affected = moves > max(reach, MOVED * scale)
        leans = tuple(exact[k] for k in largest_first(moves) if affected[k]) if affected.any() else ()
        as_good, ends = [value, *also[: len(others)]], also[len(others) :]
        low, high = min(min(as_good) - reach, *ends, value), max(max(as_good) + reach, *ends, value)
        quantities_found[name] = Known(name, _value(name, value), (_value(name, low), _value(name, high)), leans)
    return quantities_found


def _value(name: str, on_scale: float) -> float:
    return math.exp(min(on_scale, 700.0)) if derived(name).positive else on_scale
