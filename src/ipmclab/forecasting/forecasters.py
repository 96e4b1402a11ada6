"""What may continue by itself: a straight line, and the slow answer to the voltage, learnt from the record up to a
step.

A slow answer is a sum of first-order lags of the voltage, 1 to 100 s, distributed evenly over the logarithm, and a
drift. What else moves a strip is taken as a random walk, whose changes from one second to the next are independent. So
the coefficients are found by least squares on those changes, each with a prior of 0 plus or minus the largest
excursion so far (the drift: in 100 s). With an actuator, its response is taken off first and added again.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from ipmclab.forecasting.past import Past
from ipmclab.forecasting.stacking import LEADS, MEMORY, Pairs

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

TIME_CONSTANTS: Final = (1.0, 3.0, 10.0, 30.0, 100.0)
"""Half a decade apart, over which voltages act [s] (convention)."""

DRIFT_TIME: Final = 100.0  # s in which a drift is thought to do what a lag does (convention)
LINE_SPAN: Final = 5.0  # s through which a line is drawn (convention)
CHANGE: Final = 1.0  # s from one reading to the next of which a change is taken (convention)
LEARNT: Final = 2.0 * CHANGE
"""Seconds after the first reading before anything is forecast (derived)."""
_PER_HORIZON: Final = 50  # past forecasts in a horizon: neighbours say the same (convention)
HORIZONS: Final = 5.0 * MEMORY
"""Horizons after which a miss is left out, five memories: it would count less than 1 % (derived)."""
_TURNS: Final = 3  # of variance and coefficients, after which both stay (convention)
_LEAST_PRIOR: Final = 1e-10  # of the largest: keeps a division finite (a limit)


class Forecaster(Protocol):
    """One way in which a reading may continue while the voltage stays."""

    def change(self, origins: IntArray, later: int) -> FloatArray:
        """By how much readings change from some of the past origins, so many steps later [SI]."""
        ...

    def ahead(self) -> FloatArray:
        """By how much they change from the last step to the rows ahead [SI]."""
        ...


def past_origins(past: Past, horizon: float) -> IntArray:
    """The steps from which forecasts are made, the last one among them."""
    stride = max(1, int(horizon / _PER_HORIZON / past.step))
    oldest = max(past.first + round(LEARNT / past.step), past.now - int(HORIZONS * horizon / past.step))
    return np.arange(past.now, oldest - 1, -stride, dtype=np.intp)[::-1]


def _lead_steps(past: Past, horizon: float) -> IntArray:
    return np.unique([max(1, round(horizon * part / LEADS / past.step)) for part in range(1, LEADS + 1)])


def shown(past: Past, origins: IntArray, horizon: float) -> float:
    """The part of the plan that past misses show: how far the voltage moved from a past origin, over how far it will.

    Mean squares of what it moves by within the leads; 1 where it moved as far from one of them, 0 where it always
    stayed.
    """
    leads, volts = _lead_steps(past, horizon), past.planned
    later = origins[:, None] + leads
    came = np.where(later <= past.now, volts[np.minimum(later, past.now)] - volts[origins][:, None], 0.0)
    comes = volts[np.minimum(past.now + leads, len(volts) - 1)] - volts[past.now]
    plan = float(np.mean(comes**2))
    return min(float(np.max(np.mean(came**2, axis=1), initial=0.0)) / plan, 1.0) if plan > 0.0 else 0.0


def judge(past: Past, origins: IntArray, forecasters: Sequence[Forecaster], horizon: float) -> Pairs:
    """What forecasters said from past origins, and what came."""
    steps = _lead_steps(past, horizon)
    stride = past.step * float(origins[1] - origins[0]) if len(origins) > 1 else past.step
    leads, counts, said, came = [], [], [], []
    for later in steps:
        row = np.flatnonzero(origins + later <= past.now)
        row = row[np.isfinite(past.readings[origins[row]]) & np.isfinite(past.readings[origins[row] + later])]
        age = past.step * (past.now - later - origins[row])
        leads.append(np.full(len(row), later * past.step))
        counts.append(stride / (horizon * len(steps)) * np.exp(-age / (MEMORY * horizon)))
        said.append(np.column_stack([one.change(row, int(later)) for one in forecasters]))
        came.append(past.readings[origins[row] + later] - past.readings[origins[row]])
    before = MEMORY * float(np.exp(-past.step * (past.now - past.first) / (MEMORY * horizon)))
    return Pairs(np.concatenate(leads), np.concatenate(counts), np.concatenate(said), np.concatenate(came), before)


class Line:
    """The straight line through the last seconds continues."""

    def __init__(self, past: Past, origins: IntArray) -> None:
        self.past, self.origins = past, origins

    @cached_property
    def _lines(self) -> tuple[FloatArray, FloatArray]:
        """Of each origin: the line at its step less the reading there, and its slope."""
        past = self.past
        last = max(2, round(LINE_SPAN / past.step))
        rows = self.origins[:, None] + np.arange(1 - last, 1)
        known = (rows >= past.first) & np.isfinite(past.readings[np.maximum(rows, 0)])
        share = known / np.maximum(known.sum(axis=1), 1)[:, None]
        time = past.step * np.arange(1.0 - last, 1.0)
        level = np.where(known, past.readings[np.maximum(rows, 0)] - past.filled[self.origins][:, None], 0.0)
        middle, mean = share @ time, np.sum(share * level, axis=1)
        away = time - middle[:, None]
        variance = np.sum(share * away**2, axis=1)
        slope = np.where(
            variance > 0.0, np.sum(share * away * level, axis=1) / np.where(variance > 0.0, variance, 1.0), 0.0
        )
        return mean - slope * middle, slope

    def change(self, origins: IntArray, later: int) -> FloatArray:
        start, slope = self._lines
        return np.asarray(start[origins] + slope[origins] * later * self.past.step)

    def ahead(self) -> FloatArray:
        start, slope = self._lines
        return np.asarray(start[-1] + slope[-1] * self.past.leads)


class SlowAnswer:
    """The slow answer to the voltage continues; with an actuator, in addition to its response.

    Parameters
    ----------
    past : Past
    origins : int array, shape (n_origins,)
    response : float array, shape (n_steps,), optional
        An actuator's.
    """

    def __init__(self, past: Past, origins: IntArray, response: FloatArray | None = None) -> None:
        self.past, self.origins = past, origins
        self.response = np.zeros(len(past.held)) if response is None else response

    @cached_property
    def columns(self) -> FloatArray:
        """Lags and drift at every step, those ahead among them, for the voltage as it stays at the origin."""
        return slow_columns(self.past, self.past.held)

    @cached_property
    def coefficients(self) -> FloatArray:
        """What was learnt up to each origin, shape (n_origins, n_columns) [SI]."""
        past, size = self.past, self.columns.shape[1]
        readings = past.readings - self.response[: past.now + 1]
        before = _per_change(past)
        change, by, there = np.zeros(past.now + 1), np.zeros((past.now + 1, size)), np.zeros(past.now + 1)
        rows = np.arange(past.first + before, past.now + 1)
        rows = rows[np.isfinite(readings[rows] - readings[rows - before])]
        change[rows] = readings[rows] - readings[rows - before]
        by[rows] = self.columns[rows] - self.columns[rows - before]
        there[rows] = 1.0
        # Each second is in as many changes as it has steps.
        number = self._up_to_origins(there) / before
        table = self._up_to_origins(by[:, :, None] * by[:, None, :]) / before
        right = self._up_to_origins(by * change[:, None]) / before
        square = self._up_to_origins(change**2) / before
        away = np.abs(past.filled - past.filled[past.first])
        away[: past.first] = 0.0
        largest = np.maximum.accumulate(away)[self.origins] ** 2
        variance = square / np.maximum(number, 1.0)
        found = np.zeros((len(self.origins), size))
        for _ in range(_TURNS):  # the variance of the walk's changes, from what the coefficients leave
            prior = np.maximum(variance / np.maximum(largest, 1e-300), _LEAST_PRIOR)
            found = np.linalg.solve(table + prior[:, None, None] * np.eye(size), right[:, :, None])[:, :, 0]
            explained = 2.0 * np.einsum("ja,ja->j", found, right)
            explained -= np.einsum("ja,jab,jb->j", found, table, found)
            variance = np.maximum(square - explained, 0.0) / np.maximum(number, 1.0)
        return found

    def _up_to_origins(self, values: FloatArray) -> FloatArray:
        """Sums over the steps up to each origin."""
        starts = np.concatenate([[0], self.origins[:-1] + 1])
        return np.asarray(np.cumsum(np.add.reduceat(values[: self.origins[-1] + 1], starts, axis=0), axis=0))

    def change(self, origins: IntArray, later: int) -> FloatArray:
        steps = self.origins[origins]
        moved = np.einsum("ja,ja->j", self.coefficients[origins], self.columns[steps + later] - self.columns[steps])
        return np.asarray(moved + self.response[steps + later] - self.response[steps])

    def ahead(self) -> FloatArray:
        now = self.past.now
        slow = self.coefficients[-1] @ (self._at_rows(self.columns) - self.columns[now]).T
        return np.asarray(slow + self._at_rows(self.response[:, None])[:, 0] - self.response[now])

    def planned(self) -> FloatArray:
        """What the plan changes against a voltage that stays [SI]."""
        planned = slow_columns(self.past, self.past.planned)
        return np.asarray(self.coefficients[-1] @ self._at_rows(planned - self.columns).T)

    def of_first_edge(self) -> FloatArray:
        """What was answered since the voltage came on, as the last coefficients have it, shape (n_steps,) [SI].

        With an actuator its response alone, which a plan gets in full where the past does not show it; and the drift.
        """
        past, drift = self.past, np.zeros(self.columns.shape)
        drift[:, -1] = past.step * (np.arange(len(drift)) - past.edge_step) / DRIFT_TIME
        if past.response is None:
            drift[:, :-1] = self.columns[:, :-1]
        return np.asarray(drift @ self.coefficients[-1] + self.response)

    def _at_rows(self, columns: FloatArray) -> FloatArray:
        past = self.past
        place = past.now + past.leads / past.step
        # The last row lies up to half a step beyond the middle of the last step.
        longer = np.vstack([columns, 2.0 * columns[-1] - columns[-2]])
        return np.column_stack([np.interp(place, np.arange(len(longer)), one) for one in longer.T])


def slow_columns(past: Past, voltage: FloatArray) -> FloatArray:
    """Lags of a voltage, over its largest, and a drift; shape (n_steps, n_columns)."""
    from scipy.signal import lfilter

    scale = max(float(np.abs(voltage[: past.now + 1]).max(initial=0.0)), 1e-300)
    kept = np.exp(-past.step / np.array(TIME_CONSTANTS))
    lags = [lfilter([1.0 - one], [1.0, -one], voltage / scale) for one in kept]
    return np.column_stack([*lags, past.step * np.arange(len(voltage)) / DRIFT_TIME])


def _per_change(past: Past) -> int:
    return max(1, round(CHANGE / past.step))
