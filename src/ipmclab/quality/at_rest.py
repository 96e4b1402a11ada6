"""A strip that was not at rest when its run began: a current that still moves at 0 V."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ipmclab.quality.noise import variance_for_means
from ipmclab.quality.record import Channel, Record
from ipmclab.run import Finding, FloatArray

_FEWEST: Final = 20  # rows at 0 V of which a mean is taken (convention)
_STANDARD_ERRORS: Final = 5.0  # standard errors: one in 1.7 million by chance (convention)
_SHARE: Final = 1e-3
"""A change of the current by less than this share of its range is none (convention)."""

_DECAYS: Final = (2.0, 12.0)
"""Rates [1/duration of the rows] of two decays: together they follow a discharge of a time constant between 0.08 and 3
of these durations to a tenth of its height (convention)."""


def not_at_rest(record: Record) -> list[Finding]:
    """``not-at-rest``: before the voltage first moves, the current falls towards zero, as that of a discharge does.

    A sensor's zero does not move; what moves at 0 V is the strip. The means of the first and the last fifth of the rows
    must differ by five standard errors, two steps of the converter and a thousandth of the range. The errors are those
    of noise that is autocorrelated, in what two decays leave of these rows.
    """
    current = record.channels.get("current")
    if current is None or not record.excited:
        return []
    stop = record.resting
    if stop >= _FEWEST and (current.missing is None or not current.missing[:stop].any()):
        return _of_rows(record, current, stop)
    if record.run.metadata.starts_from_rest is False:
        return [_finding("while the channels were read at 0 V before the run, the current still fell", None, 0)]
    return []


def _of_rows(record: Record, current: Channel, stop: int) -> list[Finding]:
    fifth = stop // 5
    first, last = current.readings[:fifth], current.readings[stop - fifth : stop]
    begins, ends = float(first.mean()), float(last.mean())
    doubt = max(_STANDARD_ERRORS * math.sqrt(2.0 * _variance(current.readings[:stop]) / fifth), 2.0 * current.quantum)
    doubt = max(doubt, _SHARE * current.span)
    if math.copysign(1.0, begins) * (begins - ends) <= doubt or abs(ends) >= abs(begins):
        return []
    seconds = float(record.run.time[stop - 1] - record.run.time[0])
    fall = f"from {current.show(begins)} to {current.show(ends)} in {seconds:.3g} s"
    text = f"before the voltage moves, the current falls {fall}"
    return [_finding(text, _wait(begins, ends, doubt, 0.8 * seconds), stop)]


def _variance(readings: FloatArray) -> float:
    """Of the noise of readings, as large as it counts for means: a decay does not count as noise."""
    passed = np.linspace(0.0, 1.0, len(readings))
    decays = np.column_stack([np.ones(len(readings)), *(np.exp(-rate * passed) for rate in _DECAYS)])
    left = readings - decays @ np.linalg.lstsq(decays, readings, rcond=None)[0]
    return variance_for_means(left, decays.shape[1])


def _wait(begins: float, ends: float, doubt: float, between: float) -> float:
    """How long [s] it takes, at the present pace of the decay, until nothing of it is visible; it slows down, too."""
    if ends * begins <= 0.0 or abs(ends) <= doubt:
        return between
    return between / math.log(begins / ends) * math.log(abs(ends) / doubt)


def _finding(message: str, wait: float | None, stop: int) -> Finding:
    longer = "longer" if wait is None else f"{_rounded_up(wait):g} s longer or more"
    return Finding(
        code="not-at-rest",
        severity="warning",
        channel="current",
        message=f"{message}: the strip was not at rest, it still discharged",
        repair=(
            f"let it rest {longer} at 0 V before such a run (`pause` in the experiment file) and record it again; "
            "nothing is taken off this channel as a sensor's zero"
        ),
        samples=((0, stop),) if stop else (),
        values={} if wait is None else {"wait": wait},
    )


def _rounded_up(seconds: float) -> float:
    """To two digits: nobody knows more."""
    step = 10.0 ** (math.floor(math.log10(max(seconds, 1.0))) - 1)
    return max(1.0, math.ceil(seconds / step) * step)
