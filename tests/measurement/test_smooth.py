"""The filter against what it must leave and what it must take, by closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import InputError, Run, check
from ipmclab.measurement.smooth import smooth

RATE, BELOW = 50.0, 5.0
TIME = np.arange(0.0, 40.0, 1.0 / RATE)


def run_of(displacement: np.ndarray, **more: np.ndarray) -> Run:
    return Run.from_arrays(time=TIME, voltage=np.where(TIME < 1.0, 0.0, 1.0), displacement=displacement, **more)


@given(slope=st.floats(-1e-3, 1e-3), level=st.floats(-5e-3, 5e-3), seed=st.integers(0, 50))
def test_a_straight_line_stays_with_gaps_too(slope: float, level: float, seed: int) -> None:
    line = level + slope * TIME
    line[np.random.default_rng(seed).random(len(TIME)) < 0.2] = np.nan
    quiet, _ = smooth(run_of(line), BELOW)
    np.testing.assert_allclose(quiet.displacement, line, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(np.isnan(quiet.displacement), np.isnan(line))


@pytest.mark.parametrize("frequency", [0.5, 2.0, 5.0, 10.0, 20.0])
def test_each_frequency_keeps_the_part_of_a_bell(frequency: float) -> None:
    """exp(-ln 2/2 (f/f_c)^2), without a shift in time: a sine stays a sine of the same phase."""
    wave = 1e-3 * np.sin(2.0 * np.pi * frequency * TIME)
    quiet, taken = smooth(run_of(wave), BELOW)
    part = np.exp(-0.5 * np.log(2.0) * (frequency / BELOW) ** 2)
    inner = slice(100, -100)
    np.testing.assert_allclose(quiet.displacement[inner], part * wave[inner], atol=2e-4 * 1e-3)
    assert taken["displacement"].rms == pytest.approx((1.0 - part) * 1e-3 / np.sqrt(2.0), rel=0.05)
    assert taken["displacement"].frequency == pytest.approx(frequency, abs=0.05)
    assert taken["displacement"].share > 0.9


def test_a_fan_goes_and_the_rest_stays() -> None:
    slow = 1e-3 * (1.0 - np.exp(-TIME / 2.0))
    fan = 2e-5 * np.sin(2.0 * np.pi * 13.0 * TIME)
    current = np.where(TIME < 1.0, 0.0, 0.06)
    shaken = run_of(slow + fan, current=current, force=slow)
    quiet, taken = smooth(shaken, BELOW)
    assert np.abs(quiet.displacement - slow)[50:-50].max() < 0.12 * 2e-5
    np.testing.assert_array_equal(quiet.current, current)
    np.testing.assert_array_equal(quiet.voltage, shaken.voltage)
    assert set(taken) == {"displacement", "force"}
    assert "smoothed" in {finding.code for finding in check(quiet)}
    assert "smoothed" not in {finding.code for finding in check(shaken)}
    assert quiet.metadata.findings[-1].severity == "info"


def test_a_reading_that_stands_alone_and_one_that_is_left_out_stay() -> None:
    tip = 1e-3 * np.sin(0.1 * TIME)
    tip[100:200] = np.nan
    tip[150] = 5e-3
    quiet, _ = smooth(run_of(tip), BELOW)
    assert quiet.displacement[150] == pytest.approx(5e-3)
    np.testing.assert_allclose(quiet.displacement[:95], tip[:95], atol=1e-9)


def test_what_cannot_be_smoothed_is_refused() -> None:
    tip = np.zeros(len(TIME))
    for below in (0.01, 20.0, 0.0, -1.0, float("nan")):
        with pytest.raises(InputError, match="is not between"):
            smooth(run_of(tip), below)
    with pytest.raises(InputError, match="neither displacement nor force"):
        smooth(Run.from_arrays(time=TIME, voltage=tip, current=tip), BELOW)


@pytest.mark.parametrize(("part", "is_even"), [(0.25, False), (1.5e-3, False), (0.7e-3, True)])
def test_rows_are_even_to_a_thousandth_of_what_lies_between_them(part: float, is_even: bool) -> None:
    tip = np.zeros(len(TIME))
    uneven = TIME + 0.5 * part * TIME[1] * (np.arange(len(TIME)) % 2)  # from one to the next it changes by the part
    run = Run.from_arrays(time=uneven, voltage=tip, displacement=tip)
    if is_even:
        assert not np.any(smooth(run, BELOW)[0].displacement)
        return
    with pytest.raises(InputError, match="not at even times"):
        smooth(run, BELOW)
