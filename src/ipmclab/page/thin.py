"""Fewer points for a plot, without losing a peak or a gap."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

POINTS: Final = 2000
"""Of a curve, unless the browser asks for another number: about two for each pixel of its width."""


def thin(time: FloatArray, values: FloatArray, points: int = POINTS) -> tuple[FloatArray, FloatArray]:
    """First, lowest, highest and last point of each of many equal stretches of time (M4).

    Parameters
    ----------
    time : float array, shape (n_time,) [s]
        Rising.
    values : float array, shape (n_time,)
        NaN is a gap; each keeps one row, so that it shows.
    points : int
        At most so many, gaps not counted.

    Returns
    -------
    time, values : float array, shape (n,)

    Examples
    --------
    >>> spike = np.zeros(100_000)
    >>> spike[31_415] = 1.0
    >>> t, v = thin(np.arange(100_000.0), spike, 400)
    >>> len(t) <= 400, float(t[v.argmax()])
    (True, 31415.0)
    """
    points -= points % 4
    if len(time) <= max(points, 4):
        return time, values
    from tsdownsample import M4Downsampler

    m4 = M4Downsampler()  # type: ignore[no-untyped-call]
    known = np.isfinite(values)
    if known.all():
        rows = m4.downsample(np.ascontiguousarray(time), np.ascontiguousarray(values), n_out=points)
        return time[rows], values[rows]
    there = np.flatnonzero(known)
    if not len(there):
        return time[[0, -1]], values[[0, -1]]
    if len(there) > points:
        kept = m4.downsample(np.ascontiguousarray(time[there]), np.ascontiguousarray(values[there]), n_out=points)
        there = there[kept]
    gaps = np.flatnonzero(~known[1:] & known[:-1]) + 1
    rows = np.union1d(there, gaps[:: max(1, len(gaps) // points)])
    return time[rows], values[rows]


def within(time: FloatArray, begin: float | None, end: float | None) -> slice:
    """The rows of a stretch of time, with one more at either side so that lines run to the edge."""
    first = 0 if begin is None else max(0, int(np.searchsorted(time, begin)) - 1)
    last = len(time) if end is None else min(len(time), int(np.searchsorted(time, end, side="right")) + 1)
    return slice(first, last)


def envelope(time: FloatArray, columns: list[FloatArray], rows: int) -> tuple[FloatArray, list[FloatArray]]:
    """Two rows for each whole bunch of rows: the lowest and the highest value of each column, in their order.

    Parameters
    ----------
    time : float array, shape (n_time,)
    columns : list of float array, shape (n_time,)
    rows : int
        Of a bunch; what is left over at the end is left out.

    Examples
    --------
    >>> t, (v,) = envelope(np.arange(6.0), [np.array([0.0, 9.0, 1.0, 5.0, 4.0, 3.0])], 3)
    >>> v.tolist()
    [0.0, 9.0, 5.0, 3.0]
    """
    bunches = len(time) // rows
    whole = bunches * rows
    times = time[:whole].reshape(bunches, rows)
    found = []
    for column in columns:
        block = column[:whole].reshape(bunches, rows)
        unknown = np.isnan(block)
        low, high = np.where(unknown, np.inf, block), np.where(unknown, -np.inf, block)
        at_low, at_high = low.argmin(axis=1), high.argmax(axis=1)
        pair = np.stack([low.min(axis=1), high.max(axis=1)], axis=1)
        pair[at_low > at_high] = pair[at_low > at_high][:, ::-1]
        pair[~np.isfinite(pair)] = np.nan
        found.append(pair.reshape(-1))
    return times[:, [0, rows // 2]].reshape(-1) if rows > 1 else times.repeat(2), found
