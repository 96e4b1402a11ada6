"""The difference between two models on the same held-out blocks, with its standard error."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.intp]

_NOISE_FITTED: Final = 1.0
"""Variance [nat^2] of a difference that the fitted noise itself leaves open: models that say the same are alike."""

_LIMIT: Final = 1e70
"""Of the distance of two predictions: one that is as large says that a reading cannot be."""

ENOUGH_RUNS: Final = 4
"""Runs from which their scatter says something of its own."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """What one model said of every held-out reading.

    Parameters
    ----------
    score : float array, shape (n_block,)
        Log predictive density of each block.
    innovation, variance : float array, shape (n_reading,)
        Error and variance of the prediction of each reading, from all that was known before it.
    """

    score: FloatArray
    innovation: FloatArray
    variance: FloatArray


@dataclass(frozen=True)
class Difference:
    """By how much one model predicts held-out readings better than another.

    Parameters
    ----------
    model, other : str
    value : float [nat]
        Log predictive likelihood of ``model`` minus that of ``other``.
    standard_error : float [nat]
        From the scatter of the paired differences, block by block.
    limit : float
        Standard errors beyond which the two are distinguished: the two-sided 95 % point of Student's
        distribution, about 2.
    blocks : int
    """

    model: str
    other: str
    value: float
    standard_error: float
    limit: float
    blocks: int

    @property
    def is_distinguished(self) -> bool:
        """Whether the difference is larger than chance would make it."""
        return abs(self.value) > self.limit * self.standard_error

    def __str__(self) -> str:
        """One sentence."""
        size = f"{abs(self.value):.3g} nats, standard error {self.standard_error:.3g}"
        if not self.is_distinguished:
            return f"These records cannot distinguish {self.model} from {self.other} (difference {size})."
        better, worse = (self.model, self.other) if self.value > 0.0 else (self.other, self.model)
        return f"{better} predicts better than {worse} (by {size})."


def difference(
    model: tuple[str, HeldOut], other: tuple[str, HeldOut], block_of: IndexArray, run_of: IndexArray
) -> Difference:
    """Compare two models on the same blocks.

    Readings differ in how much they can say: a block in which both models predict the same cannot scatter, one
    at a jump can a lot. What each block can say is known: if readings scattered as the sharper of two predictions
    says, the difference d of a block would have the variance q, the sum over its readings of

        (rho - 1)^2/2 + rho^2 delta^2,

    with delta the distance of the two predictions in the sharper one's standard deviation and rho <= 1 the ratio of its
    variance to the other's (a difference of two Gaussian log densities). If they scattered as the wider one says, one
    reading of which a model knows nothing would let any difference be chance. The differences are taken as
    d = b q + error, the error's variance as phi q. The blocks themselves say what phi is: their scatter about b q,
    with the correlation of neighbours (Newey and West) and, from four runs on, the scatter between runs, whichever is
    largest, and never below 1, what the noise alone makes. The standard error of the sum is sqrt(phi sum(q) + 1): the
    noise of each model was fitted too, which alone moves its score by about a nat.

    Parameters
    ----------
    model, other : pair of str and HeldOut
    block_of : int array, shape (n_reading,)
        The block of each reading.
    run_of : int array, shape (n_block,)
        The run of each block.

    Examples
    --------
    >>> rng = np.random.default_rng(20261121)
    >>> noise, block_of = rng.standard_normal(1000), np.arange(1000) // 50
    >>> def said(error):
    ...     density = -0.5 * (error**2 + np.log(2.0 * np.pi))
    ...     return HeldOut(np.bincount(block_of, density), error, np.ones(1000))
    >>> one_run = np.zeros(20, dtype=int)
    >>> difference(("A", said(noise)), ("B", said(noise + 0.5)), block_of, one_run).is_distinguished
    True
    >>> difference(("A", said(noise)), ("B", said(noise + 0.01)), block_of, one_run).is_distinguished
    False
    """
    from scipy.special import stdtrit

    (name, mine), (other_name, its) = model, other
    gains = mine.score - its.score
    count = len(gains)
    able = np.asarray(np.bincount(block_of, _variance(mine, its), minlength=count), dtype=np.float64)
    whole = float(able.sum())
    if count < 2 or whole <= 0.0:
        return Difference(name, other_name, float(gains.sum()), math.inf if gains.any() else 0.0, math.inf, count)
    # A block that can say nothing would let rounding speak.
    able = able + 1e-3 * whole / count
    left = gains - gains.sum() / able.sum() * able
    phi, freedom = _scatter(left / np.sqrt(able)), count - 1
    runs = np.unique(run_of)
    if len(runs) >= ENOUGH_RUNS:
        of_runs = np.array([left[run_of == run].sum() / math.sqrt(able[run_of == run].sum()) for run in runs])
        between = float(of_runs @ of_runs) / (len(runs) - 1)
        if between > phi:
            phi, freedom = between, len(runs) - 1
    error = math.sqrt(max(phi, 1.0) * float(able.sum()) + _NOISE_FITTED)
    return Difference(name, other_name, float(gains.sum()), error, float(stdtrit(freedom, 0.975)), count)


def _variance(mine: HeldOut, its: HeldOut) -> FloatArray:
    """Variance of the difference of each reading's log density, were the sharper prediction right."""
    sharper, wider = np.minimum(mine.variance, its.variance), np.maximum(mine.variance, its.variance)
    ratio = sharper / wider
    distance = np.minimum((its.innovation - mine.innovation) ** 2 / sharper, _LIMIT)
    return np.asarray(0.5 * (ratio - 1.0) ** 2 + ratio**2 * distance)


def _scatter(normal: FloatArray) -> float:
    """Mean square, with the correlation of neighbouring blocks where that makes it larger (Bartlett's weights)."""
    count = len(normal)
    square = float(normal @ normal)
    lags = round(count ** (1.0 / 3.0))
    shared = sum((1.0 - lag / (lags + 1.0)) * float(normal[:-lag] @ normal[lag:]) for lag in range(1, lags + 1))
    return float((square + 2.0 * max(shared, 0.0)) / (count - 1))
