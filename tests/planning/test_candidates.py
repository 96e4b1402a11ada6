"""Which runs are tried."""

from __future__ import annotations

import pytest

from ipmclab.planning.candidates import candidates


@pytest.mark.parametrize("most", [1.996, 0.0119996, 9.999, 1.2, 0.1 + 0.2, 1.1, 3.5])
def test_no_amplitude_is_rounded_beyond_the_largest(most: float) -> None:
    """A limit of 1.996 V refused every run of 2 V, and half of it was all that was proposed."""
    found = {one.signal.amplitude for one in candidates(most, 50.0, 20.0)}
    assert 0.99 * most <= max(found) <= most
    assert all(len(f"{one:.12g}".strip("0.").replace(".", "")) <= 3 for one in found)
