"""Sobol indices: which part of a metric's variance each parameter brings.

Of a function of independent parameters, the first index of a parameter is the part of the variance that its mean over
all others has; the total index is the part that would remain if all others were known. With pairs of points A and B,
and A with one parameter from B, both are means over the design (Saltelli 2010, tables 1 and 2):

    first = mean(f(B) (f(AB_i) - f(A))) / V        total = mean((f(A) - f(AB_i))^2) / (2 V)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Ends = tuple[float, float]

_DRAWS: Final = 200
_SEED: Final = 20261121
_FEWEST: Final = 2  # pairs: one drawn again is always itself


@dataclass(frozen=True)
class Index:
    """The indices of one parameter.

    Parameters
    ----------
    first, total : float
        First-order and total index.
    first_interval, total_interval : pair of float
        95 %, of pairs of points drawn again.
    """

    first: float
    total: float
    first_interval: Ends
    total_interval: Ends


def sobol_indices(values: npt.ArrayLike, parameters: int) -> list[Index]:
    """The Sobol indices of each parameter of a ``saltelli`` design.

    Parameters
    ----------
    values : float array, shape (base * (parameters + 2),)
        In the order of the sets. Pairs with a value that is missing (NaN) are left out.
    parameters : int

    Returns
    -------
    indices : list of Index
        NaN where the values do not vary, or fewer than two pairs are left.

    Examples
    --------
    >>> from ipmclab.sweep.design import Range, Sampled
    >>> design = Sampled("saltelli", {"a": Range(0.0, 1.0), "b": Range(0.0, 1.0)}, 1024, seed=1)
    >>> sets = design.sets(0, design.count)
    >>> [round(one.first, 2) for one in sobol_indices(2.0 * sets["a"] + sets["b"], 2)]
    [0.8, 0.2]
    """
    table = np.asarray(values, dtype=np.float64).reshape(-1, parameters + 2)
    table = table[~np.isnan(table).any(axis=1)]
    if len(table) < _FEWEST:
        nothing = (np.nan, np.nan)
        return [Index(np.nan, np.nan, nothing, nothing)] * parameters
    table = table - table[:, [0, -1]].mean()  # the estimator of the first index loses digits to a mean
    random = np.random.default_rng(_SEED)
    first, total = _estimates(table)
    drawn = [_estimates(table[random.integers(len(table), size=len(table))]) for _ in range(_DRAWS)]
    firsts, totals = (np.quantile([one[k] for one in drawn], [0.025, 0.975], axis=0) for k in (0, 1))
    return [
        Index(float(first[i]), float(total[i]), _ends(firsts[:, i]), _ends(totals[:, i])) for i in range(parameters)
    ]


def _estimates(table: FloatArray) -> tuple[FloatArray, FloatArray]:
    a, mixed, b = table[:, :1], table[:, 1:-1], table[:, -1:]
    variance = float(np.var(table[:, [0, -1]]))
    if variance == 0.0:
        nothing = np.full(mixed.shape[1], np.nan)
        return nothing, nothing
    first: FloatArray = np.mean(b * (mixed - a), axis=0) / variance
    total: FloatArray = np.mean((a - mixed) ** 2, axis=0) / (2.0 * variance)
    return first, total


def _ends(pair: FloatArray) -> Ends:
    return float(pair[0]), float(pair[1])
