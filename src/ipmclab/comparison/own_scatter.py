"""How far the readings of one strip scatter by themselves, where that is more than those of the others do.

Strips are taken to scatter alike in what they share: mountings and repeats. One that scatters more has a mean that is
known less well, and would be called unlike the others for it. So its mean is as uncertain as its own readings say,
with as many degrees of freedom as they have (Welch, Biometrika 29 (1938) 350).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class OwnScatter:
    """The variance of the mean of one strip, as its own readings say.

    Parameters
    ----------
    variance : float
    freedom : float
        Degrees of freedom with which it is known.
    """

    variance: float
    freedom: float

    def beyond(self, usual: npt.ArrayLike) -> FloatArray:
        """By how much it is more than what is usual among the others; 0 where it is less."""
        return np.asarray(np.maximum(self.variance - np.asarray(usual, dtype=np.float64), 0.0))


def own_scatter(values: FloatArray, mountings: Sequence[str]) -> OwnScatter:
    """How far the mean of one strip is uncertain by what its mountings and its repeats scatter.

    Parameters
    ----------
    values : float array, shape (n,)
        Its readings, less what the factors do.
    mountings : sequence of str, length n

    Examples
    --------
    Two mountings that differ by 2: their mean has a standard error of 1.

    >>> own_scatter(np.array([0.0, 0.0, 2.0, 2.0]), ["1", "1", "2", "2"])
    OwnScatter(variance=1.0, freedom=1.0)
    """
    number = np.unique(np.asarray(mountings), return_inverse=True)[1].ravel()
    counts = np.bincount(number)
    means = np.bincount(number, values) / counts
    within, freedom = float(np.sum((values - means[number]) ** 2)), len(values) - len(counts)
    found = [OwnScatter(within / freedom / len(values), float(freedom))] if freedom else []
    if len(counts) > 1:
        shares = (counts / len(values)) ** 2
        left = float(shares @ (1.0 - 2.0 * np.sqrt(shares) + shares.sum()))  # of the variance, about their own mean
        away = float(shares @ (means - values.mean()) ** 2)
        found.append(OwnScatter(away * float(shares.sum()) / left, float(len(counts) - 1)))
    return max(found, key=lambda one: one.variance, default=OwnScatter(0.0, 1.0))
