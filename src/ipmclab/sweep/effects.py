"""Morris's effects: how far a metric goes when one parameter goes along its range, and whether always as far.

A way changes one parameter at each step. What a metric changes by, over the part of the range that the step went, is
an elementary effect. Their mean magnitude says how much a parameter matters; their standard deviation how much that
depends on the others, or bends (Morris 1991; Campolongo and others 2007). It takes fewer sets than Sobol indices, and
says less: which parameters of many can be left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.sweep.design import LEVELS, morris_problem
from ipmclab.sweep.packages import salib

FloatArray = npt.NDArray[np.float64]

_DRAWS: Final = 200
_SEED: Final = 20261121


@dataclass(frozen=True)
class Effect:
    """What one parameter does to a metric along its whole range.

    Parameters
    ----------
    mean : float [SI]
        Of the effects, with their signs.
    magnitude : float [SI]
        Mean of their magnitudes.
    magnitude_interval : pair of float [SI]
        95 %, of ways drawn again.
    standard_deviation : float [SI]
        Of the effects.
    """

    mean: float
    magnitude: float
    magnitude_interval: tuple[float, float]
    standard_deviation: float


def morris_effects(ways: FloatArray, values: npt.ArrayLike, names: Sequence[str]) -> list[Effect]:
    """The effects of each parameter of a ``morris`` design.

    Parameters
    ----------
    ways : float array, shape (n_sets, n_parameters)
        Which part of the way from low to high each parameter goes.
    values : float array, shape (n_sets,) [SI]
        Ways with a value that is missing (NaN) are left out.
    names : sequence of str

    Returns
    -------
    effects : list of Effect
        NaN where fewer than two ways are left.

    Examples
    --------
    >>> from ipmclab.sweep.design import Range, Sampled
    >>> design = Sampled("morris", {"a": Range(0.0, 1.0), "b": Range(0.0, 1.0)}, 20, seed=1)
    >>> ways = design.ways(0, design.count)
    >>> [round(one.magnitude, 6) for one in morris_effects(ways, 3.0 - 2.0 * ways[:, 0], ["a", "b"])]
    [2.0, 0.0]
    """
    each = len(names) + 1
    table = np.asarray(values, dtype=np.float64).reshape(-1, each)
    whole = ~np.isnan(table).any(axis=1)
    if whole.sum() < 2:
        return [Effect(np.nan, np.nan, (np.nan, np.nan), np.nan)] * len(names)
    found = salib("SALib.analyze.morris").analyze(
        morris_problem(names),
        np.ascontiguousarray(ways.reshape(len(table), each, -1)[whole].reshape(-1, len(names))),
        table[whole].ravel(),
        num_resamples=_DRAWS,
        num_levels=LEVELS,
        seed=_SEED,
    )
    columns = zip(*(np.asarray(found[key]) for key in ("mu", "mu_star", "mu_star_conf", "sigma")), strict=True)
    return [Effect(float(m), float(size), (float(size - c), float(size + c)), float(s)) for m, size, c, s in columns]
