"""The zero of a current, which the rows at 0 V hold."""

from __future__ import annotations

import numpy as np
import pytest

from ipmclab import Run, RunMetadata, check, identify, load_actuator, simulate
from ipmclab.identification.problem.free import parse_free
from ipmclab.identification.problem.record import prepare
from ipmclab.identification.problem.unknowns import Unknown, unknowns_of
from ipmclab.model import simulate_outputs

STRIP = load_actuator("friend-2")
CLEAN = simulate(STRIP, "step 1 V delay=4 s", duration=20.0, rate=25.0)
FREE = ["circuit.dc_resistivity", "circuit.branches.1.permittivity"]
ZERO = 3e-4


def record(added: np.ndarray, voltage: np.ndarray = CLEAN.voltage) -> Run:
    clean = simulate_outputs(STRIP, CLEAN.time, voltage, "zero", outputs=["current"])[0]
    return Run.from_arrays(time=CLEAN.time, voltage=voltage, current=np.asarray(clean) + added, hold="zero")


def white(noise: float, seed: int) -> np.ndarray:
    return noise * np.random.default_rng([20261127, seed]).standard_normal(len(CLEAN))


def sensors(run: Run) -> list[Unknown]:
    names = parse_free(STRIP.parameter_values, FREE)
    prepared = prepare(run, 0, ["current"], check(run))
    return [one for one in unknowns_of(names, STRIP.parameters(), [prepared]) if one.is_of_sensor]


@pytest.mark.parametrize("code", [2.0**-13, 2.0**-12])
def test_a_converter_that_shows_one_code_at_rest_hides_half_a_step(code: float) -> None:
    """The check knows no error of readings that are all alike: limits of no width were a ZeroDivisionError."""
    for share in (0.6, 1.1, 1.4):
        clean = record(np.full(len(CLEAN), share * code))
        assert clean.current is not None
        run = Run.from_arrays(
            time=clean.time, voltage=clean.voltage, current=np.round(clean.current / code) * code, hold="zero"
        )
        (sensor,) = sensors(run)
        assert sensor.lower <= share * code <= sensor.upper
        fit = identify(STRIP, run, free=FREE)
        for name in FREE:
            low, high = fit.parameters[name].interval
            assert low <= STRIP[name] <= high


@pytest.mark.parametrize("noise", [2e-4, 2e-5, 5e-6])
def test_a_zero_within_its_rows_is_at_no_bound(noise: float) -> None:
    """The rows hold it far more tightly than the range of the readings, in which a bound was thought near."""
    for seed in range(5):
        fit = identify(STRIP, record(ZERO + white(noise, seed)), free=FREE)
        zero = fit.parameters["observation.offset.current[0]"]
        assert not zero.at_bound
        assert zero.determined
        assert abs(zero.value - ZERO) < 4.0 * zero.standard_error
        assert "model-incomplete" not in {finding.code for finding in fit.findings}


def test_a_voltage_that_is_nearly_0_is_no_rest_to_hold_a_zero_by() -> None:
    """At 15 mV the strip draws as much of its largest current as they are of the step."""
    resting = np.where(CLEAN.voltage == 0.0, 0.015, CLEAN.voltage)
    fit = identify(STRIP, record(ZERO + white(2e-5, 0), resting), free=FREE)
    zero = fit.parameters.get("observation.offset.current[0]")
    assert zero is not None
    assert zero.interval[0] <= ZERO <= zero.interval[1]
    for name in FREE:
        low, high = fit.parameters[name].interval
        assert low <= STRIP[name] <= high


def test_a_current_that_denies_rest_is_asked_though_another_channel_is_fitted() -> None:
    """A strip that creeps back at 0 V for 8 s: its displacement alone would be fitted as from rest."""
    strip = load_actuator("friend-2+relaxation.displacement=1")
    time = np.arange(0.0, 90.0, 0.04)
    voltage = np.where(time < 40.0, 2.0, np.where(time < 50.0, 0.0, 1.0))
    current, displacement = np.asarray(
        simulate_outputs(strip, time, voltage, "zero", outputs=["current", "displacement"])
    )
    seen = time >= 42.0
    noise = 1e-3 * np.ptp(displacement) * np.random.default_rng(20261127).standard_normal(len(time))
    run = Run.from_arrays(
        time=time[seen] - 42.0,
        voltage=voltage[seen],
        current=current[seen],
        displacement=(displacement + noise)[seen],
        hold="zero",
    )
    fit = identify(strip, run, free="coupling.gain,relaxation")
    assert fit.observations[0].start == "free"
    slow = fit.parameters["relaxation.displacement.0.time_constant"]
    assert slow.interval[0] < strip["relaxation.displacement.0.time_constant"] < slow.interval[1]


@pytest.mark.parametrize(("sheet_resistance", "is_contradicted"), [(4.0 / 3.0, False), (1.6, True)])
def test_the_zero_of_the_sensor_is_no_current_of_the_strip(sheet_resistance: float, is_contradicted: bool) -> None:
    """60.3 mA of a strip whose electrodes allow 62.5, read with 5 mA more: they are not contradicted."""
    run = record(5e-3 + white(3e-5, 0))
    fit = identify(STRIP.replace(**{"circuit.sheet_resistance": sheet_resistance}), run, free="electrical")
    assert fit.observations[0].offset["current"] == pytest.approx(5e-3, rel=0.1)
    found = [one for one in fit.findings if one.code == "impossible-current"]
    assert bool(found) is is_contradicted
    assert all(one.values["current"] == pytest.approx(60e-3, rel=0.02) for one in found)
    assert ("in series with the branches allow" in fit.summary()) is is_contradicted
    assert any(one.name == "circuit.high_frequency_resistance" for one in fit.known) is not is_contradicted


@pytest.mark.parametrize(("seed", "fading", "size"), [(0, 0.9, 3e-5), (1, 0.97, 3e-5)])
def test_nor_is_a_zero_that_the_noise_has_beside_the_parameters(seed: int, fading: float, size: float) -> None:
    """Five rows at 0 V hold no zero: under noise that is not white it is a constant of the noise, no unknown."""
    draw, noise = white(size, seed), np.zeros(len(CLEAN))
    for row in range(1, len(noise)):
        noise[row] = fading * noise[row - 1] + draw[row]
    whole, late = record(5e-3 + noise), slice(95, None)
    assert whole.current is not None
    run = Run.from_arrays(
        time=whole.time[late] - whole.time[95],
        voltage=whole.voltage[late],
        current=whole.current[late],
        hold="zero",
        metadata=RunMetadata(starts_from_rest=True),
    )
    fit = identify(STRIP, run, free="electrical")
    assert fit.observations[0].offset["current"] == pytest.approx(5e-3, rel=0.1)
    assert any(model.terms.offset for model in fit.observations[0].noise_model.values())
    assert "impossible-current" not in [one.code for one in fit.findings]
