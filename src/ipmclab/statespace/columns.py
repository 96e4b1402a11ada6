"""Residuals and derivatives of one output of one run, whitened, and the few numbers that a likelihood needs of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.run import FloatArray
from ipmclab.statespace.kernels import eliminate, whiten
from ipmclab.statespace.terms import StateSpace, Terms, state_space

CONSTANTS: Final = 2
"""Columns in front: 1 and time, the latter about its middle and at most 1."""


@dataclass(frozen=True, eq=False)
class Columns:
    """What was not explained, and what could have explained it.

    Parameters
    ----------
    matrix : float array, shape (n_readings, 2 + n_directions + 1)
        Offset, trend, derivatives in directions of the free parameters, and last the residual.
    steps : int array, shape (n_readings,)
        Steps of time since the reading before.
    """

    matrix: FloatArray
    steps: npt.NDArray[np.int64]

    @property
    def count(self) -> int:
        """How many readings there are."""
        return len(self.matrix)

    def whitened(self, terms: Terms, entries: FloatArray) -> tuple[FloatArray, float]:
        """All columns whitened, and the logarithm of the determinant of the covariance."""
        return whitened(state_space(terms, entries), self.matrix, self.steps)

    def products(self, terms: Terms, entries: FloatArray) -> tuple[FloatArray, float]:
        """Products of all whitened columns, and the logarithm of the determinant of the covariance."""
        white, logarithm = self.whitened(terms, entries)
        return white.T @ white, logarithm


def whitened(space: StateSpace, matrix: FloatArray, steps: npt.NDArray[np.int64]) -> tuple[FloatArray, float]:
    """Columns whitened, in units of the scale; the matrix stays as it is."""
    found = np.array(matrix, order="C")
    if not len(space.seen):
        return found, 0.0
    one_kind, variances = np.zeros(len(steps), dtype=np.int64), np.empty(len(steps))
    transitions, drives = space.transition[None], space.drive[None]
    total = whiten(found, steps, one_kind, transitions, drives, space.seen, space.reading, space.start, variances)
    return found, float(total)


def steps_between(time: FloatArray, step: float) -> npt.NDArray[np.int64]:
    """Whole steps between readings, at least one; the first is 1.

    Examples
    --------
    >>> steps_between(np.array([0.0, 0.1, 0.2, 0.5]), 0.1).tolist()
    [1, 1, 1, 3]
    """
    place = np.rint((time - time[0]) / step).astype(np.int64) if len(time) else np.zeros(0, dtype=np.int64)
    return np.asarray(np.maximum(np.diff(place, prepend=-1), 1))


def constants(time: FloatArray) -> FloatArray:
    """The columns of an offset and a trend, shape (n_readings, 2)."""
    middle, half = 0.5 * (time[0] + time[-1]), 0.5 * (time[-1] - time[0])
    return np.column_stack([np.ones(len(time)), (time - middle) / half])


def origin(time: FloatArray, terms: Terms) -> float:
    """The time at which the trend of a noise adds nothing [s].

    With an offset beside it that time is arbitrary, and the middle. A trend alone stands beside an offset that is asked
    elsewhere, or that rows at 0 V show: that is the one at the first reading, where the trend begins.
    """
    return float(time[0]) if _begins_at_first(terms) else 0.5 * float(time[0] + time[-1])


def held_constants(time: FloatArray, terms: Terms) -> FloatArray:
    """The columns of those that a noise has, the trend about its ``origin``, shape (n_readings, n_held)."""
    columns = constants(time)[:, terms.held]
    return columns + 1.0 if _begins_at_first(terms) else columns


def _begins_at_first(terms: Terms) -> bool:
    return terms.trend and not terms.offset


def without(products: FloatArray, terms: Terms) -> tuple[FloatArray, float]:
    """Products of directions and residual with the constants of the terms projected out, and log det of theirs."""
    held = terms.held
    if not held:
        return products[CONSTANTS:, CONSTANTS:].copy(), 0.0
    if len(held) == CONSTANTS:
        left = products.copy()
    else:
        kept = [*held, *range(CONSTANTS, len(products))]
        left = products[np.ix_(kept, kept)]
        if _begins_at_first(terms):  # as in ``held_constants``: so much of an offset is in it
            left[0] += products[0, kept]
            left[:, 0] += products[kept, 0]
            left[0, 0] += products[0, 0]
    logarithm = eliminate(left, len(held))
    return left[len(held) :, len(held) :].copy(), float(logarithm)
