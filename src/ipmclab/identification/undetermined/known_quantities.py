"""What the readings determine, beside the parameters that they leave open: each with its interval.

A quantity g of the parameters has, to first order, the variance of its gradient under their covariance, on the scale of
its logarithm where it cannot be negative. It is said to be known only where no direction about which the readings say
nothing moves it, where other fits as good agree on it, and where its error is that of a parameter that is determined.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.confidence import NORMAL_95, wider_for_few
from ipmclab.fit.fit import DETERMINED
from ipmclab.fit.known import Known
from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.record import PreparedRun
from ipmclab.identification.search.valleys import Rival
from ipmclab.identification.uncertainty.covariance import Uncertainty
from ipmclab.model import Actuator
from ipmclab.model.quantities import derived, quantities_of
from ipmclab.ties import largest_first

FloatArray = npt.NDArray[np.float64]

_STEP: Final = 1e-4  # of an entry, for a derivative: entries are logarithms, or of order one
_FELT: Final = 1e-6  # part of a quantity that moves with an entry: less is rounding
_MOVED: Final = 1e-3  # the same along a direction about which the readings say nothing
_SAME: Final = 1e-9


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
    """

    problem: Problem
    theta: FloatArray
    found: Uncertainty
    stated: Mapping[str, Mapping[str, float]]
    rivals: Sequence[Rival] = ()


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
    found: dict[str, list[Known]] = {}
    for record in points[0].problem.records:
        for one in _of_run(actuator, points, record):
            found.setdefault(one.name, []).append(one)
    told = []
    for name, several in found.items():
        first = several[0].value
        if all(abs(one.value - first) <= _SAME * abs(first) for one in several):
            told.append(several[0])
        else:
            told += [replace(one, name=f"{name}[{place}]") for place, one in enumerate(several)]
    return tuple(told)


def _of_run(actuator: Actuator, points: Sequence[Point], record: PreparedRun) -> list[Known]:
    """What is known of one run: its own parameters are in it."""
    highest = 0.5 * record.run.rate
    outputs = tuple(record.readings)
    each = [_intervals(actuator, point, record.place, outputs, highest) for point in points]
    known = []
    for name, one in each[0].items():
        if any(name not in other for other in each):
            continue
        low = min(other[name].interval[0] for other in each)
        high = max(other[name].interval[1] for other in each)
        if _is_narrow(name, one.value, low, high):
            known.append(replace(one, interval=(low, high)))
    return known


def _is_narrow(name: str, value: float, low: float, high: float) -> bool:
    """Whether it is known as well as a parameter that is called determined."""
    if value == 0.0 or not math.isfinite(high - low) or (derived(name).positive and low <= 0.0):
        return False  # a logarithm that went beyond all numbers
    half = 0.5 * (math.log(high / low) if derived(name).positive else (high - low) / abs(value))
    return half <= NORMAL_95 * DETERMINED


def _intervals(
    actuator: Actuator, point: Point, place: int, outputs: Sequence[str], highest: float
) -> dict[str, Known]:
    """Each quantity of one run that moves with what is free, and with nothing about which the readings say nothing."""
    problem, found = point.problem, point.found
    asked = [number for number, unknown in enumerate(problem.unknowns) if not unknown.nuisance]

    def at(theta: FloatArray, **fixed: float) -> dict[str, float]:
        values = {**problem.values(theta, place), **fixed}
        strip = Actuator(actuator.name, {name: values[name] for name in actuator.parameter_values})
        told = quantities_of(strip, outputs, highest)
        # A capacitance of rounding alone, a resistance of none: no logarithm.
        return {
            name: _on_scale(name, value)
            for name, value in told.items()
            if math.isfinite(value) and (value > 0.0 or not derived(name).positive)
        }

    def moved(entry: int, by: float) -> FloatArray:
        theta = point.theta.copy()
        theta[entry] += by
        return theta

    base = problem.values(point.theta, place)
    here = at(point.theta)
    columns = [(at(moved(entry, _STEP)), at(moved(entry, -_STEP)), 2.0 * _STEP) for entry in asked]
    held = [name for name in point.stated if base.get(name)]
    exact = [name for name in found.leverage if name not in point.stated and base.get(name)]
    columns += [
        (at(point.theta, **{name: base[name] + step}), at(point.theta, **{name: base[name] - step}), 2.0 * step)
        for name in (*held, *exact)
        for step in [_STEP * abs(base[name])]
    ]
    others = [at(_vector(problem, point.theta, rival)) for rival in point.rivals]
    every = [here, *others, *(side for above, below, _ in columns for side in (above, below))]
    # A leverage is the change of each entry for 1 % of a fixed value.
    sizes = np.array([abs(base[name]) for name in (*held, *exact)])
    slopes = np.array([found.leverage[name] / (0.01 * abs(base[name])) for name in (*held, *exact)])
    slopes = slopes.reshape(len(sizes), len(asked))
    together = np.array([[point.stated[one][other] for other in held] for one in held]).reshape(len(held), len(held))
    told = {}
    for name, value in here.items():
        if any(name not in one for one in every):
            continue
        scale = 1.0 if derived(name).positive else max(abs(value), 1e-300)
        slope = np.array([(above[name] - below[name]) / width for above, below, width in columns])
        free, direct = slope[: len(asked)], slope[len(asked) :]
        if np.all(np.abs(free) <= _FELT * scale) or np.any(np.abs(found.null @ free) > _MOVED * scale):
            continue
        stated = direct[: len(held)]
        crossed = 2.0 * float(free @ slopes[: len(held)].T @ together @ stated)
        variance = float(free @ found.covariance @ free) + crossed + float(stated @ together @ stated)
        freedom = float(np.min(found.freedom[np.abs(free) > _MOVED * scale], initial=math.inf))
        few = wider_for_few(freedom) if math.isfinite(freedom) else 1.0
        reach = NORMAL_95 * few * math.sqrt(max(variance, 0.0))
        each = [value, *(one[name] for one in others)]
        ends = _off_scale(name, min(each) - reach), _off_scale(name, max(each) + reach)
        moves = np.abs(0.01 * sizes * (slopes @ free + direct))[len(held) :]
        leans = [exact[k] for k in largest_first(moves) if moves[k] > max(reach, _MOVED * scale)]
        told[name] = Known(name, _off_scale(name, value), ends, tuple(leans))
    return told


def _vector(problem: Problem, theta: FloatArray, rival: Rival) -> FloatArray:
    """Another fit as a vector; what it does not speak of stays."""
    pairs = zip(problem.unknowns, theta, strict=True)
    return np.array([rival.entries.get(unknown.name, float(entry)) for unknown, entry in pairs])


def _on_scale(name: str, value: float) -> float:
    return math.log(value) if derived(name).positive else value


def _off_scale(name: str, value: float) -> float:
    return math.exp(min(value, 700.0)) if derived(name).positive else value
