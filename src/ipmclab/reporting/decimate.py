"""Fewer points for a curve, without losing a peak or an edge."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_EDGE: Final = 0.1
"""Share of a curve's range that neighbouring rows differ by at an edge; a smaller slant is not visible."""

_EDGES: Final = 2
"""Edges that are kept of a stretch: those of a pulse."""


def decimate(x: FloatArray, y: FloatArray, *, buckets: int = 400) -> tuple[FloatArray, FloatArray]:
    """Keep the lowest and the highest point of each of many equal stretches of rows, and both sides of its edges.

    Between points that are kept a line is drawn: without the rows next to an edge a step would be a slope as long as
    two stretches.

    Parameters
    ----------
    x, y : float array, shape (n_time,)
        NaN in ``y`` is a gap; a stretch with nothing but gaps stays a gap.
    buckets : int
        How many stretches; a curve of at most twice as many points is left as it is.

    Returns
    -------
    x, y : float array, shape (at most 6 buckets + 2,)

    Examples
    --------
    >>> y = np.zeros(10000)
    >>> y[1234] = 1.0
    >>> fewer, heights = decimate(np.arange(10000.0), y)
    >>> len(heights), float(heights.max())
    (404, 1.0)
    """
    if len(x) <= 2 * buckets:
        return x, y
    ends = np.linspace(0, len(x), buckets + 1).astype(int)
    known = y[np.isfinite(y)]
    steps = np.nan_to_num(np.abs(np.diff(y)))
    steps[steps <= _EDGE * float(np.ptp(known) if len(known) else 0.0)] = 0.0
    # Asked of all stretches at once: some calls for each of 400 cost more than drawing what is left.
    missing = np.isnan(y)
    lows, highs = np.where(missing, np.inf, y), np.where(missing, -np.inf, y)
    is_gap = np.logical_and.reduceat(missing, ends[:-1]).tolist()
    has_edge = (np.maximum.reduceat(steps, ends[:-1]) > 0.0).tolist()
    rows: set[int] = {0, len(x) - 1}
    for place, (start, stop) in enumerate(itertools.pairwise(ends.tolist())):
        if is_gap[place]:
            rows.add(start)
            continue
        rows |= {start + int(lows[start:stop].argmin()), start + int(highs[start:stop].argmax())}
        if has_edge[place]:
            largest = start + np.argsort(steps[start:stop])[-_EDGES:]
            rows |= {int(row) + side for row in largest if steps[row] > 0.0 for side in (0, 1)}
    kept = sorted(rows)
    return x[kept], y[kept]
