"""Fewer points for a curve, without losing a peak."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def decimate(x: FloatArray, y: FloatArray, *, buckets: int = 400) -> tuple[FloatArray, FloatArray]:
    """Keep the lowest and the highest point of each of many equal stretches of rows.

    Parameters
    ----------
    x, y : float array, shape (n_time,)
        NaN in ``y`` is a gap; a stretch with nothing but gaps stays a gap.
    buckets : int
        How many stretches; a curve of at most twice as many points is left as it is.

    Returns
    -------
    x, y : float array, shape (at most 2 buckets + 2,)

    Examples
    --------
    >>> y = np.zeros(10000)
    >>> y[1234] = 1.0
    >>> fewer, heights = decimate(np.arange(10000.0), y)
    >>> len(heights), float(heights.max())
    (802, 1.0)
    """
    if len(x) <= 2 * buckets:
        return x, y
    edges = np.linspace(0, len(x), buckets + 1).astype(int)
    rows: list[int] = [0]
    for start, stop in itertools.pairwise(edges.tolist()):
        stretch = y[start:stop]
        if np.all(np.isnan(stretch)):
            rows.append(start)
            continue
        lowest, highest = int(np.nanargmin(stretch)), int(np.nanargmax(stretch))
        rows += [start + min(lowest, highest), start + max(lowest, highest)]
    rows.append(len(x) - 1)
    return x[rows], y[rows]
