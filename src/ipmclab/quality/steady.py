"""The value towards which a response settles."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ipmclab.run import FloatArray

_BLOCKS: Final = 400  # means of a stretch that are fitted: a limit
_SPEEDS: Final = 80  # time constants that are tried (convention)
_FASTEST: Final = 0.02  # part of the stretch: the shortest time constant that is tried (convention)
_SLOWEST: Final = 3.0  # times the stretch: the longest time constant that is tried (convention)
_BAND: Final = 3.84
"""95 % of the chi-square distribution with one degree of freedom (derived)."""


def settle(time: FloatArray, values: FloatArray) -> tuple[float, tuple[float, float]]:
    """The limit of ``c + a exp(-t / tau)`` through a response, with its 95 % interval.

    The interval is the likelihood profile over tau, with the scatter of the residuals and their
    correlation. It is open (infinite) on the side where a tau of three times the length of the
    data cannot be excluded. Where an exponential explains no more than a constant does, the
    limit is the mean.

    Parameters
    ----------
    time : float array, shape (n_time,) [s]
    values : float array, shape (n_time,)
        The response after its fast part; all finite.

    Returns
    -------
    limit : float
    interval : (float, float)

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(1500) / 50.0
    >>> noise = np.random.default_rng(20261121).normal(0.0, 0.01, 1500)
    >>> limit, (low, high) = settle(time, 2.0 + np.exp(-time / 12.0) + noise)
    >>> low < 2.0 < high, high - low < 0.1
    (True, True)
    """
    rows = max(1, len(values) // _BLOCKS)
    whole = len(values) // rows * rows
    t = (time[:whole] - time[0]).reshape(-1, rows).mean(axis=1)
    y = values[:whole].reshape(-1, rows).mean(axis=1)
    count = len(y)
    length = float(t[-1] - t[0])
    rest = y - y.mean()

    def fit(taus: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Mean and power of the exponentials, their best heights, and the squares that remain."""
        shapes = np.exp(-t / taus[:, None])
        means = shapes.mean(axis=1)
        centred = shapes - means[:, None]
        power = np.einsum("ij,ij->i", centred, centred)
        heights = centred @ rest / power
        return means, power, heights, float(rest @ rest) - heights**2 * power

    coarse = np.geomspace(_FASTEST * length, _SLOWEST * length, _SPEEDS)
    misfits = fit(coarse)[3]
    best = int(misfits.argmin())
    shape = np.exp(-t / coarse[best])
    residual = rest - fit(coarse[best : best + 1])[2] * (shape - shape.mean())
    variance = max(float(residual @ residual) / max(count - 3, 1), np.finfo(float).tiny)
    follow = min(max(float(residual[1:] @ residual[:-1]) / max(float(residual @ residual), 1e-300), 0.0), 0.95)
    variance *= (1.0 + follow) / (1.0 - follow)
    if float(rest @ rest) - float(misfits[best]) <= 2.0 * _BAND * variance:
        half = math.sqrt(_BAND * variance / count)
        return float(y.mean()), (float(y.mean()) - half, float(y.mean()) + half)
    near = np.flatnonzero(misfits - misfits[best] <= _BAND * variance)
    fine = np.geomspace(coarse[max(near[0] - 1, 0)], coarse[min(near[-1] + 1, _SPEEDS - 1)], _SPEEDS)
    means, power, heights, misfits = fit(fine)
    best = int(misfits.argmin())
    limits = y.mean() - heights * means
    spare = _BAND * variance - (misfits - misfits[best])
    allowed = spare >= 0.0
    spreads = np.sqrt(np.maximum(spare, 0.0) * (1.0 / count + means**2 / power))
    low, high = float((limits - spreads)[allowed].min()), float((limits + spreads)[allowed].max())
    if allowed[-1] and fine[-1] >= coarse[-1]:  # slower still is possible: the limit is open on the side it moves to
        if heights[-1] > 0.0:
            low = -math.inf
        else:
            high = math.inf
    return float(limits[best]), (low, high)
