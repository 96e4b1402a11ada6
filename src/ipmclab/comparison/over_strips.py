"""What a factor that changes within strips does, over strips that may answer to it differently.

The mixed model has one answer for all strips: what each answers differently counts there as scatter of the repeats, and
many runs of a few strips make its interval narrow. Here each strip is left out in turn, under the covariance that the
model found: the jackknife, whose variance in a balanced campaign is that of the mean of the strips' own answers (as the
analysis of variance judges by the interaction of strip and factor), with one degree of freedom fewer than there are
strips that show it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ipmclab.comparison.mixed import RESIDUAL, Estimate
from ipmclab.comparison.mixed_blocks import FloatArray

FEWEST: Final = 3
"""Strips that show a factor, from which on its effect is one over strips; of fewer it is that of these strips."""

_SAME: Final = 1e-9  # of a column: what it may change by where it does not
_OPEN: Final = 1e-6  # of a coefficient: what other columns have of it where a strip alone shows it


@dataclass(frozen=True, eq=False)
class EachLeftOut:
    """The coefficients of a mixed model, and those without each strip.

    Parameters
    ----------
    design : float array, shape (n, n_columns)
    strips : sequence of str, length n
    whole : float array, shape (n_columns,)
    others : float array, shape (n_strips, n_columns)
    known : bool array, shape (n_strips, n_columns)
        Whether the other strips determine a coefficient.
    """

    design: FloatArray
    strips: Sequence[str]
    whole: FloatArray
    others: FloatArray
    known: FloatArray

    def effect(self, place: int) -> Estimate | None:
        """One coefficient over strips; None where fewer than three strips show it, or one alone does.

        Parameters
        ----------
        place : int
            Its column in the design.
        """
        column, strips = self.design[:, place], np.array(self.strips)
        showing = sum(float(np.ptp(column[strips == one])) > _SAME for one in dict.fromkeys(self.strips))
        if showing < FEWEST or not self.known[:, place].all():
            return None
        squares = float(np.sum((self.others[:, place] - self.whole[place]) ** 2))
        return Estimate(float(self.whole[place]), math.sqrt(squares * (showing - 1.0) / showing), showing - 1.0)


def each_left_out(
    readings: FloatArray, design: FloatArray, groupings: Mapping[str, Sequence[str]], variances: Mapping[str, float]
) -> EachLeftOut:
    """Leave out each strip under the covariance of a mixed model.

    Parameters
    ----------
    readings : float array, shape (n,)
    design : float array, shape (n, n_columns)
    groupings : mapping of name to sequence, length n
        Strips first; none of the others goes over several strips.
    variances : mapping of name to float
        As ``fit_mixed`` found them.

    Examples
    --------
    Three strips at two humidities each, that answer by 0.1, 0.2 and 0.6: the mean of these, and their scatter.

    >>> design = np.column_stack([np.ones(6), [0.0, 1.0] * 3])
    >>> readings = np.array([1.0, 1.1, 2.0, 2.2, 3.0, 3.6])
    >>> found = each_left_out(readings, design, {"strip": list("aabbcc")}, {"repeats": 0.1, "strip": 1.0}).effect(1)
    >>> round(found.value, 3), round(found.standard_error, 3), found.freedom
    (0.3, 0.153, 2.0)
    """
    named = {name: np.array(members) for name, members in groupings.items()}
    strips = next(iter(groupings.values()))
    products, right = [], []
    for strip in dict.fromkeys(strips):
        rows = np.flatnonzero(np.array(strips) == strip)
        covariance = variances[RESIDUAL] * np.eye(len(rows))
        for name, members in named.items():
            own = members[rows]
            covariance += variances.get(name, 0.0) * (own[:, None] == own)
        weighed = np.linalg.solve(covariance, np.column_stack([design[rows], readings[rows]]))
        products.append(design[rows].T @ weighed[:, :-1])
        right.append(design[rows].T @ weighed[:, -1])
    every, wanted = np.array(products), np.array(right)
    without = every.sum(axis=0) - every
    inverse = np.linalg.pinv(without, rcond=1e-10, hermitian=True)
    left = np.eye(design.shape[1]) - inverse @ without
    return EachLeftOut(
        design,
        strips,
        np.linalg.solve(every.sum(axis=0), wanted.sum(axis=0)),
        np.einsum("sij,sj->si", inverse, wanted.sum(axis=0) - wanted),
        np.max(np.abs(left), axis=2) < _OPEN,
    )
