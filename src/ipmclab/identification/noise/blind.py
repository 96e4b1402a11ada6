"""Whether runs would show a drift at all, and what they would say of the parameters if there were one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ipmclab.fit.fit import DETERMINED
from ipmclab.identification.noise.pieces import Key, Piece, System
from ipmclab.normal_equations import inverse
from ipmclab.run import FloatArray
from ipmclab.statespace.columns import CONSTANTS
from ipmclab.statespace.shape import Shape
from ipmclab.statespace.terms import Terms

_UNNOTICED: Final = 0.75  # standard error of a drift, in standard deviations of the noise: three of them are then four
_HARM: Final = 2.0  # by which the standard error of some parameter grows with a drift beside it


@dataclass(frozen=True)
class Blind:
    """What a drift that runs would not show would do to the parameters.

    Parameters
    ----------
    wider : float
        By how much the standard error of some parameter grows with an offset and a drift beside it.
    allowed : bool
        Whether all that is known without a drift is still known beside one, so that the fit has one.
    """

    wider: float
    allowed: bool


def blind_outputs(
    system: System, pieces: Sequence[Piece], shapes: Mapping[Key, Shape] | None = None
) -> dict[str, Blind]:
    """Outputs of which no run would show a straight drift by three times its noise.

    A parameter takes up such a drift so well that the residuals do not tell: a current that drifts during one step
    looks like a leak and a slow branch. If one run of an output would show it and does not, the others are taken to be
    free of it too: the sensor is the same. Where a drift would move no parameter much, nothing is said. Autocorrelated
    noise hides a drift that white noise would show, so it is asked again under what was found.

    Parameters
    ----------
    system : System
        Of all pieces, at the fit under white noise.
    pieces : sequence of Piece
    shapes : mapping of (place, output) to Shape, optional
        Their noise, where it is not white. An output of which some run has a trend or a walk is not asked about.

    Returns
    -------
    found : dict of output to Blind
    """
    noise = shapes or {piece.key: Shape(Terms(), np.zeros(0), 1.0) for piece in pieces}
    parts = {piece.key: system.part(piece.key, noise[piece.key]) for piece in pieces}
    least = (system.rest + sum(parts.values()))[:-1, :-1]
    found: dict[str, Blind] = {}
    for output in dict.fromkeys(piece.key[1] for piece in pieces):
        own = [piece for piece in pieces if piece.key[1] == output]
        if any(
            not (piece.allowed.offset and piece.allowed.trend)
            or noise[piece.key].terms.drifts
            or _error_of_drift(system, piece, noise[piece.key], least, parts[piece.key][:-1, :-1]) < _UNNOTICED
            for piece in own
        ):
            continue
        others = system.rest + sum(part for key, part in parts.items() if key[1] != output)
        most = (others + sum(system.part(piece.key, noise[piece.key].with_drift()) for piece in own))[:-1, :-1]
        sure, unsure = (_errors(system.directions, one) for one in (least, most))
        wider = float(np.max(unsure / np.maximum(sure, 1e-300), initial=1.0))
        if wider > _HARM:
            found[output] = Blind(wider, bool((unsure[sure <= DETERMINED] <= DETERMINED).all()))
    return found


def _error_of_drift(system: System, piece: Piece, shape: Shape, every: FloatArray, own: FloatArray) -> float:
    """Standard error of a run's drift over its length, its offset and all parameters being free, over the noise."""
    products, _ = system.columns[piece.key].products(shape.terms, shape.entries)
    whole = products[:-1, :-1] / shape.variance
    whole[CONSTANTS:, CONSTANTS:] += every - own
    # Time runs from -1 to 1: over the record a slope of 1 is a drift of 2.
    return 2.0 * float(np.sqrt(inverse(whole)[1, 1]))


def _errors(directions: FloatArray, normal: FloatArray) -> FloatArray:
    """Standard errors of the unknowns under some normal equations."""
    return np.asarray(np.sqrt(np.einsum("ij,jk,ik->i", directions, inverse(normal), directions)))
