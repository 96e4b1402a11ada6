"""Scores against their definitions, on closed forms and by another way of computing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from ipmclab.prediction.scores import Comparison, autocorrelation, score

SEED = 20261121


def comparison(measured: np.ndarray, predicted: np.ndarray, used: np.ndarray | None = None) -> Comparison:
    return Comparison(
        0.02 * np.arange(len(measured)), measured, predicted, np.full(len(measured), True) if used is None else used
    )


PERIODS = np.sin(2 * np.pi * np.arange(1000) / 100)


@pytest.mark.parametrize("gain", [0.9, 1.25, 0.0, -1.0])
def test_fit_of_a_scaled_sine_is_its_gain(gain: float) -> None:
    # e = (1 - gain) y and the mean of whole periods is 0, so |e| / |y - mean y| = |1 - gain|.
    one = score("force", [comparison(PERIODS, gain * PERIODS)])
    assert one.fit_percent == pytest.approx(100 * (1 - abs(1 - gain)), abs=1e-9)
    assert one.rmse == pytest.approx(abs(1 - gain) / np.sqrt(2), rel=1e-12)
    assert one.rmse_percent_of_range == pytest.approx(100 * abs(1 - gain) / np.sqrt(2) / 2, rel=1e-12)
    assert one.max_error == pytest.approx(abs(1 - gain), rel=1e-12)


def test_the_mean_as_prediction_scores_zero_and_the_truth_hundred() -> None:
    measured = np.array([1.0, 2.0, 4.0, 9.0])
    assert score("current", [comparison(measured, np.full(4, 4.0))]).fit_percent == 0.0
    assert score("current", [comparison(measured, measured)]).fit_percent == 100.0


def test_a_shift_counts_in_full() -> None:
    one = score("force", [comparison(PERIODS, PERIODS + 0.3)])
    assert one.fit_percent == pytest.approx(100 * (1 - 0.3 * np.sqrt(2)), abs=1e-9)
    assert np.allclose(one.autocorrelation, 1.0)
    assert one.lags_outside == 1.0


FLOATS = st.floats(-1e3, 1e3, allow_nan=False, width=32)


@given(arrays.arrays(np.float64, (2, 40), elements=FLOATS), arrays.arrays(np.bool_, 40))
def test_scores_follow_the_definition(values: np.ndarray, used: np.ndarray) -> None:
    measured, predicted = values
    one = score("current", [comparison(np.where(used, measured, np.nan), predicted, used)])
    assert (one.samples, one.left_out) == (used.sum(), (~used).sum())
    if not used.any():
        assert one.rmse is None
        assert "no usable sample" in one.reason
        return
    y, error = measured[used], (measured - predicted)[used]
    assert one.rmse == pytest.approx(np.linalg.norm(error) / np.sqrt(len(error)), rel=1e-9, abs=1e-12)
    assert one.max_error == np.max(np.abs(error))
    assert abs(measured[one.max_error_sample] - predicted[one.max_error_sample]) == one.max_error
    assert one.max_error_time == pytest.approx(0.02 * one.max_error_sample)
    if np.ptp(y) == 0:
        assert one.fit_percent is None
        assert one.rmse_percent_of_range is None
    else:
        # The definition that MATLAB's compare documents: 100 (1 - norm(y - yhat) / norm(y - mean(y))).
        by_norms = 100 * (1 - np.linalg.norm(error) / np.linalg.norm(y - np.mean(y)))
        assert one.fit_percent == pytest.approx(by_norms, rel=1e-6, abs=1e-6)


def test_a_constant_output_has_an_error_but_no_fit() -> None:
    one = score("displacement", [comparison(np.full(30, 0.1), np.full(30, 0.3))])
    assert one.fit_percent is None
    assert one.rmse_percent_of_range is None
    assert one.rmse == pytest.approx(0.2)
    assert "constant" in one.reason
    assert one.as_dict()["fit_percent"] is None


def test_runs_at_different_levels_do_not_look_better_together() -> None:
    rng = np.random.default_rng(SEED)
    first, second = rng.normal(0, 1, 50), rng.normal(100, 1, 80)
    errors = rng.normal(0, 0.5, 50), rng.normal(0, 0.5, 80)
    one = score("force", [comparison(first, first - errors[0]), comparison(second, second - errors[1])])
    spread = np.sum((first - first.mean()) ** 2) + np.sum((second - second.mean()) ** 2)
    expected = 100 * (1 - np.sqrt(np.sum(np.concatenate(errors) ** 2) / spread))
    assert one.fit_percent == pytest.approx(expected, rel=1e-9)
    assert one.samples == 130
    largest = [np.abs(error).max() for error in errors]
    assert one.max_error_run == int(np.argmax(largest))
    assert one.max_error == pytest.approx(max(largest), rel=1e-9)
    assert one.autocorrelation.size == 0


def test_white_noise_stays_in_its_band_and_a_first_order_one_has_its_powers() -> None:
    rng = np.random.default_rng(SEED)
    inside = []
    for _ in range(200):
        error = rng.normal(0, 1, 600)
        error[rng.random(600) < 0.3] = np.nan
        correlation, band = autocorrelation(error)
        inside.append(np.mean(np.abs(correlation) <= band))
    assert 0.94 < np.mean(inside) < 0.965
    series = np.zeros(200_000)
    for k, shock in enumerate(rng.normal(0, 1, len(series))):
        series[k] = 0.8 * series[k - 1] + shock
    assert np.allclose(autocorrelation(series)[0][:10], 0.8 ** np.arange(1, 11), atol=0.02)


def test_short_and_silent_residuals_have_no_autocorrelation() -> None:
    assert autocorrelation(np.zeros(100))[0].size == 0
    assert autocorrelation(np.array([1.0, -1.0, np.nan]))[0].size == 0
    assert score("force", [comparison(PERIODS, PERIODS)]).lags_outside is None


def test_the_worst_reading_is_that_of_the_rows_that_count() -> None:
    """Whichever run it is in: one of which nothing counts has none, one of which a part counts may."""
    level, nothing = np.linspace(0.0, 1.0, 4), np.zeros(4, dtype=bool)
    unused = comparison(level, level + 9.0, nothing)
    partly = comparison(level, level + np.array([9.0, 0.1, 0.4, 0.2]), np.array([False, True, True, True]))
    whole = comparison(level, level + 0.3)
    one = score("force", [unused, whole, partly])
    assert (one.max_error_run, one.max_error_sample, one.max_error_time) == (2, 2, 0.04)
    assert one.max_error == pytest.approx(0.4)
    assert score("force", [unused, whole]).max_error == pytest.approx(0.3)


def test_of_several_runs_one_may_be_constant() -> None:
    moving, still = np.linspace(0.0, 1.0, 4), np.ones(4)
    one = score("force", [comparison(still, still), comparison(moving, moving)])
    assert (one.fit_percent, one.reason) == (100.0, "")
    none = score("force", [comparison(still, still), comparison(2.0 * still, still)])
    assert none.fit_percent is None
    assert none.reason.startswith("the measured output is constant")


@pytest.mark.parametrize(("rows", "lags"), [(20, 0), (21, 1), (40, 20), (45, 25), (1000, 25)])
def test_a_lag_needs_twenty_pairs_of_readings(rows: int, lags: int) -> None:
    found, band = autocorrelation(np.random.default_rng(SEED).standard_normal(rows))
    assert len(found) == len(band) == lags
    if lags == 20:
        assert band[-1] == pytest.approx(1.959964 / np.sqrt(20.0))
