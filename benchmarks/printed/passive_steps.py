"""Which steps no strip can join: peaks against steady currents of two voltages, or of two clampings.

Both programs rest on the two ends of a step only, where a strip with a leak, or behind an unknown contact, still
gives linear inequalities between what was printed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from benchmarks.printed.passive import Joined, Nearest
from ipmclab.errors import InputError
from ipmclab.prediction.headline import READINGS, HeadlineRun

_STEP_METRICS: Final = ("peak_current", "steady_current")


def leaking_one_port(low: HeadlineRun, high: HeadlineRun) -> Joined:
    """How nearly one series resistance, and behind it a passive one-port with a monotone leak, gives two steps.

    Just after the step the node behind the series resistance R is at u, and the current is I = Y u + g(u) with the
    one-port's instant conductance Y and the leak g. With the voltages v times apart and I_2 < v I_1, the node
    u_2 = V_2 - R I_2 is above v u_1, so that I_2 - g(u_2) >= v (I_1 - g(u_1)). The node only rises from there, hence
    g(u_1) is at most the steady current S_1 at the lower voltage, and g(u_2) >= g(u_1): together
    I_2 >= v I_1 - (v - 1) S_1, whatever R, Y and g are. With S <= I for each step this is a linear program.

    Parameters
    ----------
    low, high : HeadlineRun
        Steps of one strip with one contact resistance, the second of the higher voltage.

    Raises
    ------
    InputError
        No steps, or the voltages the wrong way round.

    Examples
    --------
    >>> from ipmclab.prediction.headline import headline_runs
    >>> force = headline_runs(3, "force")
    >>> round(leaking_one_port(*force).error, 2)
    0.37
    """
    from scipy.optimize import linprog

    _check_steps((low, high))
    if not high.amplitude > low.amplitude:
        raise InputError(
            f"{high.amplitude:g} V is not above {low.amplitude:g} V",
            code="bad-order",
            where="high",
            repair="give the step of the lower voltage first",
        )
    ratio = high.amplitude / low.amplitude
    published = np.array([run.value(metric) for run in (low, high) for metric in _STEP_METRICS])
    tolerances = np.array([READINGS["step", metric].tolerance for _ in (low, high) for metric in _STEP_METRICS])
    bounds = [_is_bound(run, metric) for run in (low, high) for metric in _STEP_METRICS]
    scale = np.diag(published)
    # Variables: peak and steady current of the low and of the high step, each over its published value, and the error.
    physics = np.array([[ratio, -(ratio - 1.0), -1.0, 0.0], [-1.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 1.0]]) @ scale
    found = []
    for weights in (np.ones(4), tolerances):
        rows = [np.append(row / published.max(), 0.0) for row in physics]
        limits = [0.0] * len(rows)
        for i in range(4):
            for sign in (1.0, -1.0) if not bounds[i] else (-1.0,):
                row = np.zeros(5)
                row[i], row[4] = sign, -weights[i]
                rows.append(row)
                limits.append(sign)
        solved = linprog([0, 0, 0, 0, 1], A_ub=np.array(rows), b_ub=limits, bounds=(0.0, None), method="highs")
        found.append(solved)
    nearest = tuple(
        Nearest(run.figure, f"step {metric.replace('_', ' ')}", run.value(metric), float(value), _is_bound(run, metric))
        for (run, metric), value in zip(
            ((run, metric) for run in (low, high) for metric in _STEP_METRICS),
            found[0].x[:4] * published,
            strict=True,
        )
    )
    return Joined((low, high), float(found[0].fun), float(found[1].fun), nearest)


def one_strip(steps: Sequence[HeadlineRun]) -> Joined:
    """How nearly one passive linear one-port behind a contact resistance of each run's own gives some steps.

    A contact resistance adds as much to V/I just after the step as at its end, so that the difference of the two is
    the strip's alone, whatever the contact was. For an error each step allows an interval of that difference; the
    smallest error at which the intervals meet is found by halving.

    Parameters
    ----------
    steps : sequence of HeadlineRun
        Steps of one voltage, linear: with no leak.

    Raises
    ------
    InputError
        A run that is no step.

    Examples
    --------
    >>> from ipmclab.prediction.headline import headline_runs
    >>> steps = [run for run in headline_runs(2) if run.waveform == "step"]
    >>> one_strip(steps).possible
    False
    """
    _check_steps(steps)
    error, worst = (_smallest_meeting(steps, weighted=weighted) for weighted in (False, True))
    low, high = _differences(steps, error, weighted=False)
    difference = 0.5 * (max(low) + min(high))
    nearest = []
    for run in steps:
        # A contact resistance with which both currents are within the error.
        peak, steady = (run.amplitude / run.value(metric) for metric in _STEP_METRICS)
        inside = [peak / (1.0 + error), steady / (1.0 + error) - difference]
        outside = [np.inf if error >= 1 else peak / (1.0 - error), steady / (1.0 - error) - difference]
        start = 0.5 * (max(inside) + min(outside))
        if _is_bound(run, "peak_current"):
            start = max(inside[1], min(*outside, peak))
        for metric, value in zip(_STEP_METRICS, (start, start + difference), strict=True):
            nearest.append(
                Nearest(
                    run.figure,
                    f"step {metric.replace('_', ' ')}",
                    run.value(metric),
                    run.amplitude / value,
                    _is_bound(run, metric),
                )
            )
    return Joined(tuple(steps), error, worst, tuple(nearest))


def _is_bound(run: HeadlineRun, metric: str) -> bool:
    return any(row.metric == metric and row.qualifier == "lower_bound" for row in run.numbers)


def _check_steps(runs: Sequence[HeadlineRun]) -> None:
    for run in runs:
        if run.waveform != "step":
            raise InputError(
                f"figure {run.figure} is a {run.waveform}",
                code="no-step",
                where="runs",
                repair="give runs with a step, such as figure 5.6",
            )


def _differences(steps: Sequence[HeadlineRun], error: float, *, weighted: bool) -> tuple[list[float], list[float]]:
    """For each step the least and the largest difference of V/I between the end and the start."""
    low, high = [], []
    for run in steps:
        peak, steady = (run.amplitude / run.value(metric) for metric in _STEP_METRICS)
        of_peak, of_steady = (
            min(error * (READINGS["step", metric].tolerance if weighted else 1.0), 0.999) for metric in _STEP_METRICS
        )
        least = 0.0 if _is_bound(run, "peak_current") else peak / (1.0 + of_peak)
        low.append(max(0.0, steady / (1.0 + of_steady) - peak / (1.0 - of_peak)))
        high.append(steady / (1.0 - of_steady) - least)
    return low, high


def _smallest_meeting(steps: Sequence[HeadlineRun], *, weighted: bool) -> float:
    def meet(error: float) -> bool:
        low, high = _differences(steps, error, weighted=weighted)
        return max(low) <= min(high)

    if meet(0.0):
        return 0.0
    below, above = 0.0, 1.0
    while not meet(above):
        below, above = above, 2.0 * above
    while above - below > 1e-10 * above:
        middle = 0.5 * (below + above)
        below, above = (below, middle) if meet(middle) else (middle, above)
    return above
