"""The likelihood of correlated residuals, against dense covariance matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from ipmclab.choosing.noise import FadingNoise, Part, ResidualSeries, fit_noise

SEED = 20261121


def covariance(time: np.ndarray, noise: FadingNoise, series: ResidualSeries) -> np.ndarray:
    """Of every two rows, from the definition."""
    apart = np.abs(time[:, None] - time)
    matrix = np.diag(np.full(len(time), (noise.white * series.noise) ** 2))
    for part in noise.parts:
        matrix += (part.amplitude * series.extent) ** 2 * np.exp(-apart / part.time_constant)
    return matrix


def uneven() -> ResidualSeries:
    """Rows at unequal steps, with a gap and rows that are not seen."""
    generator = np.random.default_rng(SEED)
    time = np.cumsum(generator.uniform(0.01, 0.2, 60))
    time[30:] += 3.0
    observed = generator.uniform(size=60) > 0.2
    return ResidualSeries(time, generator.standard_normal(60), observed, noise=0.7, extent=2.0)


def even() -> ResidualSeries:
    """Rows at equal steps but for rounding, of which the last few are not seen: the gain settles."""
    time = 0.1 * np.arange(300)
    residual = np.random.default_rng(SEED).standard_normal(300)
    return ResidualSeries(time, residual, np.arange(300) < 290, noise=0.7, extent=2.0)


NOISES = (
    FadingNoise(1.3),
    FadingNoise(0.5, (Part(0.4, 0.3),)),
    FadingNoise(0.5, (Part(0.4, 0.3), Part(1.1, 20.0))),
)


@pytest.mark.parametrize("series", [uneven(), even()], ids=["uneven", "even"])
@pytest.mark.parametrize("rows", [300, 1, 0])
@pytest.mark.parametrize("noise", NOISES, ids=lambda one: f"{len(one.parts)} parts")
def test_density_is_that_of_the_dense_gaussian(noise: FadingNoise, rows: int, series: ResidualSeries) -> None:
    observed = series.observed & (np.cumsum(series.observed) <= rows)
    if not rows:
        assert noise.filter(series, observed).total == 0.0
        return
    dense = multivariate_normal(cov=covariance(series.time[observed], noise, series))
    assert noise.filter(series, observed).total == pytest.approx(dense.logpdf(series.residual[observed]), rel=1e-9)


@pytest.mark.parametrize("noise", NOISES, ids=lambda one: f"{len(one.parts)} parts")
def test_effective_readings_are_those_of_the_mean(noise: FadingNoise) -> None:
    time = np.arange(1500) * 0.02
    series = ResidualSeries(time, np.zeros(1500), np.full(1500, True), noise=0.7, extent=2.0)
    dense = covariance(time, noise, series)
    wanted = dense[0, 0] / dense.mean()
    assert noise.effective_readings(series) == pytest.approx(wanted, rel=0.02)


def test_the_noise_that_made_a_residual_is_found() -> None:
    generator = np.random.default_rng(SEED)
    time = np.arange(4000) * 0.02
    decay = np.exp(-0.02 / 0.5)
    slow = np.empty(4000)
    slow[0] = 0.0
    for row in range(1, 4000):
        slow[row] = decay * slow[row - 1] + np.sqrt(1.0 - decay**2) * generator.standard_normal()
    residual = 0.3 * slow + 0.1 * generator.standard_normal(4000)
    found = fit_noise([ResidualSeries(time, residual, np.full(4000, True), noise=0.1, extent=1.0)])
    assert len(found.parts) == 1
    assert found.white == pytest.approx(1.0, rel=0.1)
    # 80 s hold 80 independent stretches: amplitude and duration are known to about 1/sqrt(80).
    assert found.parts[0].amplitude == pytest.approx(0.3, rel=0.3)
    assert found.parts[0].time_constant == pytest.approx(0.5, rel=0.5)


def test_a_residual_of_rounding_has_a_finite_density() -> None:
    series = ResidualSeries(np.arange(100.0), np.zeros(100), np.full(100, True), noise=1e-9, extent=1.0)
    assert np.isfinite(fit_noise([series]).filter(series).total)
