"""Metrics of noisy records of friend-2, against the exact numbers of the clean ones."""

from __future__ import annotations

import numpy as np
import pytest

import ipmclab
from ipmclab.quality.metrics import Metric
from tests.independent.thesis import FRIEND_2, respond

RATE, ROWS = 50.0, 2000
TIME = np.arange(ROWS) / RATE
NOISE = {"current": 1e-4, "displacement": 2e-6, "force": 1e-4}


def metrics(voltage: np.ndarray, seed: int, extra: np.ndarray | None = None) -> dict[tuple[str, str], Metric]:
    generator = np.random.default_rng(seed)
    clean = respond(FRIEND_2, voltage, RATE, "zero")
    channels = {name: clean[name] + level * generator.standard_normal(ROWS) for name, level in NOISE.items()}
    if extra is not None:
        channels["current"] = channels["current"] + extra
    run = ipmclab.Run.from_arrays(
        time=TIME, voltage=voltage, **channels, metadata=ipmclab.RunMetadata(starts_from_rest=True)
    )
    found = ipmclab.measure(run)
    for metric in found:
        assert metric.definition
        assert np.isfinite(metric.value)
    return {(metric.name, metric.channel): metric for metric in found}


STEP = (TIME >= 2.0).astype(float)
SINE = np.sin(2 * np.pi * 0.1 * TIME)


def contains(metric: Metric, truth: float) -> bool:
    assert metric.interval is not None
    low, high = metric.interval
    return bool(low <= truth <= high)


@pytest.mark.parametrize("channel", list(NOISE))
def test_amplitude_of_a_sine_holds_the_truth(channel: str) -> None:
    clean = respond(FRIEND_2, SINE, RATE, "zero")[channel][-500:]
    truth = np.ptp(clean) / 2.0
    hits = 0
    for seed in range(8):
        metric = metrics(SINE, seed)["amplitude", channel]
        assert metric.value == pytest.approx(truth, rel=0.05), channel
        hits += contains(metric, truth)
    assert hits >= 6, "a 95 % interval holds the truth"


def test_phase_of_a_sine() -> None:
    clean = respond(FRIEND_2, SINE, RATE, "zero")
    for channel in NOISE:
        phasor = np.sum(clean[channel][-500:] * np.exp(-2j * np.pi * 0.1 * TIME[-500:]))
        drive = np.sum(SINE[-500:] * np.exp(-2j * np.pi * 0.1 * TIME[-500:]))
        assert metrics(SINE, 1)["phase", channel].value == pytest.approx(np.angle(phasor / drive), abs=0.03)


def test_harmonics_of_a_distorted_current() -> None:
    extra = 2e-3 * np.sin(2 * np.pi * 0.3 * TIME + 0.4) + 1e-3 * np.cos(2 * np.pi * 0.5 * TIME)
    found = metrics(SINE, 2, extra)
    clean = respond(FRIEND_2, SINE, RATE, "zero")["current"][-500:]
    fundamental = abs(2.0 * np.mean(clean * np.exp(-2j * np.pi * 0.1 * TIME[-500:])))
    assert found["harmonic_3", "current"].value == pytest.approx(2e-3 / fundamental, rel=0.05)
    assert found["harmonic_5", "current"].value == pytest.approx(1e-3 / fundamental, rel=0.05)
    assert found["harmonic_2", "current"].value < 3e-3


DIVIDER = FRIEND_2.dc_resistance / (FRIEND_2.dc_resistance + FRIEND_2.series_resistance)
STATIC_COUPLING = FRIEND_2.gain * FRIEND_2.zero / FRIEND_2.p2
LIMITS = {
    "current": 1.0 / (FRIEND_2.dc_resistance + FRIEND_2.series_resistance),
    "force": DIVIDER
    * STATIC_COUPLING
    * 3.0
    * FRIEND_2.thickness
    * FRIEND_2.width
    * FRIEND_2.modulus
    / (4.0 * FRIEND_2.sensing_length),
    "displacement": DIVIDER * STATIC_COUPLING * 3.0 * FRIEND_2.sensing_length**2 / FRIEND_2.thickness**2,
}


@pytest.mark.parametrize("channel", LIMITS)
def test_steady_value_is_the_limit_not_the_end(channel: str) -> None:
    hits = closer = 0
    for seed in range(8):
        found = metrics(STEP, seed)
        steady, end = found["steady_value", channel], found["mean_of_last_tenth", channel]
        assert steady.value == pytest.approx(LIMITS[channel], rel=0.15)
        closer += abs(steady.value - LIMITS[channel]) < abs(end.value - LIMITS[channel])
        hits += contains(steady, LIMITS[channel])
    assert hits >= 6, "a 95 % interval holds the truth"
    assert closer >= 6 or channel == "force"  # 0.1 mN of noise: the end is as good a guess


@pytest.mark.parametrize(("channel", "truth"), [("current", 60.348e-3), ("force", None), ("displacement", None)])
def test_largest_reading_is_not_the_largest_noise(channel: str, truth: float | None) -> None:
    value = truth or float(np.max(respond(FRIEND_2, STEP, RATE, "zero")[channel]))
    hits = 0
    for seed in range(8):
        metric = metrics(STEP, seed)["largest", channel]
        assert metric.value == pytest.approx(value, rel=0.05)
        hits += contains(metric, value)
    assert hits >= 6


def test_peak_at_the_first_edge_and_its_time() -> None:
    square = np.sign(np.sin(2 * np.pi * 0.1 * TIME + 1e-9))
    found = metrics(square, 3)
    clean = respond(FRIEND_2, square, RATE, "zero")["current"]
    assert found["peak_at_first_edge", "current"].value == pytest.approx(clean[0], rel=0.02)
    assert found["time_to_peak", "current"].value == 0.0
    # At a reversal the current is larger: that is another metric.
    assert abs(found["largest", "current"].value) == pytest.approx(np.max(np.abs(clean)), rel=0.02)


def test_back_relaxation_after_the_peak() -> None:
    # A strip that gives back a third of its bend: 1 - exp(-t/1 s) less a third of 1 - exp(-t/8 s).
    generator = np.random.default_rng(1)
    after = (TIME - 2.0).clip(0)
    bend = 1e-3 * ((1 - np.exp(-after / 1.0)) - (1 - np.exp(-after / 8.0)) / 3.0)
    run = ipmclab.Run.from_arrays(time=TIME, voltage=STEP, displacement=bend + 2e-6 * generator.standard_normal(ROWS))
    found = {metric.name: metric for metric in ipmclab.measure(run)}
    fine = np.linspace(0, 38, 200_000)
    curve = 1e-3 * ((1 - np.exp(-fine)) - (1 - np.exp(-fine / 8.0)) / 3.0)
    assert found["peak_at_first_edge"].value == pytest.approx(curve.max(), rel=0.02)
    assert found["time_to_peak"].value == pytest.approx(fine[curve.argmax()], abs=0.4)
    relaxations = [metric for name, metric in found.items() if "relax" in name]
    assert relaxations
    fall = curve.max() - curve[-1]
    assert any(
        metric.value == pytest.approx(fall, rel=0.05) or metric.value == pytest.approx(fall / curve.max(), rel=0.05)
        for metric in relaxations
    )
