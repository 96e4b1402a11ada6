"""The range of readings, against which a residual is held wherever it is said relative to one."""

from __future__ import annotations

import numpy as np

from ipmclab.run import FloatArray


def ends_of(values: FloatArray) -> tuple[float, float]:
    """The lowest and the highest of some readings, each the median of three: a single spike is no range of a strip.

    Parameters
    ----------
    values : float array, shape (n_readings,)
        One or more, in the order in which they were read.

    Examples
    --------
    >>> ends_of(np.array([0.0, 0.1, 49.9, 0.3, 0.4, 0.5]))
    (0.1, 0.4)
    """
    if len(values) >= 3:
        values = np.median(np.lib.stride_tricks.sliding_window_view(values, 3), axis=1)
    return float(values.min()), float(values.max())


def span_of(values: FloatArray) -> float:
    """From the lowest to the highest of some readings."""
    low, high = ends_of(values)
    return high - low
