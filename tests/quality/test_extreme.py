"""Extremes of noisy channels: the intervals against many draws of the noise, the edge cases against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from ipmclab.quality import Metric, measure
from ipmclab.run import Run

Array = npt.NDArray[np.float64]

TIME = np.arange(1000) / 50.0
AFTER = np.maximum(TIME - 2.0, 0.0)
STEP = np.where(TIME >= 2.0, 1.0, 0.0)
SINE = np.sin(2 * math.pi * 0.25 * TIME)
LATE = np.sin(2 * math.pi * 0.25 * TIME - 0.7)
SQUARE = np.where(np.arange(1000) % 200 < 100, 1.0, -1.0)
REVERSALS = SQUARE * (10.0 + 50.0 * np.exp(-(np.arange(1000) % 100) / 100.0))
BUMP = np.exp(-0.1 * AFTER) - np.exp(-AFTER)
TOP = float(BUMP.max())
LEFT = 1.0 - float(BUMP[910:].mean()) / TOP
INRUSH = STEP * (10.0 + 50.0 * np.exp(-AFTER / 0.043))
DECAY = STEP * (10.0 + 50.0 * np.exp(-AFTER / 4.0))
DRAWS = 40


def drawn(voltage: Array, clean: Array, noise: float, seed: int, channel: str, quantum: float = 0.0) -> Run:
    readings = clean + np.random.default_rng([20261121, seed]).normal(0.0, noise, len(clean))
    if quantum:
        readings = np.rint(readings / quantum) * quantum
    return replace(Run.from_arrays(time=TIME, voltage=voltage), **{channel: readings})  # type: ignore[arg-type]


def measured(run: Run) -> dict[str, Metric]:
    return {metric.name: metric for metric in measure(run)}


@pytest.mark.parametrize(
    ("name", "channel", "voltage", "clean", "noise", "truth", "sharp"),
    [
        ("amplitude", "force", SINE, LATE, 0.08, 1.0, 0.4),
        ("amplitude", "current", SQUARE, REVERSALS, 0.5, 60.0, 1.1),
        ("largest", "force", SINE, 0.5 + LATE, 0.08, 1.5, 0.5),
        ("largest", "force", STEP, 1.0 - np.exp(-AFTER), 0.08, 1.0, 0.4),
        ("largest", "current", STEP, DECAY, 0.5, 60.0, 1.1),
        ("largest", "current", STEP, INRUSH, 0.5, 60.0, 1.1),
        ("peak_at_first_edge", "displacement", STEP, -BUMP, 0.02, -TOP, 0.4),
        ("peak_at_first_edge", "current", STEP, INRUSH, 0.5, 60.0, 1.1),
        ("back_relaxation", "displacement", STEP, BUMP, 0.02, LEFT, None),
    ],
)
def test_the_interval_holds_the_truth(
    name: str, channel: str, voltage: Array, clean: Array, noise: float, truth: float, sharp: float | None
) -> None:
    """In 95 % of the draws, with a bias below the interval, and sharper than one reading where many say the same."""
    found = [measured(drawn(voltage, clean, noise, seed, channel))[name] for seed in range(DRAWS)]
    values = np.array([metric.value for metric in found])
    low, high = np.array([metric.interval for metric in found], dtype=float).T
    assert np.mean((low <= truth) & (truth <= high)) >= 0.88
    half = float(np.median(high - low)) / 2.0
    assert abs(values.mean() - truth) < 0.5 * half
    assert values.std() > half / 8.0  # no interval so wide that it says nothing
    if sharp is not None:
        assert half / 1.96 < sharp * noise


def test_readings_without_noise_stay_the_readings() -> None:
    for quantum in (0.0, 0.01):
        run = drawn(STEP, BUMP, 0.0, 0, "displacement", quantum)
        assert run.displacement is not None
        found = measured(run)
        assert found["largest"].value == found["peak_at_first_edge"].value == run.displacement.max()
        assert found["time_to_peak"].value == pytest.approx(TIME[run.displacement.argmax()] - 2.0)
        sine = drawn(SINE, LATE, 0.0, 0, "force", quantum)
        assert sine.force is not None
        assert measured(sine)["amplitude"].value == np.ptp(sine.force[-200:]) / 2.0


@pytest.mark.parametrize("late", [0, 1, 2])
def test_an_inrush_is_not_smoothed_away(late: int) -> None:
    """Also where the current comes a row or two after the recorded voltage."""
    run = drawn(STEP, np.roll(INRUSH, late), 0.1, 3, "current")
    assert run.current is not None
    found = measured(run)
    assert found["peak_at_first_edge"].value == pytest.approx(run.current.max(), abs=0.02)
    assert found["time_to_peak"].value == pytest.approx(late / 50.0)


def test_missing_readings_around_the_top() -> None:
    run = drawn(STEP, BUMP, 0.02, 5, "displacement")
    assert run.displacement is not None
    found = measured(
        replace(run, displacement=np.where(np.isin(np.arange(len(run)), range(200, 212)), np.nan, run.displacement))
    )["largest"]
    assert found.interval is not None
    assert found.interval[0] <= TOP <= found.interval[1]


def test_the_definition_says_how() -> None:
    found = measured(drawn(STEP, BUMP, 0.02, 7, "displacement"))
    assert "parabola" in found["largest"].definition
    assert "parabola" in found["peak_at_first_edge"].definition
