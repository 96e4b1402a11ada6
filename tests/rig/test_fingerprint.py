"""A fingerprint against the earlier ones of its sample."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab.rig.experiments.fingerprint import Fingerprint, differences, read_fingerprint
from ipmclab.run import Run


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


def step(lost: slice) -> Run:
    """A strip of 20 ohm that takes 0.5 s to charge; some rows of the current were lost."""
    time = np.arange(350) / 50
    voltage = np.where((time >= 2.0) & (time < 5.0), 0.1, 0.0)
    current = np.where(voltage > 0.0, 1e-4 + 4.9e-3 * np.exp(-(time - 2.0) / 0.5), 0.0)
    current[lost] = np.nan
    return Run.from_arrays(time=time, voltage=voltage, current=current)


def test_lost_rows_are_no_charge_and_no_resistance() -> None:
    whole = read_fingerprint(step(slice(0)))
    assert whole is not None
    assert whole.series_resistance == pytest.approx(20.0)
    for lost in (slice(0, 99), slice(103, 110), slice(200, 230)):
        found = read_fingerprint(step(lost))
        assert found is not None
        assert found.series_resistance == pytest.approx(whole.series_resistance)
        assert found.capacitance == pytest.approx(whole.capacitance, rel=0.01)
    for lost in (slice(0, 100), slice(100, 101), slice(102, 103), slice(100, 250), slice(None)):
        assert read_fingerprint(step(lost)) is None
