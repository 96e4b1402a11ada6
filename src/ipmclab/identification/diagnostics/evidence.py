"""How much likelier readings become when a fit may add something to its model, whatever their noise is.

Autocorrelated noise can look like what a model lacks, and the other way round. So both are held against each
other: the noise is estimated anew beside what was added.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from ipmclab.identification.noise.columns import CONSTANTS, Columns, constants, inverse, without
from ipmclab.identification.noise.pieces import Key, Piece, directions_of
from ipmclab.identification.noise.search import refine
from ipmclab.identification.noise.shape import Shape
from ipmclab.identification.problem.problem import Evaluation, Problem

FloatArray = npt.NDArray[np.float64]

_RIDGE = 1e-9


class Evidence:
    """The readings of one output, the directions in which a fit can move, and some that it cannot.

    Parameters
    ----------
    problem : Problem
        Not whitened.
    here : Evaluation
        Of it.
    pieces : sequence of Piece
        The output in every run that has it.
    added : float array, shape (n_added, n_residual)
        Changes of the weighted residuals that the fit has no unknown for.
    """

    def __init__(self, problem: Problem, here: Evaluation, pieces: Sequence[Piece], added: FloatArray) -> None:
        directions = directions_of(here)
        self.first = directions.shape[1]
        self.count = len(added)
        self.pieces = {piece.key: piece for piece in pieces}
        size = np.sqrt((added * added).sum(axis=1, keepdims=True))
        self.lengths = np.where(size > 0.0, size, 1.0)[:, 0]
        self.added = added / self.lengths[:, None]
        rows = np.vstack([directions.T @ here.rows[:-1], self.added, here.rows[-1:]])
        self.rest = _RIDGE * np.eye(len(rows))
        self.rest[-1, -1] = 0.0
        begin = max((place.stop for place in problem.pieces.values()), default=0)
        others = [place for key, place in problem.pieces.items() if key not in self.pieces]
        for stretch in [*others, slice(begin, rows.shape[1])]:
            self.rest += rows[:, stretch] @ rows[:, stretch].T
        self.columns = {
            key: Columns(
                np.ascontiguousarray(np.column_stack([constants(p.time), rows[:, problem.pieces[key]][:, p.inside].T])),
                p.steps,
            )
            for key, p in self.pieces.items()
        }

    def alone(self, shapes: Mapping[Key, Shape]) -> tuple[FloatArray, FloatArray]:
        """What each addition alone would do under a given noise.

        Returns
        -------
        gains : float array, shape (n_added,)
            By how much it would lower chi-square; negative where less than none of it is asked for.
        sizes : float array, shape (n_added,)
            How much of it is asked for, in units of what was given.
        """
        left, own = self._beside(shapes)
        power, across = left.diagonal()[:-1], left[:-1, -1]
        # The residual is model less reading: what is missing lowers it.
        size = np.where(own, -across / np.where(own, power, 1.0), 0.0)
        return -across * np.abs(size), size / self.lengths

    def together(self, shapes: Mapping[Key, Shape]) -> float:
        """By how much all additions together would lower chi-square under a given noise."""
        left, own = self._beside(shapes)
        places = np.flatnonzero(own)
        inner, across = left[np.ix_(places, places)], left[places, -1]
        return float(across @ np.linalg.lstsq(inner, across, rcond=1e-10)[0])

    def _beside(self, shapes: Mapping[Key, Shape]) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """Products of additions and residual beside what the fit can do, and of which there is anything left then."""
        total = self.rest + sum(_part(self.columns[key], shape) for key, shape in shapes.items())
        first = self.first
        answer = inverse(total[:first, :first]) @ total[:first, first:]
        left = total[first:, first:] - total[first:, :first] @ answer
        # What the fit can imitate to a millionth is nothing of its own.
        return left, left.diagonal()[:-1] > 1e-6 * total.diagonal()[first:-1]

    def deviance(self, chosen: Sequence[int], shapes: Mapping[Key, Shape]) -> tuple[float, dict[Key, Shape]]:
        """Minus twice the log likelihood with some of the additions, and the noise that is the likeliest beside them.

        Parameters
        ----------
        chosen : sequence of int
            Additions that the fit may use; none for the model as it is.
        shapes : mapping of (place, output) to Shape
            Where the search for the noise starts; its terms stay.
        """
        kept = [*range(self.first), *(self.first + place for place in chosen), self.first + self.count]
        rest = self.rest[np.ix_(kept, kept)]
        columns = {
            key: Columns(
                np.ascontiguousarray(whole.matrix[:, [*range(CONSTANTS), *(CONSTANTS + one for one in kept)]]),
                whole.steps,
            )
            for key, whole in self.columns.items()
        }
        found = dict(shapes)
        parts = {key: _part(columns[key], shape) for key, shape in found.items()}
        logarithms: dict[Key, float] = {}
        for _ in range(2 if len(found) > 1 else 1):
            for key in found:
                others = rest + sum(part for other, part in parts.items() if other != key)
                best = refine(columns[key], others, found[key].terms, [found[key].entries])
                found[key] = Shape(best.terms, best.entries, best.likelihood.variance)
                parts[key] = best.likelihood.products
        for key, shape in found.items():
            _, logarithm = columns[key].products(shape.terms, shape.entries)
            logarithms[key] = columns[key].count * math.log(shape.variance) + logarithm
        total = rest + sum(parts.values())
        last = len(total) - 1
        misfit = total[last, last] - total[last, :last] @ inverse(total[:last, :last]) @ total[:last, last]
        return float(misfit) + sum(logarithms.values()), found


def _part(columns: Columns, shape: Shape) -> FloatArray:
    products, _ = columns.products(shape.terms, shape.entries)
    return np.asarray(without(products, shape.terms)[0] / shape.variance)
