"""Noise that is larger where the answer is: found in the residuals, with its variance at each row."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ipmclab.confidence import REJECT
from ipmclab.identification.noise.correlate import Correlated
from ipmclab.identification.noise.pieces import Key
from ipmclab.run import FloatArray

_FEWEST: Final = 50  # rows: fewer do not tell how noise grows
_SOME: Final = 1.5  # times the scatter of a correlation
_TURNS: Final = 5  # of weighted least squares, after which no variance moves by a hundredth
_LEAST: Final = 1e-3  # of the mean variance, which no row stays below


@dataclass(frozen=True, eq=False)
class Growth:
    """How noise grows with the answer.

    Parameters
    ----------
    variance : float array, shape (n_rows,)
        Of each row, over that with which it was weighted.
    times : float
        How many times as large the noise is where the answer is largest as where it is smallest.
    """

    variance: FloatArray
    times: float


def growth(correlated: Correlated, key: Key) -> Growth | None:
    """How the noise of one output of one run grows with the answer; None where it does not, or nobody can tell.

    Whether it does is asked of the ranks of what is left (0.1 %), so that no single row decides: whether they go with
    the ranks of the answer (Spearman), or with the answer itself. How it grows is a variance of ``a + b |y| + c y^2``
    with a, b, c of 0 or more.

    Parameters
    ----------
    correlated : Correlated
    key : (place, output)
    """
    problem, piece = correlated.problem, correlated.problem.pieces[key]
    reading, residual = problem.readings[key], correlated.whitened.residual[piece]
    inside = reading.exact_of_used
    # Of the model: a reading is large where its own noise is.
    answer = np.abs(reading.values[reading.used] + problem.noise[key] * correlated.plain.residual[piece])[inside]
    size = np.abs(residual[inside])
    if len(size) < _FEWEST:
        return None
    scatter = 1.0 / math.sqrt(len(size) - 1.0)
    # Ranks take as long as the rest of a short fit, and where sizes have nothing in common ranks have not.
    if _together(answer, size) < _SOME * scatter:
        return None
    from scipy.optimize import nnls
    from scipy.special import ndtr

    ranks = _ranks(size)
    # Of a step few rows are large, and among the ranks of all answers theirs hardly count.
    surest = max(_together(_ranks(answer), ranks), _together(answer, ranks)) / scatter
    if 2.0 * ndtr(-surest) > REJECT:
        return None
    answer = answer / answer.max()
    columns = np.column_stack([np.ones_like(answer), answer, answer * answer])
    square = size * size
    variance = np.full(len(size), square.mean())
    for _ in range(_TURNS):
        # A square of the noise scatters as its own mean.
        shape = nnls(columns / variance[:, None], square / variance)[0]
        variance = np.maximum(columns @ shape, _LEAST * square.mean())
    full = np.ones(len(residual))
    full[inside] = variance
    return Growth(full, math.sqrt(float(variance.max() / variance.min())))


def _together(one: FloatArray, other: FloatArray) -> float:
    one, other = one - one.mean(), other - other.mean()
    size = math.sqrt(float(one @ one) * float(other @ other))
    return float(one @ other) / size if size else 0.0


def _ranks(values: FloatArray) -> FloatArray:
    """Places in order; equal values share the mean of theirs."""
    _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(counts) - 0.5 * (counts - 1))[inverse])
