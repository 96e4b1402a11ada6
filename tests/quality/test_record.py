"""What several checks share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from ipmclab.quality import check
from ipmclab.quality.noise import runs_of_true
from ipmclab.quality.record import ranges_of
from ipmclab.run import Run


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


def test_a_lost_laser_that_reads_nearer_to_zero_than_the_strip(read: Callable[..., Run]) -> None:
    """The strip stands 9 mm from the laser's zero, which the laser gives where it sees nothing."""
    run = read("step 1 V delay=4 s")
    away = 9e-3 + np.asarray(run.displacement)
    away[900:1000] = away[1500:1560] = 0.0
    (finding,) = (finding for finding in check(replace(run, displacement=away)) if finding.severity != "info")
    assert (finding.code, finding.samples) == ("laser-lost", ((900, 1000), (1500, 1560)))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_strip_at_rest_has_its_laser(sign: float) -> None:
    """Read in steps that hide its noise, a row or two late, it goes at once to where it stays."""
    time = np.arange(2000) / 50.0
    moved = sign * np.where(time > 4.03, 1e-3 + 1e-5 * np.round(20.0 * np.sin(0.2 * time)), 0.0)
    run = Run.from_arrays(time=time, voltage=sign * np.where(time >= 4.0, 1.0, 0.0), displacement=moved)
    assert "laser-lost" not in {finding.code for finding in check(run)}
