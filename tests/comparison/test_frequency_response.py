"""The best linear approximation against the model's own transfer function, with known noise and known nonlinearity."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ipmclab import load_actuator, simulate
from ipmclab.comparison.frequency_response import frequency_response, response_in_rows
from ipmclab.errors import InputError
from ipmclab.run import Run, RunMetadata

SIGNAL = "multisine 1 V 0.05 Hz 4 Hz harmonics=odd phases=random left_out=4 seed=3"
RATE, PERIODS = 50.0, 18
NOISE = 4e-6
"""Standard deviation of the added noise [m]."""


@pytest.fixture(scope="module")
def clean() -> Run:
    return simulate(load_actuator("friend-2"), SIGNAL, duration=20.0 * PERIODS, rate=RATE)


def noisy(run: Run, seed: int = 20261121) -> Run:
    assert run.displacement is not None
    added = NOISE * np.random.default_rng(seed).normal(size=len(run))
    return replace(run, displacement=run.displacement + added)


@pytest.mark.parametrize("hold", ["zero", "zero-before"])
@pytest.mark.parametrize("channel", ["current", "displacement", "force"])
def test_without_noise_it_is_the_models_own(channel: str, hold: str) -> None:
    """The slowest mode has 1e-6 left after the periods that are skipped."""
    run = simulate(load_actuator("friend-2"), SIGNAL, duration=280.0, rate=RATE, hold=hold)
    found = frequency_response(run, channel)
    assert found.periods == 2
    own = response_in_rows(load_actuator("friend-2").system, found.frequency, RATE, channel, hold=hold)
    assert np.max(np.abs(found.response - own)) < 1e-5 * np.max(np.abs(own))


def test_noise_is_known_for_what_it_is_and_hides_nothing(clean: Run) -> None:
    found = frequency_response(noisy(clean))
    lines = round(4.0 / 0.05) - 1  # to the highest driven one
    expected = NOISE * math.sqrt(2.0 * lines / (found.periods * 20.0 * RATE))
    assert found.noise_rms == pytest.approx(expected, rel=0.1)
    assert found.even_rms < 0.5 * expected
    assert found.odd_rms < 0.5 * expected


def test_errors_are_the_scatter_of_magnitude_and_phase(clean: Run) -> None:
    """Of 30 records of the same strip; the transient is gone, and the number of periods stays."""
    every = [frequency_response(noisy(clean, seed), skip=12) for seed in range(30)]
    own = response_in_rows(load_actuator("friend-2").system, every[0].frequency, RATE)
    apart = np.array([np.abs(one.response) - np.abs(own) for one in every])
    turned = np.array([np.angle(one.response / own) * np.abs(own) for one in every])
    error = np.array([one.noise_error for one in every])
    assert np.mean((apart / error) ** 2) == pytest.approx(1.0, abs=0.1)
    assert np.mean((turned / error) ** 2) == pytest.approx(1.0, abs=0.1)


def bent(run: Run, square: float, cube: float) -> Run:
    """A static nonlinearity after the strip."""
    assert run.displacement is not None
    x = run.displacement / 5e-5
    return replace(run, displacement=5e-5 * (x + square * x**2 + cube * x**3))


def test_even_distortion_is_what_a_square_adds(clean: Run) -> None:
    found = frequency_response(bent(clean, 0.05, 0.0), skip=PERIODS - 2)
    assert clean.displacement is not None
    added = np.fft.rfft(5e-5 * 0.05 * (clean.displacement[-1000:] / 5e-5) ** 2)[2:80:2] / 1000.0
    even = math.sqrt(2.0 * float(np.sum(np.abs(added) ** 2)))
    assert found.even_rms == pytest.approx(even, rel=0.01)
    assert found.odd_rms < 0.01 * even


def test_odd_distortion_is_as_large_as_what_a_cube_adds_beside_its_gain() -> None:
    """At the driven lines it moves the approximation as far as its error says, over six choices of the phases."""
    apart = []
    for seed in range(6):
        run = simulate(load_actuator("friend-2"), SIGNAL.replace("seed=3", f"seed={seed}"), duration=200.0, rate=RATE)
        assert run.displacement is not None
        found = frequency_response(bent(run, 0.0, 0.05), skip=8)
        assert found.even_rms < 1e-2 * found.odd_rms
        own = response_in_rows(load_actuator("friend-2").system, found.frequency, RATE)
        # A sine of amplitude A among others, through x + c x^3: its gain is 1 + 3 c (var(x) - A^2 / 4).
        variance = float(np.var(run.displacement[-1000:])) / 5e-5**2
        gain = 1.0 + 3.0 * 0.05 * (variance - 0.25 * (found.output / 5e-5) ** 2)
        apart.append(np.mean(np.abs(found.response - gain * own) ** 2 / (2.0 * found.standard_error**2)))
        assert np.mean(found.noise_error) < 0.1 * np.mean(found.standard_error)
    assert 0.7 < math.sqrt(float(np.mean(apart))) < 1.4


def test_a_straight_drift_is_taken_out(clean: Run) -> None:
    assert clean.displacement is not None
    drifting = frequency_response(replace(clean, displacement=clean.displacement + 2e-6 * clean.time))
    plain = frequency_response(clean)
    assert np.max(np.abs(drifting.response - plain.response)) < 1e-5 * np.max(np.abs(plain.response))


def test_the_transient_is_left_out_by_itself(clean: Run) -> None:
    """Noise decides: what is below it may stay."""
    assert frequency_response(clean).skipped == PERIODS - 2
    assert 1 <= frequency_response(noisy(clean)).skipped <= 4


def test_a_rest_before_the_multisine_is_no_period() -> None:
    """As recorders give it out: 25 s at 0 V, then four periods."""
    run = simulate(load_actuator("friend-2"), f"step 0 V for 25 s then {SIGNAL}", duration=105.0, rate=RATE)
    found = frequency_response(run)
    assert (found.periods, found.skipped) == (2, 2)
    alone = frequency_response(simulate(load_actuator("friend-2"), SIGNAL, duration=80.0, rate=RATE))
    assert np.max(np.abs(found.response - alone.response)) < 1e-9 * np.max(np.abs(alone.response))


def test_readings_of_a_lost_laser_are_no_answer_of_the_strip(clean: Run) -> None:
    """40 rows at the end of the laser's range made a gain four times as large."""
    displacement = noisy(clean).displacement
    assert displacement is not None
    lost = displacement.copy()
    lost[5000:5040] = 25e-3
    with pytest.raises(InputError, match="40 readings of the displacement are missing, or are no values"):
        frequency_response(replace(noisy(clean), displacement=lost))
    before = displacement.copy()
    before[:3] = np.nan
    rest = np.zeros(500)  # a gap before the first period is none of it
    time = np.arange(len(before) + 500) / RATE
    about = RunMetadata(signal=f"step 0 V for {500 / RATE:g} s then {SIGNAL}")
    run = Run.from_arrays(
        time=time,
        voltage=np.concatenate([rest, clean.voltage]),
        displacement=np.concatenate([rest * np.nan, displacement]),
        metadata=about,
    )
    assert frequency_response(run).periods >= 2


