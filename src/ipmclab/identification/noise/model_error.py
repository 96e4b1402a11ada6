"""What of the noise that is found in a current is no noise: a slope or a walk that the rows at 0 V do not have.

A current is read over a resistor, which does not drift as a strip that curls does. Described as noise, what the model
lacks would be taken off the readings, or make everything slow look like chance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from ipmclab.identification.noise.at_rest import FEWEST_OF_NOISE, Resting, is_shown_at_rest, slope_at_rest
from ipmclab.identification.noise.pieces import Key, Piece
from ipmclab.identification.noise.zeros import DriftingProblem
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Problem
from ipmclab.statespace.search import Allowed
from ipmclab.statespace.shape import Shape

WORSE: Final = 1.05
"""Times what is left with a term (rms): who looks at the curve sees no less."""


def model_errors(
    problem: Problem, here: Evaluation, pieces: Sequence[Piece], shapes: Mapping[Key, Shape]
) -> dict[Key, Allowed]:
    """The terms that are left to each current of which the noise has a slope or a walk that is none of its sensor.

    A slope counts as a drift where the rows at 0 V drift too, or where what is found under voltage is noise that they
    have; a walk where they walk. Where there are few such rows nobody can tell, and the noise keeps its terms.

    Parameters
    ----------
    problem : Problem
    here : Evaluation
        With the residuals in which the noise was found.
    pieces : sequence of Piece
    shapes : mapping of (place, output) to Shape
        The noise.
    """
    currents = {piece.key: piece for piece in pieces if piece.key[1] == "current"}
    resting = {}
    for key, piece in currents.items():
        left = here.residual[problem.pieces[key]][piece.inside]
        resting[key] = Resting.of(problem.record_at(key[0]), key[1], shapes[key], left, problem.noise[key])
    walks = is_shown_at_rest([one for one in resting.values() if one.noise.terms.walk])
    found = {}
    for key, piece in currents.items():
        shape, own = shapes[key], piece.allowed
        trend, walk = own.trend, own.walk
        if shape.terms.trend and resting[key].is_at_rest_too is False:
            rest = slope_at_rest(problem.record_at(key[0]), key[1], shape, problem.noise[key])
            trend = trend and rest.is_shown
        if shape.terms.walk and len(resting[key].left) >= FEWEST_OF_NOISE:
            walk = walk and bool(walks)
        if (trend, walk) != (own.trend, own.walk):
            found[key] = own._replace(trend=trend, walk=walk)
    return found


def slopes_of_model(
    problem: DriftingProblem, plain: Evaluation, without: Problem, shapes: Mapping[Key, Shape]
) -> set[Key]:
    """Currents of which the prediction is worse for a slope that rows at 0 V neither show nor exclude.

    Where what is left beside it is white, or of first order, as that of an amplifier, the model is right, and the slope
    the sensor's. Where it is not, nobody can tell: a slope that is none of the sensor takes the slow answer of the
    strip with it, and the readings lie farther from what the parameters predict than without it.

    Parameters
    ----------
    problem : DriftingProblem
    plain : Evaluation
        With the residuals of its fit, zeros and slopes in them.
    without : Problem
        Weighed by what least squares without slopes leaves.
    shapes : mapping of (place, output) to Shape
        The noise.
    """
    found = set()
    for key, zero in problem.zeros.items():
        few = np.count_nonzero(problem.readings[key].exact[: problem.record_at(key[0]).resting]) < FEWEST_OF_NOISE
        unsure = few and not zero.rest.is_shown and (shapes[key].terms.order > 1 or shapes[key].terms.walk)
        if key[1] == "current" and zero.terms.trend and unsure:
            away = plain.residual[problem.pieces[key]][zero.inside]
            if problem.noise[key] * float(np.std(away)) > WORSE * without.noise[key]:
                found.add(key)
    return found
