"""The period of a run's voltage."""

from __future__ import annotations

from typing import Final

import numpy as np

from ipmclab.errors import InputError
from ipmclab.run import FloatArray, Run

_EQUAL: Final = 0.02


def period_of(run: Run) -> float | None:
    """Period of the voltage [s], from the signal that the run names, else from the voltage itself.

    Parameters
    ----------
    run : Run

    Returns
    -------
    period : float [s], or None
        None when the voltage is not periodic or the record holds less than one period.

    Examples
    --------
    >>> import numpy as np
    >>> from ipmclab.run import Run
    >>> time = np.arange(2000) / 50.0
    >>> round(period_of(Run.from_arrays(time=time, voltage=np.sin(2 * np.pi * 0.1 * time))), 6)
    10.0
    """
    length = float(run.time[-1] - run.time[0]) * len(run.time) / (len(run.time) - 1)
    named = _named(run.metadata.signal, length)
    period, begin = (_seen(run.time, run.voltage), 0.0) if named is None else named
    return period if period is not None and begin + period <= length * (1.0 + 1e-9) else None


def _named(text: str | None, length: float) -> tuple[float, float] | None:
    """The period that the text of a signal states, and from when on; None for free text and for signals without one.

    Of several signals in sequence it is that of the last one, as long as the record ends with it.
    """
    if text is None:
        return None
    from ipmclab.signals import Multisine, Sequence, parse

    try:
        signal = parse(text)
    except InputError:
        return None
    begin = 0.0
    if isinstance(signal, Sequence):
        before = len(signal.signals) - 1
        begin = sum(signal.durations[:before])
        if begin + sum(signal.durations[before:]) < length * (1.0 - 1e-9) and len(signal.durations) > before:
            return None  # rest follows
        signal = signal.signals[-1]
    frequency = signal.lowest_frequency if isinstance(signal, Multisine) else getattr(signal, "frequency", None)
    return (1.0 / frequency, begin) if frequency else None


def _seen(time: FloatArray, voltage: FloatArray) -> float | None:
    """Mean time between upward crossings of the middle, when at least three are equally spaced within 2 %."""
    low, high = float(voltage.min()), float(voltage.max())
    if high - low < 1e-9:
        return None
    middle, band = 0.5 * (high + low), 0.25 * (high - low)
    state = np.where(voltage > middle + band, 1, np.where(voltage < middle - band, -1, 0))
    rows = np.flatnonzero(state)
    ups = np.flatnonzero((state[rows[1:]] == 1) & (state[rows[:-1]] == -1))
    crossings = []
    for up in ups:
        start, stop = int(rows[up]), int(rows[up + 1])
        after = start + int(np.flatnonzero(voltage[start : stop + 1] <= middle)[-1])
        share = (middle - voltage[after]) / (voltage[after + 1] - voltage[after])
        crossings.append(time[after] + share * (time[after + 1] - time[after]))
    gaps = np.diff(crossings)
    if len(gaps) < 2 or np.ptp(gaps) > _EQUAL * gaps.mean():
        return None
    return float(gaps.mean())
