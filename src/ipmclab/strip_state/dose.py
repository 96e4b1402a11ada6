"""Dose: what a strip had been through before each of its runs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from datetime import datetime
from itertools import pairwise

import numpy as np

from ipmclab.errors import InputError
from ipmclab.run import Run
from ipmclab.strip_state.run_state import RunState


def doses_of(runs: Sequence[Run], scale: str) -> list[float]:
    """What the strip had been through before each run.

    The order is that of ``recorded_at`` where every run states it, else that of ``run_number``, else the given one.

    Parameters
    ----------
    runs : sequence of Run
    scale : "runs", "hours" or "charge"
        The runs since the first one, the hours since it, or the charge that passed in either direction. Runs are
        counted by ``run_number`` where every run states it and the numbers rise with the order: those that are not
        given count too. Else the runs that are given are counted.

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
            "the dose is to be counted in hours, and this run does not state when it was recorded",
            code="no-time-of-run",
            where=f"runs[{next(place for place, one in enumerate(times) if math.isnan(one))}]",
            repair="state recorded_at, or count the dose in runs",
        )
    elif all(number is not None for number in numbers):
        keys = [float(number) for number in numbers if number is not None]
    else:
        keys = list(map(float, range(len(runs))))
    if scale == "hours":
        return [(key - min(keys)) / 3600.0 for key in keys]
    order = sorted(range(len(runs)), key=keys.__getitem__)
    if scale == "runs":
        stated = [numbers[place] for place in order]
        known = [float(number) for number in stated if number is not None]
        if len(known) < len(runs) or any(later <= sooner for sooner, later in pairwise(known)):
            known = list(map(float, range(len(runs))))
        return [known[order.index(place)] - known[0] for place in range(len(runs))]
    found, total = [0.0] * len(runs), 0.0
    for place in order:
        found[place] = total
        total += added_by(runs[place], scale, place)
    return found


def added_by(run: Run, scale: str, place: int) -> float:
    """What one run adds to a dose: itself, its hours, or the charge that passed.

    Examples
    --------
    >>> run = Run.from_arrays(time=[0.0, 1.0, 2.0], voltage=[1.0, 1.0, 1.0], current=[0.0, 2.0, 2.0])
    >>> added_by(run, "runs", 0), added_by(run, "charge", 0)
    (1.0, 3.0)
    """
    if scale == "runs":
        return 1.0
    return float(run.time[-1] - run.time[0]) / 3600.0 if scale == "hours" else _charge(run, place)


def dose_now(states: Iterable[RunState], scale: str) -> float:
    """What a strip had been through after the last of some runs.

    Examples
    --------
    >>> dose_now([RunState(doses={"charge": 2.0}, adds={"charge": 0.5})], "charge")
    2.5
    """
    return max((one.doses.get(scale, 0.0) + one.adds.get(scale, 0.0) for one in states), default=0.0)


def recorded(run: Run) -> float:
    """When a run began [s]; NaN where it does not say."""
    try:
        return datetime.fromisoformat(run.metadata.recorded_at or "").timestamp()
    except (ValueError, OverflowError, OSError):  # Windows knows no local time before 1970
        return math.nan


def _charge(run: Run, place: int) -> float:
    """What flowed in either direction [C]; between readings that are missing, along a straight line."""
    there = np.zeros(0, dtype=bool) if run.current is None else np.isfinite(run.current)
    if run.current is None or not there.any():
        raise InputError(
            "the dose is to be counted in charge, and this run has no current",
            code="no-readings",
            where=f"runs[{place}]",
            repair="count the dose in runs or hours",
        )
    size = np.abs(run.current[there])
    return float(np.sum(0.5 * (size[1:] + size[:-1]) * np.diff(run.time[there])))
