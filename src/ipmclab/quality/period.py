"""The period of a run's voltage."""

from __future__ import annotations

from typing import Final

import numpy as np

from ipmclab.errors import InputError
from ipmclab.quality.record import NO_VOLTAGE
from ipmclab.run import FloatArray, Run

_EQUAL: Final = 0.02  # part of the mean period by which periods may differ (convention)


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
    found = periodic_part(run)
    return None if found is None else found[0]


def periodic_part(run: Run) -> tuple[float, int] | None:
    """The period of the voltage [s], and the row after its last: a rest that follows does not belong to it.

    None as for ``period_of``.
    """
    rows = len(run.time)
    length = float(run.time[-1] - run.time[0]) * rows / (rows - 1)
    named = _named(run.metadata.signal, length)
    if named is None:
        return _observed_part(run)
    period, begin, end = named
    return None if begin + period > end * (1.0 + 1e-9) else (period, round(end / length * rows))


def _observed_part(run: Run) -> tuple[float, int] | None:
    """``periodic_part`` by the voltage alone."""
    driven = np.flatnonzero(np.abs(run.voltage) >= NO_VOLTAGE)
    period = _seen(run.time, run.voltage) if len(driven) else None
    if period is None:
        return None
    end = int(driven[-1]) + 1
    # A square of 0 and 1 V is at 0 V for half a period: only what is longer than any such stretch is a rest.
    return period, end if len(run) - end > int(np.diff(driven).max(initial=1)) else len(run)


def _named(text: str | None, length: float) -> tuple[float, float, float] | None:
    """The period that the text of a signal states, from when on, and until when; None where it states none.

    Of several signals in sequence it is that of the last one, but for a rest behind it.
    """
    if text is None:
        return None
    from ipmclab.signals import Multisine, Sequence, Step, parse

    try:
        signal = parse(text)
    except InputError:
        return None
    begin, end = 0.0, length
    if isinstance(signal, Sequence):
        parts, durations = [*signal.signals], [*signal.durations]
        while len(parts) > 1 and isinstance(parts[-1], Step) and parts[-1].amplitude == 0.0:
            del parts[-1]  # a rest
        signal = parts[-1]
        begin = sum(durations[: len(parts) - 1])
        if len(durations) >= len(parts):
            end = min(length, sum(durations[: len(parts)]))
    begin += signal.reach
    frequency = signal.lowest_frequency if isinstance(signal, Multisine) else getattr(signal, "frequency", None)
    return (1.0 / frequency, begin, end) if frequency else None


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
