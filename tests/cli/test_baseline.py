"""The curl of a strip at rest: its rate with an interval, and whether tests are possible."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from ipmclab import InputError, Run, write_run
from ipmclab.measurement.curl import Curl, curl

RATE = 10.0


def at_rest(tip: np.ndarray, voltage: float = 0.0) -> Run:
    time = np.arange(len(tip)) / RATE
    return Run.from_arrays(time=time, voltage=np.full(len(tip), voltage), displacement=tip)


def white(length: float, seed: int = 0) -> np.ndarray:
    return 1e-6 * np.random.default_rng(seed).standard_normal(round(length * RATE))


def straight(length: float, rate: float) -> np.ndarray:
    return rate * np.arange(round(length * RATE)) / RATE


def test_the_three_verdicts() -> None:
    """Allowed are 5 % of 1 mm, 50 um in 40 s: 1.25 um/s."""
    found = {rate: curl(at_rest(straight(360.0, rate) + white(360.0)), 1e-3) for rate in (0.2e-6, 1.25e-6, 5e-6)}
    assert [one.verdict for one in found.values()] == ["yes", "open", "no"]
    for rate, one in found.items():
        assert one.interval[0] <= rate <= one.interval[1]
        assert one.stretches == 9
        assert one.longest_test == pytest.approx(5e-5 / one.interval[1])
    assert found[5e-6].rate == pytest.approx(5e-6, rel=0.1)


def test_the_fastest_stretch_counts_and_its_side_is_kept() -> None:
    time = np.arange(0.0, 400.0, 1.0 / RATE)
    found = curl(at_rest(-2e-3 * (1.0 - np.exp(-time / 60.0)) + white(400.0)), 1e-3)
    assert found.since == 0.0
    # Mean rate from 0 to 40 s, by weights of a straight line: between the first rate and the last one there.
    assert -2e-3 / 60.0 < found.rate < -2e-3 / 60.0 * np.exp(-40.0 / 60.0)
    assert found.verdict == "no"


@pytest.mark.parametrize(("memory", "least"), [(0.0, 0.93), (2.0, 0.92)])
@pytest.mark.parametrize("length", [40.0, 360.0])
def test_an_interval_holds_for_noise_that_follows_itself(memory: float, least: float, length: float) -> None:
    """Noise that forgets itself within `memory` seconds, in tests of 40 s; 95 % with a few percent of tolerance."""
    rng = np.random.default_rng(20261121)
    keep = np.exp(-1.0 / (RATE * memory)) if memory else 0.0
    draws = 500 if length < 100.0 else 200
    rows = round(length * RATE)
    held = 0
    for _ in range(draws):
        noise = 1e-6 * lfilter([1.0], [1.0, -keep], rng.standard_normal(rows + 300))[300:]
        low, high = curl(at_rest(straight(length, 5e-6) + noise), 1e-3).interval
        held += low <= 5e-6 <= high
    assert held / draws >= least - 2.0 * np.sqrt(0.05 * 0.95 / draws)


@given(
    scale=st.floats(1e-3, 1e3),
    offset=st.floats(-1e-2, 1e-2),
    seed=st.integers(0, 100),
)
def test_unit_and_zero_do_not_matter(scale: float, offset: float, seed: int) -> None:
    tip = straight(80.0, 2e-6) + white(80.0, seed)
    one, other = curl(at_rest(tip), 1e-3), curl(at_rest(scale * tip + offset), scale * 1e-3)
    assert other.rate == pytest.approx(scale * one.rate, rel=1e-6, abs=scale * 1e-13)
    assert other.interval == pytest.approx([scale * end for end in one.interval], rel=1e-6, abs=scale * 1e-13)
    turned = curl(at_rest(-tip), 1e-3)
    assert (turned.rate, turned.verdict) == (pytest.approx(-one.rate), one.verdict)


def test_missing_readings_are_left_out() -> None:
    tip = straight(120.0, 3e-6) + white(120.0)
    tip[::7] = np.nan
    low, high = curl(at_rest(tip), 1e-3).interval
    assert low <= 3e-6 <= high


def test_a_lost_laser_is_no_curl() -> None:
    """What the laser reads where it sees nothing is no place of the tip: it made another verdict of the rate."""
    tip = straight(360.0, 0.2e-6) + white(360.0)
    tip[1000:1060] = -9.99e-3
    found = curl(at_rest(tip), 1e-3)
    assert found.verdict == "yes"
    assert found.interval[1] < 1e-6


def test_the_ends_of_what_counts_as_rest_and_as_one_test() -> None:
    """0.02 V is no voltage; a record of as many rows as one test has is long enough; 40 readings are enough."""
    assert curl(at_rest(white(40.0), 0.02), 1e-3).stretches == 1
    assert curl(at_rest(white(40.0)), 1e-3).since == 0.0
    assert curl(at_rest(white(79.9)), 1e-3).stretches == 1
    assert curl(at_rest(white(80.0)), 1e-3).stretches == 2
    assert curl(at_rest(white(4.0)), 1e-3, test=4.0).stretches == 1
    with pytest.raises(InputError, match="less than 40 readings"):
        curl(at_rest(white(3.9)), 1e-3, test=3.9)
    with pytest.raises(InputError, match=r"its voltage reaches 0\.0201 V"):
        curl(at_rest(white(40.0), -0.0201), 1e-3)
    for limits in ({"test": 0.0}, {"share": 0.0}, {"share": 1.0}):
        with pytest.raises(InputError, match="make no limit"):
            curl(at_rest(white(40.0)), 1e-3, **limits)


@pytest.mark.parametrize(("interval", "verdict"), [((0.0, 1.0), "yes"), ((0.5, 1.01), "open"), ((1.0, 2.0), "open")])
def test_what_is_allowed_is_still_allowed(interval: tuple[float, float], verdict: str) -> None:
    """Exactly what a test may take is no reason against it."""
    assert Curl(interval[1], interval, 0.0, 1, 40.0, 40.0).verdict == verdict


def test_a_strip_that_stands_still_may_be_tested_for_as_long_as_one_likes() -> None:
    assert Curl(0.0, (0.0, 0.0), 0.0, 1, 40.0, 5e-5).longest_test == np.inf
    assert Curl(2.0, (1.0, 2.0), 0.0, 1, 40.0, 40.0).longest_test == 20.0
    assert Curl(2.0, (1.01, 2.0), 0.0, 1, 40.0, 40.0).verdict == "no"


def test_what_is_no_baseline_is_refused(command, tmp_path) -> None:
    tip = white(60.0)
    for run, words in (
        (at_rest(tip, 1.0), "the strip was driven"),
        (at_rest(tip[:200]), "shorter than one test"),
        (at_rest(np.full(len(tip), 1e-3)), "every reading of its displacement that counts is the same"),
        (at_rest(np.where(np.arange(len(tip)) % 30, np.nan, tip)), "less than 40 readings"),
        (Run.from_arrays(time=[0.0, 50.0], voltage=[0.0, 0.0], current=[0.0, 0.0]), "no displacement"),
    ):
        with pytest.raises(InputError, match=words):
            curl(run, 1e-3)
    with pytest.raises(InputError, match="make no limit"):
        curl(at_rest(tip), -1e-3)
    write_run(at_rest(tip), tmp_path / "room.nc")
    assert command("baseline", "room.nc", "--displacement", "1 mm", "--share", "much").status == 2
    assert command("baseline", "room.nc", "--displacement", "1 s").status == 2


def test_the_command_says_both_verdicts(command, tmp_path) -> None:
    write_run(at_rest(straight(360.0, 5.6e-6) + white(360.0)), tmp_path / "room.nc")
    write_run(at_rest(white(360.0)), tmp_path / "humid.nc")
    told = command("baseline", "room.nc", "humid.nc", "--displacement", "1.27 mm")
    assert told.status == 0
    assert "Not in this air" in told.out
    assert "Tests are possible in this air." in told.out
    document = command("baseline", "room.nc", "humid.nc", "--displacement", "1.27 mm", "--json").document
    assert [one["verdict"] for one in document["baselines"]] == ["no", "yes"]


@pytest.mark.parametrize("tip", [np.full(3000, np.nan), np.append(0.0, np.full(2999, np.nan)), white(300.0)])
def test_too_few_readings_for_a_test_are_told(tip: np.ndarray) -> None:
    with pytest.raises(InputError, match="less than 40 readings"):
        curl(at_rest(tip), 1e-3, test=1e-9)
