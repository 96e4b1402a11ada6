"""By how much the edges of a foreign record lie after its rows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple


class EdgeDelay(NamedTuple):
    """By how much the edges lie after the rows of the voltage channel [s].

    Parameters
    ----------
    value : float [s]
        The middle of what the readings allow.
    error : float [s]
        Its standard deviation.
    start : float [s]
        Where a search begins: between the two rows between which the edges are likeliest to lie.
    """

    value: float
    error: float
    start: float

    @classmethod
    def of(cls, low: float, high: float, row: float, period: float) -> EdgeDelay:
        """Anywhere between two delays, and first at those between a row and the one before it.

        Parameters
        ----------
        low, high : float [rows]
        row : float
        period : float [s]
        """
        first, last = max(low, row - 1.0), min(high, row)
        if not first < last:  # by itself the record spoke against that row
            low, high = first, last = row - 1.0, row
        error = max(high - low, 1.0) / math.sqrt(12.0)
        return cls(0.5 * (low + high) * period, error * period, 0.5 * (first + last) * period)


def starts_of(delays: Mapping[int, EdgeDelay]) -> dict[int, float]:
    """Where a search begins [s], by the place of each run."""
    return {place: delay.start for place, delay in delays.items()}
