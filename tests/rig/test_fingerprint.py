"""A fingerprint against the earlier ones of its sample."""

from __future__ import annotations

import pytest

from ipmclab.rig.experiments.fingerprint import Fingerprint, differences


@pytest.mark.parametrize(("away", "is_outside"), [(2.5, False), (3.5, True)])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_it_is_outside_from_three_standard_deviations_on(away: float, side: float, is_outside: bool) -> None:
    """Of the earlier ones: half of a normal scatter lies within 0.6745 of its standard deviations."""
    earlier = [Fingerprint(16.0 + 0.6745 * k, 5e-3, 0.0, "current", 1e-7) for k in (-2.0, -1.0, 0.0, 1.0, 2.0)]
    at = side * away
    (*told,) = differences(Fingerprint(16.0 + at, 5e-3, 0.0, "current", 1e-7), earlier)
    assert ["series resistance" in one for one in told] == [True] * is_outside
    (*told,) = differences(Fingerprint(16.0, 5e-3, at * 1e-7, "current", 1e-7), earlier)
    assert ["drifts" in one for one in told] == [True] * is_outside


def test_a_part_of_twenty_is_always_within() -> None:
    """Three mountings may be alike by chance, and their capacitance is read from one step."""
    earlier = [Fingerprint(16.0, 5e-3, 0.0, "current", 1e-7)] * 3
    for part, is_outside in ((1.04, False), (1.06, True)):
        found = Fingerprint(16.0, part * 5e-3, 0.0, "current", 1e-7)
        assert bool(differences(found, earlier)) is is_outside
    assert not differences(Fingerprint(99.0, 9e-3, 1.0, "current", 1e-7), earlier[:2])
