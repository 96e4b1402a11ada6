"""Readings that stand for none: the value that a laser gives without a target, and what lies beside it."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.quality.noise import runs_of_true
from ipmclab.run import FloatArray

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.intp]

_SENTINEL_REPEATS: Final = 3  # equal extreme readings, of which fewer are no stated sentinel (convention)


def may_hold_sentinel(name: str, readings: FloatArray, edges: IntArray) -> bool:
    """A cheap first look: an extreme reading that comes back to the digit."""
    if name != "displacement":
        return False
    if max(np.count_nonzero(readings == one) for one in (readings.min(), readings.max())) < _SENTINEL_REPEATS:
        return False
    return bool(raw_sentinels(readings, np.ones(len(readings), dtype=bool), edges).any())


def raw_sentinels(readings: FloatArray, finite: BoolArray, edges: IntArray) -> BoolArray:
    """Rows at one exact value that is further from all others than these are from each other.

    A laser that sees no target gives such a value. It comes and goes at times of its own, not
    at the edges of the voltage.
    """
    found = np.zeros(len(readings), dtype=bool)
    rows = np.flatnonzero(finite)  # a row without a reading neither begins nor ends a stretch
    values = readings[rows]
    for extreme in (values.min(), values.max()) if len(rows) else ():
        held = values == extreme
        others = values[~held]
        if np.count_nonzero(held) < _SENTINEL_REPEATS or len(others) < _SENTINEL_REPEATS:
            continue
        low, high = np.percentile(others, (1.0, 99.0))
        distance = low - extreme if extreme < low else extreme - high
        if distance <= 2.0 * max(high - low, np.finfo(float).tiny):
            continue
        starts, stops = runs_of_true(held)
        if not starts.any() and abs(extreme) <= np.abs(others).max():
            continue  # from row 0 on, and nearer to zero than the others: the strip at rest
        changes = np.concatenate((starts[starts > 0], stops[stops < len(rows)]))
        if len(edges) and all(np.any((edges >= rows[k - 1]) & (edges <= rows[k] + 1)) for k in changes):
            continue
        found[rows[held]] = True
    return found


def beside_missing(readings: FloatArray, missing: BoolArray, reach_rows: int) -> IntArray:
    """Readings within some rows of missing ones that lie further out than the whole range of the others."""
    others = readings[~missing]
    low, high = np.percentile(others, (1.0, 99.0))
    reach = high - low
    with np.errstate(invalid="ignore"):
        far = ~missing & ((readings < low - reach) | (readings > high + reach))
    near_missing = missing.copy()
    for _ in range(reach_rows):
        grown = near_missing.copy()
        grown[1:] |= near_missing[:-1]
        grown[:-1] |= near_missing[1:]
        near_missing = missing | (grown & far)
    return np.flatnonzero(near_missing & ~missing)
