"""How much likelier readings become when a fit may add something to its model, whatever their noise is.

Autocorrelated noise can look like what a model lacks, and the other way round. So both are compared with each
other: the noise is estimated again with what was added.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from ipmclab.identification.noise.pieces import Key, Piece, System, refine_noise
from ipmclab.identification.problem.evaluation import Evaluation
from ipmclab.identification.problem.problem import Problem
from ipmclab.normal_equations import inverse
from ipmclab.run import FloatArray
from ipmclab.statespace.columns import without
from ipmclab.statespace.search import NEARLY
from ipmclab.statespace.shape import Shape


class Evidence:
    """The readings of some outputs, the directions in which a fit can move, and some that it cannot.

    Parameters
    ----------
    problem : Problem
        Not whitened.
    here : Evaluation
        Of it.
    pieces : sequence of Piece
        The outputs in every run that has them.
    added : float array, shape (n_added, n_residual)
        Changes of the weighted residuals that the fit has no unknown for.
    beside : mapping of Piece to Shape
        All other outputs whose noise is not white, which stays: as white ones they would hold the parameters that
        they share with these where that noise has put them.
    """

    def __init__(
        self,
        problem: Problem,
        here: Evaluation,
        pieces: Sequence[Piece],
        added: FloatArray,
        beside: Mapping[Piece, Shape],
    ) -> None:
        size = np.sqrt((added * added).sum(axis=1))
        self.lengths = np.where(size > 0.0, size, 1.0)
        self.system = System(problem, here, [*pieces, *beside], added / self.lengths[:, None]).given(beside)
        self.first, self.count = self.system.directions.shape[1], len(added)

    def alone(self, shapes: Mapping[Key, Shape]) -> tuple[FloatArray, FloatArray]:
        """What each addition alone would do under a given noise.

        Returns
        -------
        gains : float array, shape (n_added,)
            By how much it would lower chi-square; negative where less than none of it is asked for.
        sizes : float array, shape (n_added,)
            How much of it is asked for, in units of what was given.
        """
        left, own = self._left_over(shapes)
        power, across = left.diagonal()[:-1], left[:-1, -1]
        # The residual is model less reading: what is missing lowers it.
        size = np.where(own, -across / np.where(own, power, 1.0), 0.0)
        return -across * np.abs(size), size / self.lengths

    def together(self, shapes: Mapping[Key, Shape]) -> float:
        """By how much all additions together would lower chi-square under a given noise."""
        left, own = self._left_over(shapes)
        places = np.flatnonzero(own)
        inner, across = left[np.ix_(places, places)], left[places, -1]
        return float(across @ np.linalg.lstsq(inner, across, rcond=1e-10)[0])

    def _left_over(self, shapes: Mapping[Key, Shape]) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
        """Products of additions and residual after what the fit itself can do, and of which there is anything left
        then."""
        total = self.system.rest + sum(self.system.part(key, shape) for key, shape in shapes.items())
        first = self.first
        answer = inverse(total[:first, :first]) @ total[:first, first:]
        left = total[first:, first:] - total[first:, :first] @ answer
        # What the fit can imitate to a millionth is nothing of its own.
        return left, left.diagonal()[:-1] > 1e-6 * total.diagonal()[first:-1]

    def deviance(self, chosen: Sequence[int], shapes: Mapping[Key, Shape]) -> tuple[float, dict[Key, Shape]]:
        """Minus twice the log likelihood with some of the additions, and the noise that is the likeliest with them.

        Parameters
        ----------
        chosen : sequence of int
            Additions that the fit may use; none for the model as it is.
        shapes : mapping of (place, output) to Shape
            Where the search for the noise starts; its terms stay.
        """
        kept = [*range(self.first), *(self.first + place for place in chosen), self.first + self.count]
        system = self.system.among(kept)
        found = refine_noise(system, shapes, NEARLY)
        total, logarithms = system.rest.copy(), 0.0
        for key, shape in found.items():
            products, logarithm = system.columns[key].products(shape.terms, shape.entries)
            total += without(products, shape.terms)[0] / shape.variance
            logarithms += system.columns[key].count * math.log(shape.variance) + logarithm
        misfit = total[-1, -1] - total[-1, :-1] @ inverse(total[:-1, :-1]) @ total[:-1, -1]
        return float(misfit) + logarithms, found
