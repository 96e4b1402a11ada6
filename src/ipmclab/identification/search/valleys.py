"""Other fits that are as good: what a search hands on of the minima and valleys that it found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.identification.search.solve import Solution
from ipmclab.model.order import Order, exchangeable
from ipmclab.run import FloatArray

AS_GOOD: Final = 4.0
"""Of chi-square: a minimum no higher than that is as good."""

SURE: Final = 3.84
"""Excess of chi-square of one parameter that 95 % of fits stay below."""

SURELY_SOMEWHERE: Final = 7.88
"""The same for a branch that may not show at all. Then it stands where noise looks most like one, of about ten places
between a row and a record that know nothing of each other: the excess that 99.5 % stay below at each."""

WEAK: Final = 0.2
"""Standard error of a logarithm from which a parameter may as well be elsewhere."""

EVALUATIONS: Final = 25
"""Runs of the model that the search at one place of a valley may take."""

NEAR: Final = 1e-7
"""Part of the cost to which it goes: beside a threshold of 4 of chi-square nothing."""

_ALIKE: Final = 1.001  # ratio of weights
_LEVEL: Final = 1e-6  # of the cost, by which two ends of the same valley may differ


@dataclass(frozen=True, eq=False)
class Place:
    """The best fit with something held, the parts of all entries' errors there, and the excess that is allowed.

    Where that is the time constant of a branch, ``branch`` is its number.
    """

    solution: Solution
    errors: FloatArray
    allowed: float = SURE
    branch: int | None = None


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

    def vector_of(self, unknowns: Sequence[Unknown], own: FloatArray) -> FloatArray:
        """Its entries of some unknowns, which may be others too; theirs are taken from ``own``."""
        pairs = zip(unknowns, own, strict=True)
        return np.array([self.entries.get(unknown.name, entry) for unknown, entry in pairs], dtype=np.float64)

    def sorted_as(self, problem: Problem, reference: Mapping[str, float]) -> Rival:
        """With branches and modes named as at other values: the fastest that is free is the fastest there."""
        unknowns = {unknown.name: unknown for unknown in problem.unknowns}
        values = dict(problem.base)
        for name, entry in self.entries.items():
            if name in unknowns:
                values[unknowns[name].base] = unknowns[name].value(entry)
        called = {name: name for name in self.entries}
        for group in exchangeable(self.entries):
            own, there = Order(values, group), Order(reference, group)
            back = {there(name): name for name in group}
            called |= {name: back[own(name)] for name in group}
        return Rival(
            {called[name]: entry for name, entry in self.entries.items()},
            {called[name]: reach for name, reach in self.reach.items()},
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

    def with_branch_held(self, problem: Problem, own: FloatArray) -> list[tuple[int, FloatArray]]:
        """Of the places with the time constant of a branch held: its number, and the vector of another problem there.

        Entries that this one has not are taken from ``own``.
        """
        return [
            (place.branch, Rival.of(self.problem, place.solution.theta).vector_of(problem.unknowns, own))
            for place in self.places
            if place.branch is not None
        ]

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
                errors=place.errors * [[times[0]], [1.0]],  # what was known beforehand has weights of its own
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
