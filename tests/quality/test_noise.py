"""The noise of a channel against noise of known standard deviation."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.quality import noise_level

TIME = np.arange(2000) / 50.0
RNG = np.random.default_rng(20261121)
SIGNALS = {
    "constant": np.zeros(2000),
    "step": 0.05 * np.exp(-TIME / 0.75) + 0.01 * np.exp(-TIME / 16.0),
    "sine": 0.035 * np.sin(2 * np.pi * 0.1 * TIME),
    "square": 0.035 * np.sign(np.sin(2 * np.pi * 0.1 * TIME + 1e-9)),
    "chirp to a tenth of the rate": 0.035 * np.sin(2 * np.pi * (0.05 * TIME + 0.062 * TIME**2)),
    "binary sequence": 0.035 * np.repeat(RNG.choice([-1.0, 1.0], 200), 10),
}


def readings(signal: str, sd: float, quantum: float, rng: np.random.Generator) -> npt.NDArray[np.float64]:
    values = SIGNALS[signal] + rng.normal(0.0, sd, 2000)
    return np.rint(values / quantum) * quantum if quantum else values


@pytest.mark.parametrize("signal", SIGNALS)
@pytest.mark.parametrize("quantum", [0.0, 6e-6, 1e-4])
def test_white_noise_on_a_signal_is_found_within_three_percent(signal: str, quantum: float) -> None:
    rng = np.random.default_rng(20261121)
    expected = math.hypot(1e-4, quantum / math.sqrt(12.0))
    ratios = np.array([noise_level(readings(signal, 1e-4, quantum, rng)) / expected for _ in range(60)])
    assert abs(ratios.mean() - 1.0) < 0.015
    assert ratios.std() < 0.035


@pytest.mark.parametrize("fraction", [0.1, 0.25, 0.5])
def test_stale_repeats_do_not_lower_it(fraction: float) -> None:
    rng = np.random.default_rng(20261121)
    ratios = []
    for _ in range(40):
        fresh = readings("step", 1e-4, 6e-6, rng)
        rows = np.where(rng.random(2000) < fraction, 0, np.arange(2000))
        ratios.append(noise_level(fresh[np.maximum.accumulate(rows)]) / 1e-4)
    assert abs(np.mean(ratios) - 1.0) < 0.05


def test_spikes_and_gaps_do_not_raise_it() -> None:
    values = readings("sine", 1e-4, 0.0, np.random.default_rng(20261121))
    expected = noise_level(values)
    values[100::200] += 0.02
    values[500:600] = np.nan
    assert noise_level(values) == pytest.approx(expected, rel=0.05)


def test_a_channel_cut_off_most_of_the_time_still_shows_its_noise() -> None:
    values = readings("sine", 1e-4, 0.0, np.random.default_rng(20261121)).clip(None, -0.01)
    assert noise_level(values) == pytest.approx(1e-4, rel=0.15)


def test_a_noiseless_rounded_ramp_has_the_noise_of_its_rounding() -> None:
    ramp = np.rint(np.linspace(0.0, 50.0, 2000))
    assert 1.0 / math.sqrt(12.0) <= noise_level(ramp) < 0.5


@pytest.mark.parametrize("values", [[], [1.0], [1.0, 2.0], [3.0] * 100, [float("nan")] * 10])
def test_what_cannot_show_noise_has_none(values: list[float]) -> None:
    assert noise_level(values) == 0.0


@given(scale=st.floats(1e-6, 1e6), offset=st.floats(-10.0, 10.0), seed=st.integers(0, 99))
def test_it_scales_with_the_unit_and_ignores_the_zero(scale: float, offset: float, seed: int) -> None:
    values = np.random.default_rng(seed).normal(0.0, 1.0, 300)
    assert noise_level(scale * (values + offset)) == pytest.approx(scale * noise_level(values), rel=1e-6)
