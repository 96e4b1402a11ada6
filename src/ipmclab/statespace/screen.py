"""Whether residuals show anything but white noise about zero: cheap tests before any search."""

from __future__ import annotations

from typing import Final

import numpy as np

from ipmclab.run import FloatArray

_LAGS: Final = 20  # of the Ljung-Box test (convention)
_BLOCKS: Final = (16, 128)  # rows, whose means show what is slower than neighbours (convention)
_REJECT: Final = 0.005  # p of each of the four tests: at most 2 % of white residuals are searched in vain (derived)
_FEWEST: Final = 30
"""Readings below which no noise model but white can be determined."""


def of_neighbours(residual: FloatArray) -> float:
    """How rarely neighbours of white noise about zero belong together as much (Ljung and Box); 1 where nothing shows
    it.

    Examples
    --------
    >>> of_neighbours(np.array([1.0, -1.0] * 10)) < 1e-3, of_neighbours(np.zeros(20))
    (True, 1.0)
    """
    from scipy.special import chdtrc

    count = len(residual)
    lags, power = min(_LAGS, count // 5), float(residual @ residual)
    if lags < 1 or power == 0.0:
        return 1.0
    found = np.correlate(residual, residual[: count - lags], "valid")[1:] / power
    return float(chdtrc(lags, count * (count + 2.0) * float(np.sum(found**2 / (count - np.arange(1, lags + 1))))))


def needs_search(residual: FloatArray, explained: float) -> bool:
    """Whether a noise model is to be looked for.

    Three tests, each at half a per cent: neighbours (Ljung and Box), means of blocks, which a slow level moves, and
    what an offset and a trend would explain together with the free parameters.

    Parameters
    ----------
    residual : float array, shape (n_readings,)
    explained : float
        Chi-square with two degrees of freedom of an offset and a trend.
    """
    from scipy.special import chdtrc, chdtri

    count = len(residual)
    power = float(residual @ residual)
    if count < _FEWEST or power <= 0.0:
        return False
    if explained > chdtri(2, _REJECT):
        return True
    if of_neighbours(residual) < _REJECT:
        return True
    for length in _BLOCKS:
        blocks = count // length
        if blocks < 3:
            continue
        sums = residual[: blocks * length].reshape(blocks, length).sum(axis=1)
        if chdtrc(blocks, float(sums @ sums) * count / (length * power)) < _REJECT:
            return True
    return False
