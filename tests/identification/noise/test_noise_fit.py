"""Fits under noise that is not white: the noise that is found, and intervals that hold the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import scipy.signal

from ipmclab import InputError, Run, RunMetadata, identify, load_actuator, read_fit, simulate, write_fit
from ipmclab.identification.uncertainty import covariance
from ipmclab.prediction.bands import prediction_bands
from ipmclab.reporting.tables import parameter_rows
from ipmclab.statespace.long_run import long_run
from tests.independent.bounds import ELECTRICAL
from tests.independent.thesis import FRIEND_2, respond

Array = npt.NDArray[np.float64]
SEED = 20261121
RATE, ROWS, NOISE = 50.0, 2000, 1e-4
TIME = np.arange(ROWS) / RATE
FRIEND = load_actuator("friend-2")
VOLTAGES = [np.where(TIME >= 5.0, 1.0, 0.0), np.where(TIME >= 5.0, np.sin(0.2 * np.pi * (TIME - 5.0)), 0.0)]
CLEAN = [respond(FRIEND_2, voltage, RATE, "zero")["current"] for voltage in VOLTAGES]


def drawn(kind: str, generator: np.random.Generator) -> Array:
    white: Array = generator.standard_normal(ROWS)
    if kind == "AR(1)":
        white[1:] *= np.sqrt(1.0 - 0.9**2)
        return np.asarray(scipy.signal.lfilter([1.0], [1.0, -0.9], white))
    if kind == "drift":
        return white + generator.choice([-1.0, 1.0]) * 3.0 * TIME / TIME[-1]
    if kind == "walk":
        return white + np.cumsum(generator.standard_normal(ROWS)) * 3.0 / np.sqrt(ROWS)
    return white


def runs(kind: str, generator: np.random.Generator) -> list[Run]:
    rest = RunMetadata(starts_from_rest=True)
    return [
        Run.from_arrays(
            time=TIME,
            voltage=voltage,
            current=current + NOISE * drawn(kind, generator),
            hold="zero",
            metadata=rest,
        )
        for voltage, current in zip(VOLTAGES, CLEAN, strict=True)
    ]


def test_the_noise_is_told() -> None:
    fit = identify(FRIEND, runs("AR(1)", np.random.default_rng(SEED)))
    for observation in fit.observations:
        noise = observation.noise_model["current"]
        assert str(noise.terms) == "AR(1)"
        assert noise.coefficients[0] == pytest.approx(0.9, abs=0.04)
        assert np.sqrt(noise.stationary) == pytest.approx(NOISE, rel=0.25)
    said = [finding for finding in fit.findings if finding.code == "coloured-residuals"]
    assert len(said) == 2
    assert "AR(1)" in said[0].message


def test_a_drift_is_found_with_its_slope() -> None:
    fit = identify(FRIEND, runs("drift", np.random.default_rng(SEED)))
    slope = 3.0 * NOISE / TIME[-1]
    for observation in fit.observations:
        assert observation.noise_model["current"].trend
        assert abs(observation.offset["current"]) < 0.5 * NOISE
        assert observation.noise["current"] == pytest.approx(NOISE, rel=0.05)
    step, sine = (abs(observation.drift["current"]) for observation in fit.observations)
    # The leak and the slow branch answer to a step much as a drift does; to a sine they do not.
    assert step == pytest.approx(slope, rel=0.6)
    assert sine == pytest.approx(slope, rel=0.1)
    # What is left has the constants taken out.
    residual = fit.residuals[0]["current"]
    assert abs(np.polyfit(TIME, residual, 1)[0]) < 0.1 * slope


def test_white_noise_is_taken_as_such() -> None:
    fit = identify(FRIEND, runs("white", np.random.default_rng(SEED)))
    assert all(not observation.noise_model for observation in fit.observations)
    assert "coloured-residuals" not in {finding.code for finding in fit.findings}


def test_readings_that_are_missing_are_gaps_in_the_noise() -> None:
    generator = np.random.default_rng(SEED)
    full = runs("AR(1)", generator)
    masked = []
    for run in full:
        assert run.current is not None
        current = run.current.copy()
        current[generator.uniform(size=ROWS) < 0.3] = np.nan
        current[900:1000] = np.nan
        masked.append(replace(run, current=current))
    fit, whole = identify(FRIEND, masked), identify(FRIEND, full)
    for one, other in zip(fit.observations, whole.observations, strict=True):
        assert one.noise_model["current"].terms == other.noise_model["current"].terms
        assert one.noise_model["current"].coefficients[0] == pytest.approx(0.9, abs=0.05)
    for name in ELECTRICAL:
        assert fit.parameters[name].value == pytest.approx(
            whole.parameters[name].value, abs=3.0 * whole.parameters[name].standard_error
        )


def test_what_the_model_lacks_is_no_noise() -> None:
    """A strip of two branches fitted as one: no noise makes that right."""
    one = load_actuator("friend-2+branches=1")
    fit = identify(one, runs("white", np.random.default_rng(SEED)))
    codes = {finding.code for finding in fit.findings}
    assert {"model-error", "stage-missing"} <= codes
    assert "coloured-residuals" not in codes


def test_noise_is_not_held_for_what_the_model_lacks() -> None:
    """A step shows the first branch in a row or two: there least squares is a poor judge, and must know it."""
    generator = np.random.default_rng(SEED)
    for _ in range(6):
        fit = identify(FRIEND, runs("AR(1)", generator)[:1])
        assert "model-error-like-noise" not in {finding.code for finding in fit.findings}


@pytest.mark.parametrize("kind", ["white", "walk"])
def test_a_sum_of_autocovariances_is_refused_where_the_output_drifts(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A burst of hum is described by no model of the noise; under a drift nothing stands in for one."""
    asked = []

    def spy(jacobian: Array, residual: Array) -> Array:
        asked.append(len(residual))
        return long_run(jacobian, residual)

    monkeypatch.setattr(covariance, "long_run", spy)
    burst = np.where((TIME > 18.0) & (TIME < 22.0), 4.0 * NOISE * np.sin(2.0 * np.pi * 7.0 * TIME), 0.0)
    hummed = [replace(run, current=run.current + burst) for run in runs(kind, np.random.default_rng(SEED))]
    fit = identify(FRIEND, hummed)
    codes = {finding.code for finding in fit.findings}
    said = {row.remark for row in parameter_rows(fit) if row.determined}
    if kind == "walk":
        assert not asked
        assert "noise-not-described" in codes
        assert said == {"its interval may be too small: the noise is not described"}
    else:
        assert asked
        assert "noise-not-described" not in codes
        assert said == {""}


