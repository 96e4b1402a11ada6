"""What several checks share."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from ipmclab.quality.record import ranges_of, runs_of_true


@given(arrays.arrays(np.bool_, st.integers(1, 60)))
def test_ranges_cover_exactly_what_is_set(flags) -> None:
    ranges = ranges_of(np.flatnonzero(flags))
    found = np.zeros_like(flags)
    for start, stop in ranges:
        assert start < stop
        assert not found[max(start - 1, 0) : stop].any()  # ranges that touch are one
        found[start:stop] = True
    assert np.array_equal(found, flags)
    starts, stops = runs_of_true(flags)
    assert tuple(zip(starts.tolist(), stops.tolist(), strict=True)) == ranges
