"""A current under waves, of a strip that no number of branches describes: followed as plain least squares follows it.

A wave has no edge, so that its rows at 0 V were not looked at; one without such rows shows the zero of the current by
itself; and what a pole search does without that zero leads elsewhere.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal

from benchmarks.wrong_model import Compared, circuit_current, compared_wave, spread_circuit, waved
from ipmclab import Run, check, identify, load_actuator, simulate
from ipmclab.model.variants import with_stages
from ipmclab.quality.rows_at_rest import rest_rows

STRIP = load_actuator("friend-2")
ZERO = "observation.offset.current[0]"


def measured(signal: str, *, zero: float, seed: int = 1, rate: float = 25.0) -> Run:
    """A record of friend-2 over 40 s with 0.05 mA of noise, and a zero [A] that its amplifier adds."""
    clean = simulate(STRIP, signal, duration=40.0, rate=rate)
    noise = 5e-5 * np.random.default_rng([20261128, seed]).standard_normal(len(clean))
    assert clean.current is not None
    return Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + zero + noise, hold="zero")


def codes(run: Run) -> set[str]:
    return {finding.code for finding in check(run)}


@pytest.mark.parametrize(("number", "branches"), [(0, 2), (0, 3), (10, 2), (10, 3)])
def test_no_record_is_followed_worse_than_by_plain_least_squares(number: int, branches: int) -> None:
    may_have_zero, run = waved(number)
    assert compared_wave(run, branches, may_have_zero=may_have_zero).ratio < 1.02


def of_a_spread_circuit(
    circuit: tuple[float, ...], shape: np.ndarray, rest: float, noise: float, zero: float, seed: int = 0
) -> Run:
    """Readings at 20 S/s of a circuit of all time constants, after a rest [s]; noise and zero as parts of the range."""
    voltage = np.concatenate([np.zeros(round(20.0 * rest)), shape])
    current = circuit_current(spread_circuit(*circuit), voltage, 0.05)
    added = zero + noise * np.random.default_rng([20261128, seed]).standard_normal(len(voltage))
    readings = current + added * np.ptp(current)
    return Run.from_arrays(time=np.arange(len(voltage)) / 20.0, voltage=voltage, current=readings, hold="zero")


def compared(run: Run, branches: int, *, zero: bool = False) -> Compared:
    return compared_wave(run, branches, may_have_zero=zero)


def test_a_search_for_poles_that_flees_is_followed_by_another() -> None:
    """The best start of the grid ends in a pole that jumps, and leaves twice as much as the next one."""
    shape = 2.07 * np.sign(np.sin(2.0 * np.pi * 0.1218 * np.arange(1101) / 20.0 + 1e-9))
    run = of_a_spread_circuit((9.905, 4842.0, 0.6, 0.00228), shape, 5.0, 1e-4, 0.0)
    assert compared(run, 3).ratio < 1.1


@pytest.mark.parametrize(("wave", "branches", "seed"), [("triangle", 2, 6), ("triangle", 2, 9), ("step", 3, 9)])
def test_what_a_model_lacks_is_no_drift_of_a_current(wave: str, branches: int, seed: int) -> None:
    """A second at 0 V shows no slope; what is left beside one is not white, and the prediction is worse for it."""
    time = np.arange(381) / 20.0
    if wave == "triangle":
        rising = scipy.signal.sawtooth(2.0 * np.pi * 0.03238 * time + 0.5 * np.pi, 0.5)
        run = of_a_spread_circuit((57.11, 2827.0, 0.8836, 0.005528), 1.935 * rising, 1.0, 1e-3, 0.0, seed)
    else:
        run = of_a_spread_circuit((15.42, 694.2, 0.833, 0.005556), np.full(381, 2.291), 1.0, 1e-4, 0.02, seed)
    assert compared(run, branches, zero=wave == "step").ratio < 1.02


@pytest.mark.parametrize("signal", ["sine 1 V 0.2 Hz delay=2 s", "triangle 1 V 0.1 Hz delay=2 s", "step 1 V delay=2 s"])
def test_rows_before_any_voltage_show_the_zero(signal: str) -> None:
    run = measured(signal, zero=1e-3)
    (finding,) = [one for one in check(run) if one.code == "offset-before-step"]
    assert finding.values["offset"] == pytest.approx(1e-3, abs=4.0 * 5e-5 / np.sqrt(45))
    assert rest_rows(run) in (50, 51)
    assert "offset-before-step" not in codes(measured(signal, zero=0.0))


@pytest.mark.parametrize(
    "signal", ["sine 1 V 0.2 Hz", "triangle 1 V 0.02 Hz", "sine 1 V 0.001 Hz", "triangle 1 V 0.005 Hz"]
)
def test_a_wave_that_begins_at_once_has_no_rows_at_rest(signal: str) -> None:
    assert not codes(measured(signal, zero=1e-3, rate=500.0)) & {"offset-before-step", "drift-before-step"}


@pytest.mark.parametrize("signal", ["sine 1 V 0.2 Hz", "square 1 V 0.1 Hz"])
def test_a_wave_without_rest_shows_a_zero_by_itself(signal: str) -> None:
    with_zero, without = (identify(STRIP, measured(signal, zero=zero), free="electrical") for zero in (5e-3, 0.0))
    found = with_zero.parameters[ZERO]
    assert abs(found.value - 5e-3) < 4.0 * found.standard_error < 1e-4
    assert ZERO not in without.parameters
    assert "start-not-at-rest" not in {finding.code for finding in with_zero.findings}
    names = [name for name in with_zero.parameters if name.startswith("circuit.")]
    inside = [low <= STRIP[name] <= high for name in names for low, high in [with_zero.parameters[name].interval]]
    assert sum(inside) >= 4  # of five, at 95 %


@pytest.mark.parametrize("follows", [0.0, 0.9])
@pytest.mark.parametrize("signal", ["sine 1 V 0.2 Hz", "square 1 V 0.1 Hz", "step 1 V delay=1.85 s"])
def test_a_drift_is_no_zero(signal: str, follows: float) -> None:
    """Of a right model: the noise has the drift, and nothing is said of a zero, or of a start that was not at rest."""
    clean = simulate(STRIP, signal, duration=40.0, rate=20.0)
    assert clean.current is not None
    drawn = np.random.default_rng(20261128).standard_normal(len(clean) + 200)
    noise = 2e-4 * np.sqrt(1.0 - follows**2) * scipy.signal.lfilter([1.0], [1.0, -follows], drawn)[200:]
    current = clean.current + 5e-5 * clean.time + noise
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=current, hold="zero")
    fit = identify(STRIP, run, free="electrical")
    assert not {finding.code for finding in fit.findings} & {"sensor-zero", "start-not-at-rest"}
    inside = [low <= STRIP[name] <= high for name, one in fit.parameters.items() for low, high in [one.interval]]
    assert sum(inside) >= 4  # of five


def test_a_relaxation_that_a_model_lacks_is_no_state_at_the_start() -> None:
    """It decays as one does; a fit that takes it for one predicts the same wave from rest 20 times worse."""
    more = {"circuit.branches.2.resistivity": 30.0, "circuit.branches.2.permittivity": 0.02}
    slow = {"relaxation.displacement.0.ratio": 0.5, "relaxation.displacement.0.time_constant": 5.0}
    strip = with_stages(STRIP, "branches=3", "relaxation.displacement=1").replace(**more, **slow)
    clean = simulate(strip, "sine 1 V 0.1 Hz", duration=20.0, rate=20.0)
    generator = np.random.default_rng(20261129)
    read = {}
    for output in ("current", "displacement"):
        true = getattr(clean, output)
        read[output] = true + 1e-4 * np.ptp(true) * generator.standard_normal(len(true))
    run = Run.from_arrays(time=clean.time, voltage=clean.voltage, hold="zero", **read)
    fit = identify(STRIP, run, free="electrical,circuit.sheet_resistance,coupling")
    assert "start-not-at-rest" not in {finding.code for finding in fit.findings}
    predicted = simulate(fit.actuator, "sine 1 V 0.1 Hz", duration=20.0, rate=20.0)
    for output in read:
        true = getattr(clean, output)
        assert float(np.sqrt(np.mean((getattr(predicted, output) - true) ** 2))) < 2e-3 * np.ptp(true)


def test_rows_of_a_voltage_that_flickers_are_at_rest() -> None:
    """One code of a converter up, now and then; and a wave that begins at once, read with noise, is not."""
    voltage = np.concatenate([np.zeros(500), np.ones(500)])
    voltage[[3, 160, 420]] = 4.88e-3
    time = np.arange(1000) / 50.0
    assert rest_rows(Run.from_arrays(time=time, voltage=voltage)) == 500
    noise = 5e-3 * np.random.default_rng(20261128).standard_normal((10, 20_000))
    times = np.arange(20_000) / 1000.0
    for one in noise:
        wave = Run.from_arrays(time=times, voltage=np.sin(2.0 * np.pi * 0.05 * times) + one)
        assert rest_rows(wave) == 0


def test_a_step_without_rest_does_not() -> None:
    """There a zero looks like the dc path."""
    assert ZERO not in identify(STRIP, measured("step 1 V", zero=2e-3), free="electrical").parameters
