"""Other fits that are as good: a branch of which a record shows little, with its time constant held elsewhere.

A record that shows two branches of three says little of where the third one is: it may be slower than the record is
long, faster than its rows, or beside another. At any one of these places the curvature shows the other branches as
known that are not. So the weakest branch's time constant is walked from the fastest to the slowest that could show, all
else is fitted again at each place, and what is known of a parameter reaches over all places that the readings allow
(the profile of the likelihood along that time constant).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.identification.problem.order import Order
from ipmclab.identification.problem.problem import Evaluation, Problem
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.identification.search.solve import Solution, Solvable, entry_errors, minimise
from ipmclab.model.stages.circuit import Circuit

FloatArray = npt.NDArray[np.float64]

SURE: Final = 3.84
"""Excess of chi-square of one parameter that 95 % of fits stay below."""

SURELY_SOMEWHERE: Final = 7.88
"""The same for a branch that may not show at all. Then it stands where noise looks most like one, of about ten places
between a row and a record that know nothing of each other: the excess that 99.5 % stay below at each."""

EVALUATIONS: Final = 25
"""Runs of the model that the search at one place of a valley may take."""

NEAR: Final = 1e-7
"""Part of the cost to which it goes: beside a threshold of 4 of chi-square nothing."""

_ALIKE: Final = 1.001  # ratio of weights
_LEVEL: Final = 1e-6  # of the cost, by which two ends of the same valley may differ
_WEAK: Final = 0.2  # standard error of a logarithm from which a branch may as well be elsewhere
_FASTEST: Final = 0.3  # rows
_SLOWEST: Final = 30.0  # records
_STEP: Final = 0.8  # between the logarithms of neighbouring time constants
_SHARES: Final = (0.2,)  # of the steady current that the branch is given to begin with


@dataclass(frozen=True, eq=False)
class Place:
    """The best fit with something held, the standard errors of all entries there, and the excess that is allowed."""

    solution: Solution
    errors: FloatArray
    allowed: float = SURE


@dataclass(frozen=True)
class Rival:
    """Another fit that the readings do not tell from the best one.

    Parameters
    ----------
    entries : mapping of name to float
        The vector there.
    reach : mapping of name to float
        How far each entry may still move there while the readings allow it; 0 where that was not asked.
    """

    entries: Mapping[str, float]
    reach: Mapping[str, float]

    @classmethod
    def of(cls, problem: Problem, theta: FloatArray, reach: FloatArray | None = None) -> Rival:
        """From a vector, and how far each entry may still move."""
        names = [unknown.name for unknown in problem.unknowns]
        known = np.zeros(len(names)) if reach is None else reach
        return cls(dict(zip(names, map(float, theta), strict=True)), dict(zip(names, map(float, known), strict=True)))

    @classmethod
    def at(cls, problem: Problem, place: Place, least: float, variance: float) -> Rival | None:
        """From a place, or None where the readings do not allow it.

        Parameters
        ----------
        problem : Problem
        place : Place
        least : float
            Cost of the best fit.
        variance : float
            Cost of one reading: 1 where the noise is as it was taken to be.
        """
        variance = max(variance, 1e-300)  # what is open stays open, however well all readings are met
        left = place.allowed - max(place.solution.evaluation.cost - least, 0.0) / variance
        if left < 0.0:
            return None
        # Within a place 95 % of its own, less towards the last one that is allowed.
        reach = place.errors * np.sqrt(variance * min(left, SURE)) if left > 0.0 else None
        return cls.of(problem, place.solution.theta, reach)

    def vector_of(self, unknowns: Sequence[Unknown], own: FloatArray) -> FloatArray:
        """Its entries of some unknowns, which may be others too; theirs are taken from ``own``."""
        pairs = zip(unknowns, own, strict=True)
        return np.array([self.entries.get(unknown.name, entry) for unknown, entry in pairs], dtype=np.float64)

    def sorted_as(self, problem: Problem, order: Order) -> Rival:
        """With branches and modes named as they stand in another order: the fastest is the fastest there."""
        unknowns = {unknown.name: unknown for unknown in problem.unknowns}
        values = dict(problem.base)
        for name, entry in self.entries.items():
            if name in unknowns:
                values[unknowns[name].base] = unknowns[name].value(entry)
        own = Order(values)
        back = {order(name): name for name in self.entries}
        return Rival(
            {back[own(name)]: entry for name, entry in self.entries.items()},
            {back[own(name)]: reach for name, reach in self.reach.items()},
        )


@dataclass(frozen=True, eq=False)
class Valley:
    """Places along the valleys of a minimum.

    Parameters
    ----------
    problem : Problem
    solution : Solution
        The minimum.
    places : tuple of Place
    """

    problem: Problem
    solution: Solution
    places: tuple[Place, ...]

    def under(self, problem: Problem, solution: Solution) -> tuple[Place, ...] | None:
        """The same places where a problem is the same but for one factor of all weights; None where it is another."""
        own = self.problem
        names = [[unknown.name for unknown in one.unknowns] for one in (own, problem)]
        if type(problem) is not type(own) or names[0] != names[1] or problem.noise.keys() != own.noise.keys():
            return None
        times = [noise / own.noise[key] for key, noise in problem.noise.items()]
        cost = times[0] ** 2 * solution.evaluation.cost
        if max(times) > _ALIKE * min(times) or abs(cost - self.solution.evaluation.cost) > _LEVEL * cost:
            return None
        return tuple(
            replace(
                place,
                solution=replace(place.solution, evaluation=problem.evaluate(place.solution.theta)),
                errors=times[0] * place.errors,
            )
            for place in self.places
        )


@dataclass(frozen=True)
class Minima:
    """The minima beside the lowest one.

    Parameters
    ----------
    rivals : tuple of Rival
        Those that are as good.
    along : tuple of Rival
        Places along the valleys of the lowest one that the readings allow.
    ends : tuple of Rival
        Where all searches ended, the lowest too, where there may be several minima.
    valley : Valley
        All places along the valleys of the lowest one.
    """

    rivals: tuple[Rival, ...]
    along: tuple[Rival, ...]
    ends: tuple[Rival, ...]
    valley: Valley


class Tied:
    """A problem in which the sum of two entries is held: of logarithms, the product of two values."""

    def __init__(self, problem: Solvable, free: int, tied: int, total: float) -> None:
        self._problem, self._free, self._tied, self._total = problem, free, tied, total
        lower, upper = problem.lower.copy(), problem.upper.copy()
        lower[free] = max(lower[free], total - upper[tied])
        upper[free] = min(upper[free], total - lower[tied])
        self.lower, self.upper = np.delete(lower, tied), np.delete(upper, tied)

    def full(self, theta: FloatArray) -> FloatArray:
        """The vector of the whole problem."""
        found = np.insert(theta, self._tied, 0.0)
        found[self._tied] = self._total - found[self._free]
        return found

    def evaluate(self, theta: FloatArray) -> Evaluation:
        """Residuals and Jacobian of the others."""
        whole = self._problem.evaluate(self.full(theta))
        rows = np.delete(whole.rows, self._tied, axis=0)
        rows[self._free - (self._free > self._tied)] -= whole.rows[self._tied]
        return Evaluation(rows, whole.beforehand)

    def errors(self, there: Solution) -> FloatArray:
        """Standard error of each entry of the whole problem at a minimum of this one."""
        found = np.insert(entry_errors(there.evaluation), self._tied, 0.0)
        found[self._tied] = found[self._free]
        return found


def branch_valley(problem: Problem, solution: Solution) -> list[Place]:
    """The best fits with the weakest branch elsewhere.

    Empty where every branch is well known, or where its parameters are not all free and shared.
    """
    place = _weakest(problem, solution)
    if place is None:
        return []
    resistivity, permittivity = place
    names = [unknown.name for unknown in problem.unknowns]
    values = problem.values(solution.theta, problem.records[0].place)
    # The time constant is the product of resistivity and permittivity, over the square of the thickness of one face.
    unit = _seconds(values)
    periods = [record.period for record in problem.records]
    spans = [float(record.run.time[-1] - record.run.time[0]) for record in problem.records]
    fastest, slowest = np.log(_FASTEST * min(periods) / unit), np.log(_SLOWEST * max(spans) / unit)
    dc = names.index("circuit.dc_resistivity") if "circuit.dc_resistivity" in names else None
    middle = float(np.clip(solution.theta[resistivity] + solution.theta[permittivity], fastest, slowest))
    # From where it is outwards, each place from the fit beside it.
    slower = np.arange(middle, slowest + _STEP, _STEP)
    faster = np.arange(middle - _STEP, fastest - _STEP, -_STEP)
    found = []
    for totals in (slower, faster):
        warm = solution.theta
        for total in totals:
            tied = Tied(problem.on_means or problem, resistivity, permittivity, float(total))
            best: Solution | None = None
            for start in _starts(warm, solution.theta, resistivity, dc, values):
                one = minimise(tied, np.delete(start, permittivity), evaluations=EVALUATIONS, tolerance=NEAR)
                if best is None or one.evaluation.cost < best.evaluation.cost:
                    best = one
            assert best is not None
            warm = tied.full(best.theta)
            whole = replace(best, theta=warm, evaluation=problem.evaluate(warm))
            found.append(Place(whole, tied.errors(best), SURELY_SOMEWHERE))
    return found


def _starts(
    warm: FloatArray, first: FloatArray, resistivity: int, dc: int | None, values: Mapping[str, float]
) -> list[FloatArray]:
    """From the fit beside, and with some of the steady current given to the branch."""
    starts = [warm]
    for share in _SHARES:
        start = first.copy()
        start[resistivity] = np.log(values["circuit.dc_resistivity"] / share)
        if dc is not None:
            start[dc] = np.log(values["circuit.dc_resistivity"] / (1.0 - share))
        starts.append(start)
    return starts


def _seconds(values: Mapping[str, float]) -> float:
    """Seconds of a branch whose resistivity and permittivity are one."""

    parts = Circuit(1).elements(
        {**values, "circuit.branches.0.resistivity": 1.0, "circuit.branches.0.permittivity": 1.0}
    )
    return float(np.real(parts.branch_resistances[0] * parts.branch_capacitances[0]))


def _weakest(problem: Problem, solution: Solution) -> tuple[int, int] | None:
    """Entries of the branch of which least is known, where that is little."""
    names = [unknown.name for unknown in problem.unknowns]
    errors = entry_errors(solution.evaluation)
    found: tuple[float, tuple[int, int]] | None = None
    number = 0
    while f"circuit.branches.{number}.resistivity" in names:
        pair = f"circuit.branches.{number}.resistivity", f"circuit.branches.{number}.permittivity"
        number += 1
        if pair[1] not in names:
            continue
        places = names.index(pair[0]), names.index(pair[1])
        error = float(max(errors[places[0]], errors[places[1]]))
        if error > _WEAK and (found is None or error > found[0]):
            found = error, places
    return None if found is None or number < 2 else found[1]
