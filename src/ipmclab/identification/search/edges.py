"""Edges of foreign records between other rows, which no step of a search reaches: at a row the current jumps."""

from __future__ import annotations

from typing import Final

import numpy as np

from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.search.descent import SHORTLY, minimum, to_the_end
from ipmclab.identification.search.searched_run import moves_of_rows
from ipmclab.identification.search.solve import Solution

_LOWER: Final = 1e-3  # of chi-square


def between_other_rows(problem: Problem, solution: Solution) -> list[Solution]:
    """The fit and others with the edges of one record, or of all, a row earlier or later, the lowest first.

    Poles and residues have said between which rows edges lie, by circuits of which some cannot exist. Those that can
    are asked here; from a lower minimum all again.
    """
    edges = [
        column
        for column, unknown in enumerate(problem.unknowns)
        if unknown.base == "observation.delay" and "current" in problem.record_at(int(unknown.place or 0)).readings
    ]
    found = [solution]
    asked: set[tuple[float, ...]] = set()
    while edges:
        best = found[0]
        rows = np.ceil(best.theta[edges])
        asked.add(tuple(rows))
        beside = []
        for moved in moves_of_rows(rows):
            if tuple(moved) in asked:
                continue
            asked.add(tuple(moved))
            theta = best.theta.copy()
            theta[edges] = np.where(moved == rows, theta[edges], moved - 0.5)
            beside.append((problem, minimum(problem, theta, evaluations=SHORTLY)))
        found = [one for _, one in to_the_end([*((problem, one) for one in found), *beside])]
        if not found[0].evaluation.cost < best.evaluation.cost - _LOWER:
            break
    return found
