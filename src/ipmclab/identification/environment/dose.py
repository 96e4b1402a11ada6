"""Dose: what a strip had been through before each of its runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import datetime

import numpy as np

from ipmclab.errors import InputError
from ipmclab.run import Run


def doses_of(runs: Sequence[Run], scale: str) -> list[float]:
    """What the strip had been through before each run.

    The order is that of ``recorded_at`` where every run states it, else that of ``run_number``, else the given one.

    Parameters
    ----------
    runs : sequence of Run
    scale : "runs", "hours" or "charge"
        The runs before, the hours since the first one, or the charge that passed in either direction.

    Returns
    -------
    doses : list of float
        [1], [h] or [C], as runs are given.

    Raises
    ------
    InputError
        Hours without the time of each run, charge without the current of each run.

    Examples
    --------
    >>> from ipmclab import RunMetadata
    >>> runs = [
    ...     Run.from_arrays(time=[0.0, 1.0], voltage=[1.0, 1.0], metadata=RunMetadata(run_number=number))
    ...     for number in (7, 5, 6)
    ... ]
    >>> doses_of(runs, "runs")
    [2.0, 0.0, 1.0]
    """
    times = [recorded(run) for run in runs]
    numbers = [run.metadata.run_number for run in runs]
    keys: list[float]
    if not any(math.isnan(one) for one in times):
        keys = times
    elif scale == "hours":
        raise InputError(
            "hours are asked for, and this run does not say when it was recorded",
            code="no-time-of-run",
            where=f"runs[{next(place for place, one in enumerate(times) if math.isnan(one))}]",
            repair="state recorded_at, or count the dose in runs",
        )
    elif all(number is not None for number in numbers):
        keys = [float(number or 0) for number in numbers]
    else:
        keys = list(map(float, range(len(runs))))
    if scale == "hours":
        return [(key - min(keys)) / 3600.0 for key in keys]
    order = sorted(range(len(runs)), key=keys.__getitem__)
    each = [1.0] * len(runs) if scale == "runs" else [_charge(run, place) for place, run in enumerate(runs)]
    found, total = [0.0] * len(runs), 0.0
    for place in order:
        found[place] = total
        total += each[place]
    return found


def recorded(run: Run) -> float:
    """When a run began [s]; NaN where it does not say."""
    try:
        return datetime.fromisoformat(run.metadata.recorded_at or "").timestamp()
    except ValueError:
        return math.nan


def _charge(run: Run, place: int) -> float:
    """What flowed in either direction [C]."""
    if run.current is None:
        raise InputError(
            "a dose in charge is asked for, and this run has no current",
            code="no-readings",
            where=f"runs[{place}]",
            repair="count the dose in runs or hours",
        )
    size = np.abs(np.nan_to_num(run.current))
    return float(np.sum(0.5 * (size[1:] + size[:-1]) * np.diff(run.time)))
