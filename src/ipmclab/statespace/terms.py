"""Terms of a noise model, and the state space that they make."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

MOST_ORDER: Final = 4
"""Longest autoregression that is tried."""

_FARTHEST: Final = 4.5  # arctanh of a partial autocorrelation: 0.99975
_RATIOS: Final = (math.log(1e-5), math.log(1e3))
"""Of two noises (convention)."""


@dataclass(frozen=True)
class Terms:
    """Which terms the noise of one output of one run has.

    Parameters
    ----------
    order : int
        Of the autoregression; 0 for white noise.
    walk : bool
        A level that walks at random.
    white : bool
        White noise beside an autoregression (noise of order 0 is white by itself).
    offset, trend : bool
        Unknown constants of the run: a level, and its slope over time.

    Examples
    --------
    >>> str(Terms(order=1, offset=True, trend=True))
    'offset, linear trend, AR(1)'
    >>> str(Terms())
    'white'
    """

    order: int = 0
    walk: bool = False
    white: bool = False
    offset: bool = False
    trend: bool = False

    @property
    def shapes(self) -> int:
        """Numbers that shape the covariance, its scale not counted."""
        return self.order + self.walk + self.white

    @property
    def constants(self) -> int:
        """Unknown constants."""
        return self.offset + self.trend

    @property
    def held(self) -> list[int]:
        """Of the columns of an offset and a trend, those that are terms."""
        return [column for column, has in enumerate((self.offset, self.trend)) if has]

    @property
    def drifts(self) -> bool:
        """Whether the level goes away: the case in which no sum of autocovariances holds."""
        return self.walk or self.trend

    @property
    def is_white(self) -> bool:
        """Whether there is nothing but white noise about 0."""
        return self == Terms()

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Of the entries of ``state_space``."""
        return [(-_FARTHEST, _FARTHEST)] * self.order + [_RATIOS] * (self.walk + self.white)

    def __str__(self) -> str:
        """The terms in words."""
        words = ["offset"] * self.offset + ["linear trend"] * self.trend
        words += [f"AR({self.order})"] if self.order else ["white"]
        words += ["random walk"] * self.walk + ["white"] * self.white
        return ", ".join(words)


@dataclass(frozen=True, eq=False)
class StateSpace:
    """What ``kernels.whiten`` steps, in units of the noise's scale.

    The scale is the standard deviation of what drives the autoregression, or of the white noise where there is none.
    """

    transition: FloatArray
    drive: FloatArray
    seen: FloatArray
    reading: float
    start: FloatArray


def autoregression(partials: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coefficients and autocovariances of an autoregression with given partial autocorrelations.

    Every set of partial autocorrelations inside (-1, 1) is one stationary autoregression and the other way round
    (Barndorff-Nielsen and Schou 1973); the recursion is Durbin's.

    Parameters
    ----------
    partials : float array, shape (order,)

    Returns
    -------
    coefficients : float array, shape (order,)
        phi in e[t] = phi[0] e[t-1] + ... + w[t].
    covariances : float array, shape (order,)
        Of readings 0 to order - 1 steps apart, for w of variance 1.

    Examples
    --------
    >>> coefficients, covariances = autoregression(np.array([0.9]))
    >>> coefficients.tolist(), covariances.round(6).tolist()
    ([0.9], [5.263158])
    """
    order = len(partials)
    coefficients = np.zeros(0)
    correlations = [1.0]
    for partial in partials:
        reverse = coefficients[::-1]
        ahead = float(coefficients @ np.array(correlations[:0:-1])) if len(coefficients) else 0.0
        shrunk = 1.0 - float(coefficients @ np.array(correlations[1:])) if len(coefficients) else 1.0
        correlations.append(ahead + partial * shrunk)
        coefficients = np.append(coefficients - partial * reverse, partial)
    variance = 1.0 / float(np.prod(1.0 - partials**2))
    return coefficients, variance * np.array(correlations[:order])


def state_space(terms: Terms, entries: FloatArray) -> StateSpace:
    """The noise as a state space.

    Parameters
    ----------
    terms : Terms
    entries : float array, shape (terms.shapes,)
        Inverse hyperbolic tangents of the partial autocorrelations; then logarithms of the walk's standard deviation
        in one step and of the white noise's, over the scale.
    """
    order, n = terms.order, terms.order + terms.walk
    transition, drive, start = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    seen = np.zeros(n)
    if order:
        coefficients, covariances = autoregression(np.tanh(entries[:order]))
        transition[0, :order] = coefficients
        transition[range(1, order), range(order - 1)] = 1.0
        drive[0, 0], seen[0] = 1.0, 1.0
        apart = np.abs(np.arange(order)[:, None] - np.arange(order))
        start[:order, :order] = covariances[apart]
    if terms.walk:
        # It starts at 0: where it starts is the unknown offset that goes with it.
        transition[-1, -1], seen[-1] = 1.0, 1.0
        drive[-1, -1] = math.exp(2.0 * entries[order])
    reading = math.exp(2.0 * entries[-1]) if terms.white else 0.0 if order else 1.0
    return StateSpace(transition, drive, seen, reading, start)
