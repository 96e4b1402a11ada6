"""Order by size: sizes that differ by rounding alone are equal, and equals stay in the order in which they stand.

What is printed first would else depend on the last bit, and that on the processor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

DIGITS: Final = 6
"""Decimals of their own leading digits in which sizes must differ to be different."""

NOTHING: Final = 1e-13
"""Of the largest size: what is below it is rounding, and counts as zero."""


def largest_first(sizes: Sequence[float] | FloatArray) -> list[int]:
    """Places by size, the largest first.

    Parameters
    ----------
    sizes : sequence of float
        Finite.

    Examples
    --------
    >>> largest_first([0.5, 0.7071067811865475, 0.7071067811865476])
    [1, 2, 0]
    >>> largest_first([1e-4, 2.25, 1e7])
    [2, 1, 0]
    """
    given = np.asarray(sizes, dtype=np.float64)
    largest = np.abs(given).max(initial=0.0)
    leading, power = np.frexp(np.where(np.abs(given) > NOTHING * largest, given, 0.0))
    places: list[int] = np.argsort(-np.ldexp(np.rint(10.0**DIGITS * leading), power), kind="stable").tolist()
    return places


def names_by_size(sizes: Mapping[str, float]) -> list[str]:
    """Names by the size of what they stand for, its sign aside, the largest first."""
    names = list(sizes)
    return [names[k] for k in largest_first(np.abs(np.fromiter(sizes.values(), np.float64, len(names))))]


def upright(row: FloatArray) -> FloatArray:
    """A direction, turned so that the first of its largest parts is positive."""
    return row if row[largest_first(np.abs(row))[0]] >= 0.0 else -row