def test_what_cannot_be_read_is_refused() -> None:
    time = np.arange(100) / 10.0
    wave = np.sin(2.0 * math.pi * 0.5 * time)
    gap = np.where(time == 5.0, np.nan, wave)
    named = RunMetadata(signal="sine 1 V 0.3 Hz")
    for run, message in [
        (Run.from_arrays(time=time, voltage=np.ones(100), displacement=wave), "the voltage is not periodic"),
        (Run.from_arrays(time=time, voltage=wave, current=wave), "the run has no displacement"),
        (
            Run.from_arrays(time=time, voltage=wave, displacement=gap),
            "1 readings of the displacement are missing, or are no values",
        ),
        (Run.from_arrays(time=time[:35], voltage=wave[:35], displacement=wave[:35]), "not periodic"),
        (Run.from_arrays(time=time, voltage=wave, displacement=wave, metadata=named), "has 33.3333 rows at 10 Hz"),
    ]:
        with pytest.raises(InputError, match=message):
            frequency_response(run)
    with pytest.raises(InputError, match="the record ends with 5 whole periods of 2 s, 4 to be left out"):
        frequency_response(Run.from_arrays(time=time, voltage=wave, displacement=wave), skip=4)
    with pytest.raises(InputError, match="rows of hold 'first'"):
        response_in_rows(load_actuator("friend-2").system, [1.0], 50.0, hold="first")


@pytest.mark.parametrize(("skip", "left"), [(-1, None), (0, 5), (1, 4), (3, 2), (4, None)])
def test_two_periods_at_least_are_left_of_those_there_are(skip: int, left: int | None) -> None:
    time = np.arange(100) / 10.0
    wave = np.sin(2.0 * math.pi * 0.5 * time)
    run = Run.from_arrays(time=time, voltage=wave, displacement=wave)
    if left is None:
        with pytest.raises(InputError, match=f"the record ends with 5 whole periods of 2 s, {skip} to be left out"):
            frequency_response(run, skip=skip)
    else:
        found = frequency_response(run, skip=skip)
        assert (found.skipped, found.periods) == (skip, left)


@pytest.mark.parametrize(("periods", "is_enough"), [(1, False), (2, True), (3, True)])
def test_one_period_does_not_tell_noise_from_an_answer(periods: int, is_enough: bool) -> None:
    time = np.arange(20 * periods) / 10.0
    wave = np.sin(2.0 * math.pi * 0.5 * time)
    about = RunMetadata(signal="multisine 1 V 0.5 Hz 1 Hz")
    run = Run.from_arrays(time=time, voltage=wave, displacement=wave, metadata=about)
    if is_enough:
        assert frequency_response(run).response == pytest.approx([1.0])
    else:
        with pytest.raises(InputError, match="the record ends with 1 whole period of 2 s") as caught:
            frequency_response(run)
        assert caught.value.code == "too-short"


def test_distortion_that_no_line_shows_is_not_said_to_be_0() -> None:
    run = simulate(load_actuator("friend-2"), "multisine 1 V 0.05 Hz 2 Hz", duration=80.0, rate=50.0)
    found = frequency_response(run)
    assert math.isnan(found.even_rms)
    assert math.isnan(found.odd_rms)
    assert "odd distortion not measured" in str(found)