def test_the_noise_goes_into_the_file_and_back(tmp_path: Path) -> None:
    fit = identify(FRIEND, runs("walk", np.random.default_rng(SEED)))
    write_fit(fit, tmp_path / "fitted.toml")
    again = read_fit(tmp_path / "fitted.toml")
    assert again.observations == fit.observations
    assert again.observations[0].noise_model["current"].walk > 0.0


def test_bands_hold_new_readings_and_the_answer_itself() -> None:
    generator = np.random.default_rng(SEED)
    fit = identify(FRIEND, runs("AR(1)", generator))
    new = simulate(FRIEND, "sine 1 V 0.25 Hz", duration=40.0, rate=RATE)
    assert new.current is not None
    bands = prediction_bands(fit, new)
    low, high = bands.interval("current")
    inside = np.mean(
        [(low <= r) & (r <= high) for r in (new.current + NOISE * drawn("AR(1)", generator) for _ in range(20))]
    )
    assert 0.9 < inside < 0.985
    low, high = bands.interval("current", of_readings=False)
    assert np.mean((low <= new.current) & (new.current <= high)) > 0.5
    assert np.all(bands.of_parameters["current"] < bands.of_noise["current"])
    assert bands.left_out == ()
    with pytest.raises(InputError, match="between 0 and 1"):
        bands.interval("current", 1.0)


@pytest.mark.parametrize("seed", [0, 12])
def test_a_zero_of_the_current_that_no_rest_shows_is_no_error_of_the_model(seed: int) -> None:
    """It led least squares so far away that what they left was taken for what the model lacks, and no noise for any."""
    generator = np.random.default_rng([20261121, seed])
    library = load_actuator("friend-2")
    names = list(ELECTRICAL)
    strip = library.replace(**{n: library[n] * float(np.exp(0.15 * generator.standard_normal())) for n in names})
    known = replace(library, standard_uncertainties={name: 0.15 * library[name] for name in names})
    clean = simulate(strip, "square 1 V 0.1 Hz", duration=20, rate=20)
    assert clean.current is not None
    noise = scipy.signal.lfilter(
        [3e-4 * np.sqrt(1.0 - 0.81)], [1.0, -0.9], generator.standard_normal(len(clean) + 200)
    )[200:]
    run = Run.from_arrays(
        time=clean.time,
        voltage=clean.voltage,
        current=clean.current + noise + 1e-3,
        hold="zero",
        metadata=RunMetadata(starts_from_rest=True),
    )
    fit = identify(known, [run], free="electrical", prior="electrical")
    assert "model-error-like-noise" not in {finding.code for finding in fit.findings}
    assert fit.observations[0].offset["current"] == pytest.approx(1e-3, abs=5e-4)
    for name in names:
        low, high = fit.parameters[name].interval
        assert low < strip[name] < high
