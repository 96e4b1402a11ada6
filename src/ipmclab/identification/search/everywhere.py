"""A problem searched again from wherever earlier searches ended: under its noise, with the zeros of its sensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ipmclab.identification.problem.problem import Problem
from ipmclab.identification.search.descent import SHORTLY, minimum, minimum_from, to_the_end, weigh
from ipmclab.identification.search.solve import Solution
from ipmclab.identification.search.valleys import Rival
from ipmclab.model.declared import MOTION, declaration_of, in_group
from ipmclab.model.stages.coupling import GAIN
from ipmclab.run import FloatArray


class Everywhere:
    """Searches from near a fit and from elsewhere, and where they have ended.

    Parameters
    ----------
    ends : sequence of Rival
        Where the searches of the fit ended, if it may have several minima.
    """

    def __init__(self, ends: Sequence[Rival]) -> None:
        self._ends = ends
        self._found: list[tuple[Problem, list[Rival]]] = []

    def lowest(self, problem: Problem, near: Solution) -> tuple[Problem, Solution]:
        """The lowest minimum of a problem near one that was searched before, and from where those searches ended."""
        first = minimum_from(problem, near)
        starts = [end.vector_of(problem.unknowns, near.theta) for end in self._starts(problem, near)]
        tried = [(problem, first), *((problem, minimum(problem, start, evaluations=SHORTLY)) for start in starts)]
        if starts:
            tried = to_the_end(tried)
            self._found.append((problem, [Rival.of(problem, found.theta) for _, found in tried]))
        return tried[0]

    def least(self, problem: Problem, near: Solution) -> tuple[Problem, Solution]:
        """Least squares with zeros and slopes: without them the lowest minimum may be one that follows the drift."""
        return weigh(*self.lowest(problem, near))

    def ended(self, problem: Problem, near: Solution) -> tuple[Sequence[Rival], bool]:
        """Where searches ended that may be other minima of a problem, and whether they were searches of this one."""
        names = [unknown.name for unknown in problem.unknowns]
        for searched, found in reversed(self._found):
            if type(searched) is type(problem) and [unknown.name for unknown in searched.unknowns] == names:
                return found, True
        return self._starts(problem, near), False

    def _starts(self, problem: Problem, near: Solution) -> list[Rival]:
        """The ends, and where a search from a usual strip would begin, where there may be several minima."""
        theta = _usual_coupling(problem, near.theta) if self._ends else None
        return list(self._ends) if theta is None else [*self._ends, Rival.of(problem, theta)]


def _usual_coupling(problem: Problem, near: FloatArray) -> FloatArray | None:
    """The coupling of a usual strip, with the gain that these readings ask for; None where no coupling is free.

    ``near`` gives all else.
    """
    of_coupling = [place for place, one in enumerate(problem.unknowns) if in_group(MOTION, [one.base])]
    if not of_coupling:
        return None
    theta, gain = near.copy(), None
    for place in of_coupling:
        unknown = problem.unknowns[place]
        declared = declaration_of(unknown.base)
        if declared is not None and declared.usual is not None:
            theta[place] = unknown.entry(unknown.inside(declared.usual))
            gain = place if unknown.base == GAIN else gain
    if gain is not None:
        here = problem.evaluate(theta)
        # Motion is in proportion to the gain: its derivative by the logarithm is the motion itself.
        motion = here.jacobian[:, gain]
        factor = float(motion @ (motion - here.residual)) / max(float(motion @ motion), 1e-300)
        theta[gain] += np.log(factor) if factor > 0.0 else 0.0
    return theta
