"""Rows at 0 V before the voltage first moves: how many there are, and what they read, touched wires aside."""

from __future__ import annotations

from typing import Final

import numpy as np

from ipmclab.run import FloatArray, Run

_NO_REST: Final = 0.02  # of the largest voltage, and more (convention)
_STILL: Final = 0.002  # of the largest voltage, and less, however little its first rows scatter (convention)
_RISES: Final = 0.05  # of the largest voltage, in less time than it rested before (convention)
_SCATTERS: Final = 5.0  # standard deviations (convention)
_SPIKE: Final = 5.0  # standard deviations about a resistant line, beyond which a reading is no noise (convention)


def rows_near_zero(run: Run) -> int:
    """How many rows come before the voltage first is more than a fiftieth of its largest: those of a slow wave too.

    Examples
    --------
    >>> rows_near_zero(Run.from_arrays(time=[0.0, 1.0, 2.0, 3.0], voltage=[0.0, 0.01, 0.03, 1.0]))
    2
    """
    size = np.abs(run.voltage)
    on = size > _NO_REST * float(size.max(initial=0.0))
    return int(np.argmax(on)) if on.any() else len(run)


def rest_rows(run: Run) -> int:
    """How many rows come before the voltage first moves away from 0, or 0 when it is on from the first.

    A step leaves it at once, a wave slowly: what its first rows scatter over, the half of those before it is surely on,
    says when it leaves and stays away. A wave that begins at once is near 0 too, for less time than it then takes to
    rise. A voltage that never moves rests in every row.

    Examples
    --------
    >>> rest_rows(Run.from_arrays(time=[0.0, 1.0, 2.0], voltage=[0.0, 0.001, 1.0]))
    2
    >>> rest_rows(Run.from_arrays(time=[0.0, 1.0, 2.0, 3.0], voltage=[0.0, 0.0, 0.01, 1.0]))
    2
    >>> rest_rows(Run.from_arrays(time=[0.0, 1.0, 2.0, 3.0], voltage=[0.0, 0.01, 0.03, 1.0]))
    0
    """
    near = rows_near_zero(run)
    if near in (0, len(run)):
        return near
    size, quiet = np.abs(run.voltage), run.voltage[:near]
    largest = float(size.max())
    first = quiet[: (len(quiet) + 1) // 2]
    scatter = max(_STILL * largest, _SCATTERS * float(np.std(first)))
    still = np.flatnonzero(np.abs(quiet - np.median(first)) <= scatter)
    rows = int(still[-1]) + 1 if len(still) else 0
    return rows if int(np.argmax(size > _RISES * largest)) <= 2 * rows else 0


def without_spikes(time: FloatArray, values: FloatArray, step: float) -> FloatArray:
    """Readings, those that lie far from a resistant line brought back to where noise would end.

    A wire that is touched before a run gives spikes a hundred times as large as the noise, and least squares would
    take them for a slope that is not known and for noise that no run has. The line is Tukey's: through the medians of
    the first and the last third.

    Parameters
    ----------
    time : float array, shape (n,) [s]
    values : float array, shape (n,)
    step : float
        Of the converter: nothing is told within it.

    Examples
    --------
    >>> import numpy as np
    >>> time = np.arange(9.0)
    >>> without_spikes(time, np.where(time == 4.0, 40.0, 0.1 * time), 0.1).round(2).tolist()
    [0.0, 0.1, 0.2, 0.3, 0.9, 0.5, 0.6, 0.7, 0.8]
    """
    third = len(time) // 3
    if third == 0:
        return values
    first, last = slice(0, third), slice(len(time) - third, None)
    slope = (np.median(values[last]) - np.median(values[first])) / (np.median(time[last]) - np.median(time[first]))
    line = slope * (time - np.median(time))
    line = line + np.median(values - line)
    away = values - line
    reach = _SPIKE * max(1.4826 * float(np.median(np.abs(away))), step)
    return np.where(np.abs(away) > reach, line + np.clip(away, -reach, reach), values)
