"""A fingerprint against the earlier ones of its sample."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ipmclab.rig.experiments.fingerprint import Fingerprint, differences, read_fingerprint
from ipmclab.run import Run, RunMetadata


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


def fingerprint_of(volts: float = 0.1, *, rest: int = 50, rows: int = 50, zero: float = 0.0, **about: Any) -> Any:
    """What a step tells whose current is a quarter steady, read by a sensor that reads ``zero`` [A] at rest."""
    voltage = np.concatenate([np.zeros(rest), np.full(rows, volts), np.zeros(20)])
    since = np.arange(rows) / 50
    current = np.concatenate([np.zeros(rest), volts / 20.0 * (0.25 + 0.75 * np.exp(-since / 0.1)), np.zeros(20)])
    time = np.arange(len(voltage)) / 50
    return read_fingerprint(
        Run.from_arrays(time=time, voltage=voltage, current=current + zero, metadata=RunMetadata(**about))
    )


@pytest.mark.parametrize("volts", [0.1, -0.1, 0.01])
@pytest.mark.parametrize("zero", [0.0, 2e-3])
def test_of_both_polarities_and_from_the_reading_at_rest(volts: float, zero: float) -> None:
    found = fingerprint_of(volts, zero=zero)
    assert found.series_resistance == pytest.approx(20.0)
    # A sum over rows of 0.75/20 exp(-t/0.1 s), the step of 20 ms included.
    assert found.capacitance == pytest.approx(0.75 / 20.0 * 0.02 / (1.0 - np.exp(-0.2)), rel=2e-3)


def test_what_is_no_step_from_rest_tells_nothing() -> None:
    assert fingerprint_of(0.0099) is None
    assert fingerprint_of(rows=9) is None
    assert fingerprint_of(rows=10) is not None
    assert fingerprint_of(rest=2) is None
    assert fingerprint_of(rest=3) is not None
    assert fingerprint_of(starts_from_rest=False) is None
    assert fingerprint_of(starts_from_rest=True) is not None
    assert read_fingerprint(Run.from_arrays(time=[0.0, 1.0], voltage=[0.0, 0.0])) is None
