"""On along the valley in which a search has come to its limit of evaluations."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from ipmclab.identification.problem.evaluation import Solvable
from ipmclab.identification.search.solve import HARDLY_FALLS, Pinned, Solution, descend, farthest
from ipmclab.identification.search.tangent import with_others
from ipmclab.identification.search.valleys import EVALUATIONS, NEAR
from ipmclab.run import FloatArray

_LONGER: Final = 2.0  # times a leap that went down (convention)
_SHORTER: Final = 0.25  # times one that did not (convention)
_SHORTEST: Final = 0.01  # of a logarithm or a scale


def led_on(problem: Solvable, begun: FloatArray, found: Solution) -> Solution:
    """Where the valley leads along which a search has crept, not converged.

    Where a valley is bent, the steps of a trust region are as short as its floor is narrow: hundreds of them for one
    factor of e. With one entry held the others come to the floor within few evaluations from much farther away. So the
    entry that the search has moved the most goes on by leaps, the first as long as its whole way: a leap that goes
    down is followed by a longer one, one that does not by a shorter one. They end where a leap changes chi-square by
    less than readings tell (Hooke and Jeeves, J. ACM 8, 1961, 212, lead a search on by such a pattern of its steps).

    Parameters
    ----------
    problem : Solvable
    begun : float array, shape (n_unknown,)
        Where the search began.
    found : Solution
        Where it has ended.

    Returns
    -------
    Solution
        The lowest point that was found. ``evaluations`` counts those of the search too.
    """
    reach = farthest(problem)
    way = np.where(np.isfinite(reach) & ~problem.linear, found.theta - begun, 0.0)
    place = int(np.argmax(np.abs(way)))
    leap, lowest, spent = float(way[place]), found, found.evaluations
    while abs(leap) > _SHORTEST:
        own = float(lowest.theta[place])
        entry = float(np.clip(own + leap, problem.lower[place], problem.upper[place]))
        pinned = Pinned(problem, place, entry)
        step, _ = with_others(lowest.evaluation, [place], [entry - own])
        begin = np.clip(lowest.theta + step, problem.lower, problem.upper)
        others = descend(pinned, np.delete(begin, place), evaluations=EVALUATIONS, tolerance=NEAR)
        spent += others.evaluations
        fallen = lowest.evaluation.cost - others.evaluation.cost
        leap *= _LONGER if fallen > 0.0 else _SHORTER
        leap = math.copysign(min(abs(leap), float(reach[place])), leap)
        if fallen > 0.0:
            lowest = pinned.in_full(others)
        if abs(fallen) < HARDLY_FALLS * lowest.evaluation.per_residual:
            break
    return replace(lowest, converged=False, message=found.message, evaluations=spent)
