"""How fast a strip curls, by its baseline: closed forms, and which baseline counts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ipmclab.comparison.baseline import Air, Drift, air_of, baseline_for, drift_of, is_baseline, without_drift
from ipmclab.quality.record import NO_VOLTAGE
from ipmclab.run import FloatArray, Run, RunMetadata
from ipmclab.sample import Sample


def still(time: FloatArray, displacement: FloatArray) -> Run:
    return Run.from_arrays(time=time, voltage=np.zeros(len(time)), displacement=displacement)


@pytest.mark.parametrize(
    ("one", "other", "differs"),
    [
        (Air(20.0, 40.0), Air(24.0, 46.0), False),
        (Air(24.0, 46.0), Air(20.0, 40.0), False),
        (Air(20.0, 40.0), Air(24.5, 40.0), True),
        (Air(24.5, 40.0), Air(20.0, 40.0), True),
        (Air(20.0, 40.0), Air(20.0, 46.5), True),
        (Air(20.0, 46.5), Air(20.0, 40.0), True),
        (Air(20.0, None), Air(20.0, 90.0), False),
        (Air(20.0, 90.0), Air(20.0, None), False),
        (Air(), Air(), False),
    ],
)
def test_another_air_is_more_than_4_kelvin_or_6_percent_away(one: Air, other: Air, differs: bool) -> None:
    assert one.is_other(other) is differs


def test_the_air_is_that_which_was_read_or_else_noted() -> None:
    noted = RunMetadata(temperature=25.0, relative_humidity=50.0)
    run = Run.from_arrays(time=[0.0, 1.0, 2.0], voltage=[0.0] * 3, temperature=[20.0, math.nan, 22.0], metadata=noted)
    assert air_of(run) == Air(21.0, 50.0)
    assert air_of(replace(run, temperature=np.full(3, math.nan))) == Air(25.0, 50.0)
    assert air_of(replace(run, metadata=RunMetadata())) == Air(21.0, None)


@pytest.mark.parametrize(
    ("voltage", "purpose", "expected"),
    [
        ([0.0, 0.9 * NO_VOLTAGE], None, True),
        ([0.0, NO_VOLTAGE], None, False),
        ([0.0, -1.0], None, False),
        ([0.0, 1.0], "baseline", True),
        ([0.0, 1.0], "signal", False),
    ],
)
def test_a_baseline_has_no_voltage_or_says_what_it_is(voltage: list[float], purpose: str, expected: bool) -> None:
    assert (
        is_baseline(Run.from_arrays(time=[0.0, 1.0], voltage=voltage, metadata=RunMetadata(purpose=purpose)))
        is expected
    )


def test_twenty_readings_make_a_rate() -> None:
    time = 3.0 + np.arange(20.0)
    drift = drift_of(still(time, 5e-3 - 2e-6 * time))
    assert drift is not None
    assert drift.rate == pytest.approx(-2e-6)
    assert (drift.first, drift.last, drift.name, drift.sample, drift.recorded_at) == (None, None, "baseline", None, "")
    assert drift_of(still(time[1:], time[1:])) is None
    assert drift_of(Run.from_arrays(time=time, voltage=np.zeros(20), current=time)) is None


def test_a_bent_curl_is_as_uncertain_as_its_rates_differ() -> None:
    """b t^2 / 2 over ten blocks of 60 s: rates 60 b apart, of which a run may have any one."""
    time, bend = np.arange(600.0), 1e-8
    drift = drift_of(still(time, 0.5 * bend * time**2))
    assert drift is not None
    assert drift.rate == pytest.approx(bend * 299.5)
    spread = 60.0 * bend * float(np.std(np.arange(10), ddof=1))
    assert drift.standard_error == pytest.approx(spread * math.sqrt(1.0 + 1.0 / 10.0), rel=1e-3)


def test_a_straight_curl_is_as_uncertain_as_its_noise_says() -> None:
    rng, time = np.random.default_rng(20261121), np.arange(400) / 10.0
    found = [drift_of(still(time, 1e-6 * time + rng.normal(0.0, 1e-6, 400))) for _ in range(60)]
    rates, errors = np.array([(one.rate, one.standard_error) for one in found if one is not None]).T
    assert rates.mean() == pytest.approx(1e-6, abs=4.0 * rates.std() / math.sqrt(60))
    inside = np.abs(rates - 1e-6) <= 1.96 * errors
    assert inside.mean() >= 0.9
    assert float(np.median(errors)) < 20.0 * rates.std()  # a piece alone is known 32 times worse


@pytest.mark.parametrize("begins", [0.0, 100.0])
def test_the_first_and_the_last_stretch_have_rates_of_their_own(begins: float) -> None:
    """b t^2 / 2 over 121 s: rates at the middles of its stretches; half of what 40 s change is not known."""
    time, bend = np.arange(121.0), 1e-8
    drift = drift_of(still(begins + time, 0.5 * bend * time**2))
    assert drift is not None
    assert drift.first == pytest.approx((bend * 19.5, bend * 20.0), rel=1e-3)
    assert drift.last == pytest.approx((bend * 100.5, bend * 20.0), rel=1e-3)


@pytest.mark.parametrize(
    ("time", "there"),
    [
        (np.arange(81.0), True),
        (np.linspace(0.0, 79.9, 81), False),
        (np.arange(0.0, 90.0, 2.0), True),
        (np.arange(0.0, 90.0, 2.2), False),
        (np.r_[0.0:45.0, 75.0:120.0], False),  # too few readings of the second stretch
        (np.r_[0.0:15.0, 40.0:120.0], False),  # and of the first
    ],
)
def test_a_stretch_has_another_behind_it_and_twenty_readings(time: FloatArray, there: bool) -> None:
    drift = drift_of(still(time, 1e-6 * time))
    assert drift is not None
    assert (drift.first is not None) is there


def test_a_baseline_is_of_the_same_strip_in_the_same_air_and_no_later_than_the_run() -> None:
    about = RunMetadata(sample=Sample("s1"), mounting_id="m1", recorded_at="2026-03-02")
    older = Drift(1e-6, 0.0, "older", "s1", "m1", "2026-03-01", Air(20.0))
    same = replace(older, name="same", recorded_at="2026-03-02")
    assert baseline_for(about, [older, same]) is same
    assert baseline_for(about, [same, older], Air(21.0)) is same
    assert baseline_for(about, [older, replace(same, air=Air(30.0))], Air(21.0)) is older
    assert baseline_for(about, [replace(older, sample="s2"), replace(older, sample=None)]) is None
    assert baseline_for(RunMetadata(recorded_at="2026-03-02"), [replace(older, sample=None)]) is None
    elsewhere = replace(same, name="elsewhere", mounting="m2")
    assert baseline_for(about, [elsewhere, older]) is older
    assert baseline_for(about, [elsewhere]) is elsewhere
    assert baseline_for(about, []) is None


def test_a_curl_is_taken_out_from_the_first_row_on() -> None:
    time = 100.0 + np.arange(3.0)
    run = still(time, 1e-3 + 2e-6 * np.arange(3.0))
    assert without_drift(run, Drift(2e-6, 0.0, "b")).displacement == pytest.approx([1e-3] * 3, rel=1e-12)
    bare = Run.from_arrays(time=time, voltage=np.zeros(3))
    assert without_drift(bare, Drift(2e-6, 0.0, "b")) is bare
