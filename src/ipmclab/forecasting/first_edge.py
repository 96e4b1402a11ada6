"""How far a plan may be missed that the past does not show: as far as the first edge of the record was.

Misses of past forecasts say nothing of a move of the voltage where it always stayed. But it came on once, and what the
strip did from there on was read. Of a linear strip an answer that missed that edge misses every other one alike, over
its volts: the miss of a plan is that of its changes, one after the other.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ipmclab.forecasting.past import Past

FloatArray = npt.NDArray[np.float64]


def missed_of_plan(past: Past, said: FloatArray) -> FloatArray | None:
    """How far the answer to the plan may be off at the rows ahead, shape (n_ahead,) [SI]; None where no edge was read.

    Never less than at a row before: a miss that crosses zero is no sign that the answer is right there.

    Parameters
    ----------
    past : Past
    said : float array, shape (n_steps,) [SI]
        What the answer was to the voltage so far, from 0 before it came on.
    """
    changes = np.diff(past.planned[past.now :])
    if not changes.any():
        return np.zeros(len(past.ahead))
    first, volts = past.edge_step, np.abs(past.planned[past.edge_step : past.now + 1])
    if not volts.any() or not np.isfinite(past.rest):
        return None
    missed = past.all_readings[first:] - past.rest - said[first : past.now + 1]
    each = missed / np.maximum.accumulate(np.where(volts > 0.0, volts, np.finfo(np.float64).tiny))
    known = np.flatnonzero(np.isfinite(each) & (volts > 0.0))
    if not len(known):
        return None
    # What was not read is as what was read before it, and the first reading after the edge stands for those before.
    since = np.clip(np.searchsorted(known, np.arange(len(changes)), side="right") - 1, 0, None)
    off = np.convolve(changes, each[known[since]])[: len(changes)]
    reached = np.concatenate([[0.0], np.maximum.accumulate(np.abs(off))])
    step = np.ceil(past.leads / past.step - 1e-9).astype(np.intp)
    return np.asarray(reached[np.clip(step, 0, len(reached) - 1)])
