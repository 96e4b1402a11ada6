"""Readings weighted by their noise, where that costs the prediction nothing.

Under noise that is not white, least squares is not the sharpest estimate; under a random walk it is a poor one. Weights
from the noise would be, if the model were right. But what a wrong model leaves looks like such noise too, and under
weights made of it the parameters go where it is left. Three questions tell them apart. The rows at 0 V hold the noise
and nothing else: what is found under voltage must not be larger there, and a walk must show there, since one that is
too slow to show describes whatever the model lacks. Least squares must lose no more at the weighted estimate than such
noise moves it (Hausman 1978). And the prediction must stay as good. Where it does not, or the rows at 0 V are too few
to say, nobody can tell which of both is the strip: least squares is the answer, and the other a fit as good.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ipmclab.confidence import REJECT
from ipmclab.identification.noise.at_rest import is_shown_at_rest
from ipmclab.identification.noise.correlate import Again, Correlated
from ipmclab.identification.noise.pieces import Key, System, refine_noise
from ipmclab.identification.noise.whitening import CorrelatedProblem
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.search.descent import minimum_from
from ipmclab.identification.search.settled import settled

_TURNS: Final = 4  # of noise and parameters
_STILL: Final = 0.1  # of a standard error, by which the parameters still move
_AS_GOOD: Final = 1.1  # times what least squares leaves (rms), as of a prediction; walks of a laser reach 1.09


def weighted(least: Correlated, everywhere: Again) -> tuple[Correlated, Correlated | None]:
    """The fit under its noise, where that predicts as well as least squares; and the other one where nobody can tell.

    Parameters
    ----------
    least : Correlated
        Of least squares.
    everywhere : function of (Problem, Solution)
        The minimum of a problem, from near it and from elsewhere.

    Returns
    -------
    taken : Correlated
    other : Correlated or None
        The weighted fit, where it was not taken and the readings do not speak against it.
    """
    coloured = [key for key, shape in least.shapes.items() if shape.terms.order or shape.terms.walk]
    if not coloured or _are_at_rest_too(least, coloured) is False:
        return least, None
    # What the readings refuse near least squares needs no search for a lower minimum of it.
    for search in (None, everywhere):
        here = _fitted(least, search)
        shown = _are_at_rest_too(here, coloured)
        there = least.problem.evaluate(here.solution.theta)
        if shown is False or not _is_moved_by_noise(least, there):
            return least, None
    as_good = there.cost <= _AS_GOOD**2 * least.solution.evaluation.cost
    return (here, None) if shown and as_good else (least, here)


def _is_moved_by_noise(least: Correlated, there: Evaluation) -> bool:
    """Whether least squares loses no more at another estimate than the noise moves its own."""
    from scipy.special import chdtri

    times = least.inflation(there.residual - least.solution.evaluation.residual)
    return there.cost - least.solution.evaluation.cost <= float(chdtri(len(there.rows) - 1, REJECT)) * times


def _fitted(least: Correlated, everywhere: Again | None) -> Correlated:
    """Noise and parameters by turns, until both stay; all minima are asked under the first noise, or the nearest."""
    here, shapes = least, dict(least.shapes)
    pieces = {key: piece for key, piece in least.pieces.items() if key in shapes}
    for turn in range(_TURNS):
        whitenings = {key: piece.whitening(shapes[key]) for key, piece in pieces.items()}
        problem = CorrelatedProblem(here.problem.plain, whitenings)
        near = replace(here.solution, evaluation=problem.changed(here.plain))
        solution = minimum_from(problem, near) if turn or everywhere is None else everywhere(problem, near)[1]
        # In standard errors.
        moved = np.linalg.norm(solution.evaluation.triangle[:, :-1] @ (solution.theta - here.solution.theta))
        here = replace(here, problem=problem, solution=solution, plain=problem.plain.evaluate(solution.theta))
        if (turn and moved < _STILL) or turn == _TURNS - 1:
            break
        shapes = refine_noise(System(problem.plain, here.plain, list(pieces.values())), shapes)
        here = replace(here, shapes=shapes)
    return here.at(settled(here.problem, here.solution))


def _are_at_rest_too(under: Correlated, coloured: Sequence[Key]) -> bool | None:
    """Whether the rows at 0 V have these noises; None where they do not say so."""
    noises = {key: under.resting(key) for key in coloured}
    sized = {key: noise.is_at_rest_too for key, noise in noises.items()}
    answers: list[bool | None] = list(sized.values())
    shown = [key for key, one in sized.items() if one]
    for output in {output for _, output in shown}:
        answers.append(is_shown_at_rest([noises[key] for key in shown if key[1] == output]))
    return False if False in answers else None if None in answers else True


def at_rest_and_driven(under: Correlated, key: Key) -> tuple[float, float] | None:
    """Root mean square of what a fit leaves of an output at 0 V and under voltage [SI], where that is no noise.

    None where the noise under voltage is as it is at 0 V, or few rows are there. A converter hides up to its step.
    """
    noise = under.resting(key)
    if noise.is_at_rest_too is not False:
        return None
    driven = under.left(key)[under.pieces[key].inside][len(noise.left) :]
    unit = under.problem.noise[key]
    at_rest = max(unit * float(np.std(noise.left)), under.problem.readings[key].quantum / math.sqrt(12.0))
    return at_rest, unit * float(np.sqrt(np.mean(driven**2)))
