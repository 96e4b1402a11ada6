"""Errors of instruments that are no noise of one size: steps of a converter, and noise that grows with the reading."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt
import pytest

from ipmclab import Fit, Run, RunMetadata, identify, load_actuator, simulate
from ipmclab.prediction.remarks import remarks
from tests.identification.brief import brief

FloatArray = npt.NDArray[np.float64]

FRIEND = load_actuator("friend-2")
STEP = 1e-4
CLEAN = [
    simulate(FRIEND, signal, duration=45.0, rate=20.0) for signal in ("step 1 V delay=5 s", "sine 1 V 0.1 Hz delay=5 s")
]


def rounded(generator: np.random.Generator, current: FloatArray) -> FloatArray:
    """Read in steps ten times the noise, with a zero that rounds to none at rest."""
    zero = generator.uniform(-0.5, 0.5) * STEP
    return np.asarray(np.round((current + zero + 0.1 * STEP * generator.standard_normal(len(current))) / STEP) * STEP)


def growing(generator: np.random.Generator, current: FloatArray) -> FloatArray:
    """0.1 mA at rest, 2.1 mA at 60 mA."""
    return np.asarray(current + 1e-4 * (1.0 + np.abs(current) / 3e-3) * generator.standard_normal(len(current)))


def even(generator: np.random.Generator, current: FloatArray) -> FloatArray:
    """0.1 mA."""
    return np.asarray(current + 1e-4 * generator.standard_normal(len(current)))


def humming(generator: np.random.Generator, current: FloatArray) -> FloatArray:
    """0.3 mA of 1.31 Hz beside 0.1 mA of noise."""
    time, phase = np.arange(len(current)) / 20.0, generator.uniform(0.0, 6.28)
    return even(generator, current) + 3e-4 * np.sin(2.0 * np.pi * 1.31 * time + phase)


Instrument = Callable[[np.random.Generator, FloatArray], FloatArray]


FIRST = 5000
"""Seed of the first trial of an instrument."""


@cache
def fitted(instrument: Instrument, seed: int) -> Fit:
    """Of the circuit, from records of one instrument: several tests ask for the same."""
    generator = np.random.default_rng(seed)
    runs: list[Run] = []
    for run in CLEAN:
        assert run.current is not None
        runs.append(replace(run, current=instrument(generator, run.current), metadata=RunMetadata(origin="measured")))
    return brief(FRIEND, runs)


@pytest.mark.parametrize("instrument", [rounded, growing, even])
def test_intervals_hold_the_true_values(instrument: Instrument) -> None:
    """Without an allowance for them 72 % do for the steps of the converter, and 80 % for noise that grows."""
    inside = []
    for seed in range(FIRST, FIRST + 40):
        for name, one in fitted(instrument, seed).parameters.items():
            if one.determined:
                low, high = one.interval
                inside.append(low <= FRIEND[name] <= high)
    assert len(inside) > 150
    # Five parameters of one fit count as two.
    assert np.mean(inside) > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / (0.4 * len(inside)))


def test_noise_that_grows_is_told_with_how_far() -> None:
    times = []
    for seed in range(FIRST, FIRST + 8):
        told = [one for one in fitted(growing, seed).findings if one.code == "noise-grows"]
        assert [one.channel for one in told] == ["current", "current"]
        times.append([one.values["times"] for one in told])
    largest = [float(np.max(np.abs(run.channels["current"]))) for run in CLEAN]
    assert np.mean(times, axis=0) == pytest.approx([1.0 + most / 3e-3 for most in largest], rel=0.2)


def test_noise_of_one_size_is_said_to_grow_once_in_a_thousand() -> None:
    fits = [fitted(even, seed) for seed in range(FIRST, FIRST + 30)]
    assert sum(one.code == "noise-grows" for fit in fits for one in fit.findings) <= 1


def test_a_hum_is_told_with_its_frequency_and_doubts_every_interval() -> None:
    fit = fitted(humming, 1)
    told = [one for one in fit.findings if one.code == "noise-not-described"]
    assert [one.severity for one in told] == ["warning", "warning"]
    for one in told:
        assert one.values["frequency"] == pytest.approx(1.31, abs=0.01)
        assert one.values["amplitude"] == pytest.approx(3e-4, rel=0.15)
    assert set(remarks(fit).values()) == {"its interval may be too small: the noise is not described"}


@pytest.mark.parametrize("times", [1, 3])
def test_what_a_model_leaves_of_a_sine_is_no_hum(times: int) -> None:
    """A part that follows the voltage, or a multiple of it, is an answer of the strip that the model lacks."""
    run = simulate(FRIEND, "sine 1 V 0.5 Hz", duration=45.0, rate=20.0)
    assert run.current is not None
    lacking = 3e-4 * np.sin(2.0 * np.pi * times * 0.5 * run.time + 1.0)
    seen = replace(run, current=even(np.random.default_rng(3), run.current) + lacking, metadata=RunMetadata())
    fit = identify(FRIEND, seen, free=["circuit.dc_resistivity", "circuit.branches.0.permittivity"])
    assert not [one for one in fit.findings if "hum" in one.message]
