"""What else the readings allow where a stage that does not show is there all the same."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.noise.unseen import Unseen
from ipmclab.identification.problem.unknowns import Unknown
from ipmclab.identification.search.descent import minimum_near, shorter
from ipmclab.identification.search.valleys import SURE, Rival
from ipmclab.identification.uncertainty.profile import Walk
from ipmclab.model.declared import declaration_of
from ipmclab.model.kinds import kind_of

_LITTLE: Final = 1e-3  # of a usual size: where the way begins


def with_usual_stages(under: Correlated, unseen: Sequence[Unseen], without: Rival) -> Iterator[Rival]:
    """For each stage that was left out, the fit with as much of it as the readings allow (95 %), of the usual shape.

    The fit in which it was free tells little of that: where a stage does not show its shape is whatever noise made of
    it. One step above the threshold of a leak is met as well whatever part of the direct current leaks: the dc
    resistivity is then not known. A stage of several sizes, as one in each run, gives a fit for the most of each; the
    others are free beside it.

    Parameters
    ----------
    under : Correlated
        The fit that still had the stages.
    unseen : sequence of Unseen
    without : Rival
        The fit that has none of them.
    """
    off = {name: value for one in unseen for name, value in one.off.items()}
    gone = {unknown.name for one in unseen for unknown in one.unknowns}
    for one in unseen:
        sizes = {unknown.name: unknown for unknown in one.unknowns if _is_size(unknown, one)}
        shape = {unknown.base: _usual(unknown) for unknown in one.unknowns if unknown.name not in sizes}
        columns = [k for k, unknown in enumerate(under.problem.unknowns) if unknown.name in gone - sizes.keys()]
        problem = under.problem.without(columns, off | shape)
        places = [k for k, unknown in enumerate(problem.unknowns) if unknown.name in sizes]
        if not places:
            continue
        theta = without.vector_of(problem.unknowns, np.delete(under.solution.theta, columns))
        for place in places:
            size = problem.unknowns[place]
            theta[place] = max(float(problem.lower[place]), size.entry(_LITTLE * _usual(size)))
        least = minimum_near(problem, np.clip(theta, problem.lower, problem.upper))
        variance = least.evaluation.cost / max(len(least.evaluation.residual) - len(theta), 1)
        for place in places:
            walk = Walk(*shorter(problem, least), place, 1.0, farthest=math.inf)
            yield Rival.of(problem, walk.end(walk.distance(math.sqrt(SURE * variance))))


def _is_size(unknown: Unknown, one: Unseen) -> bool:
    """Whether an unknown is a size of the stage itself, and not of one that follows it."""
    kind = kind_of(unknown.base)
    if kind is None or kind is not kind_of(one.unknowns[0].base):
        return False
    return kind.ending(unknown.base) in kind.off and _usual(unknown) > 0.0


def _usual(unknown: Unknown) -> float:
    declared = declaration_of(unknown.base)
    return 0.0 if declared is None else declared.usual or 0.0
