"""Simulation against dense matrix exponentials of the thesis's equations, which know nothing of the package."""

from __future__ import annotations

import importlib
import subprocess
import sys

import numpy as np
import pytest

from ipmclab import InputError, Run, RunMetadata, signals, simulate
from ipmclab.model import Actuator, sensitivities, simulate_outputs
from ipmclab.model.numerics import kernels, modal_loop
from ipmclab.model.numerics.modal import modes
from ipmclab.model.outputs import modal_coefficients
from tests.independent.thesis import FRIEND_2, OUTPUTS, Strip, respond
from tests.model.conftest import actuator_of

RATE = 50.0
ROWS = 2000
HOLDS = ("zero", "zero-before", "first")


def rough(rows: int = ROWS) -> np.ndarray:
    """Steps, slopes and noise at once."""
    time = np.arange(rows) / RATE
    noise = np.random.default_rng(20261121).normal(size=rows)
    return np.sin(2.0 * np.pi * 0.13 * time) + np.sign(np.sin(1.1 * time)) + 0.1 * noise + 1.0


def closed_form(actuator: Actuator) -> bool:
    ports = ("current", "node_voltage", "displacement", "force")
    return modes(actuator.blocks(), external="voltage", outputs=ports, at_rest=["external_force"]) is not None


def assert_same(run: Run, expected: dict[str, np.ndarray], *, of_peak: float = 1e-9) -> None:
    for output in OUTPUTS:
        error = np.max(np.abs(run.channels[output] - expected[output])) / np.max(np.abs(expected[output]))
        assert error <= of_peak, output


@pytest.mark.parametrize("hold", HOLDS)
def test_every_sample_of_every_strip(strip: Strip, hold: str) -> None:
    run = simulate(actuator_of(strip), rough(), duration=ROWS / RATE, rate=RATE, hold=hold)
    assert_same(run, respond(strip, rough(), RATE, hold))


@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("rate", [0.01, 0.1, 1.0, 7.3, 500.0, 20_000.0])
def test_every_sample_at_other_rates(rate: float, hold: str) -> None:
    run = simulate(actuator_of(FRIEND_2), rough(400), duration=400 / rate, rate=rate, hold=hold)
    assert_same(run, respond(FRIEND_2, rough(400), rate, hold))


def slowest_circuit_pole(strip: Strip) -> float:
    """By bisection: the current's pole between the slowest branch and 0, where the admittance meets -1/R_series."""
    resistances, capacitances = strip.branch_resistances, strip.branch_capacitances

    def gap(s: float) -> float:
        branches = np.sum(s * capacitances / (1.0 + s * resistances * capacitances))
        return float(1.0 / strip.series_resistance + 1.0 / strip.dc_resistance + branches)

    low, high = -(1.0 - 1e-12) / float(np.max(resistances * capacitances)), 0.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if gap(middle) > 0 else (middle, high)
    return 0.5 * (low + high)


@pytest.mark.parametrize("gap", [0.0, 1e-12, 1e-9, 1e-7, 1e-5, 0.9e-4, 1.1e-4, 1e-3, 1e-2])
def test_a_circuit_pole_that_meets_a_pole_of_the_coupling(gap: float) -> None:
    slow, fast = -slowest_circuit_pole(FRIEND_2) * (1.0 + gap), 12.6
    strip = FRIEND_2.changed(p1=slow + fast, p2=slow * fast)
    actuator = actuator_of(strip)
    assert closed_form(actuator) == (gap > 1e-4)
    for hold in HOLDS:
        run = simulate(actuator, rough(), duration=ROWS / RATE, rate=RATE, hold=hold)
        assert_same(run, respond(strip, rough(), RATE, hold))


@pytest.mark.parametrize("gap", [1e-12, 1e-7, 1e-5, 3e-4, 1e-2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_poles_of_the_coupling_that_nearly_meet(gap: float, sign: float) -> None:
    strip = FRIEND_2.changed(p1=16.0, p2=64.0 * (1.0 + sign * gap**2))
    run = simulate(actuator_of(strip), rough(), duration=ROWS / RATE, rate=RATE)
    assert_same(run, respond(strip, rough(), RATE, "zero"))


def test_first_simulation_of_a_process_needs_no_compiler_and_gives_the_same_digits() -> None:
    program = """
import sys, numpy as np, ipmclab
actuator = ipmclab.load_actuator("friend-2")
runs = [ipmclab.simulate(actuator, "sine 1 V 0.3 Hz", duration=10, rate=50, hold="first")]
assert "numba" not in sys.modules and "scipy" not in sys.modules
runs.append(ipmclab.simulate(actuator, "sine 1 V 0.3 Hz", duration=10, rate=50, hold="first"))
assert "numba" in sys.modules
assert runs[0].content_sha256 == runs[1].content_sha256
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=300)


def test_a_thread_simulates_while_another_is_loading_the_compiler() -> None:
    program = """
import importlib, sys, threading, ipmclab
actuator = ipmclab.load_actuator("friend-2")
kernels = "ipmclab.model.numerics.kernels"
loading = threading.Thread(target=importlib.import_module, args=(kernels,))
loading.start()
while kernels not in sys.modules:
    pass
run = ipmclab.simulate(actuator, "step 1 V", duration=10, rate=50)
loading.join()
assert run.content_sha256 == ipmclab.simulate(actuator, "step 1 V", duration=10, rate=50).content_sha256
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=300)


@pytest.mark.parametrize("frequency", [0.02, 0.4, 3.0])
def test_settled_sine_is_the_frequency_response(friend_2: Actuator, frequency: float) -> None:
    # 400 rows a period: a straight line misses the sine by (2 pi/400)^2/12 of its amplitude.
    rate, periods = 400 * frequency, max(3, int(120 * frequency))
    run = simulate(friend_2, f"sine 1 V {frequency} Hz", duration=periods / frequency, rate=rate, hold="first")
    response = friend_2.frequency_response([frequency])[:, 0]
    last = np.exp(-2j * np.pi * frequency * run.time[-400:])
    for output, expected in zip(OUTPUTS, response, strict=True):
        # A sine is the imaginary part of exp(j w t): its phasor is -j times the response.
        phasor = 2.0 * np.mean(run.channels[output][-400:] * last)
        assert phasor == pytest.approx(-1j * expected, abs=1e-3 * abs(expected))


def test_displacement_does_not_depend_on_how_charge_is_spread() -> None:
    # Friend, eq. 4.7 with eq. 4.8 from the branch current, left uncollapsed, in complex numbers.
    strip = FRIEND_2
    s = 2j * np.pi * np.array([0.001, 0.05, 0.7, 11.0, 60.0])
    rho, eps = np.array(strip.resistivities), np.array(strip.permittivities)
    branch_current = sum(
        s * c / (1 + s * r * c) for r, c in zip(strip.branch_resistances, strip.branch_capacitances, strict=True)
    )
    node = 1.0 / (1.0 + strip.series_resistance * (1.0 / strip.dc_resistance + branch_current))
    eta = np.sum(eps / (1 + s[:, None] * eps * rho), axis=1)
    d = strip.gain * (s + strip.zero) / (s**2 + strip.p1 * s + strip.p2)
    w = strip.natural_frequency
    beam = 1.0 / (1.0 + 2.0 * strip.damping_ratio * s / w + (s / w) ** 2)
    volume = strip.total_length * strip.width * strip.thickness
    displacement = branch_current * node / s * 3.0 * d * strip.sensing_length**2 / (eta * volume) * beam
    response = actuator_of(strip).frequency_response(s.imag / (2 * np.pi), ["displacement"])
    np.testing.assert_allclose(response[0], displacement, rtol=1e-12)


def test_rows_and_metadata(friend_2: Actuator) -> None:
    run = simulate(friend_2, "step 1 V", duration=40, rate=50)
    np.testing.assert_array_equal(run.time, np.arange(2000) / 50)
    np.testing.assert_array_equal(run.voltage, np.ones(2000))
    assert (run.hold, run.metadata.origin, run.metadata.signal) == ("zero", "simulated", "step 1 V")
    assert run.metadata.starts_from_rest
    assert run.metadata.parameters["beam.modulus"] == 1.45e9
    started = simulate(friend_2, [0.0] * 50, duration=1, rate=50, initial_state={"circuit.branches.0.voltage": 0.5})
    assert not started.metadata.starts_from_rest


def test_a_run_is_simulated_at_its_own_rows(friend_2: Actuator) -> None:
    # Rows that are a subset of a regular grid, the voltage changing at rows only.
    whole = simulate(friend_2, rough(600), duration=12, rate=RATE)
    kept = np.sort(np.random.default_rng(20261121).choice(600, size=200, replace=False))
    kept[0] = 0
    held = rough(600)[kept[np.searchsorted(kept, np.arange(600), side="right") - 1]]
    whole = simulate(friend_2, held, duration=12, rate=RATE)
    record = Run.from_arrays(time=3.0 + kept / RATE, voltage=held[kept])
    run = simulate(friend_2, record)
    np.testing.assert_array_equal(run.time, record.time)
    assert_same(run, {output: whole.channels[output][kept] for output in OUTPUTS}, of_peak=1e-12)


def test_a_shunt_upstream_of_which_the_voltage_was_sensed_stands_in_series(friend_2: Actuator) -> None:
    sensed = RunMetadata(voltage_sensed="upstream of shunt", shunt_resistance=1.0)
    record = Run.from_arrays(time=np.arange(500) / RATE, voltage=rough(500), metadata=sensed)
    expected = respond(FRIEND_2.changed(contact_resistance=1.0), rough(500), RATE, "zero")
    run = simulate(friend_2, record)
    assert_same(run, expected)
    assert run.metadata.shunt_resistance == 1.0
    unknown = Run.from_arrays(
        time=record.time, voltage=record.voltage, metadata=RunMetadata(voltage_sensed="upstream of shunt")
    )
    with pytest.raises(InputError, match="upstream of a shunt whose resistance is not given"):
        simulate(friend_2, unknown)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"duration": None}, "duration: the duration is None, it must be a number above 0; give it in s, such as 40"),
        ({"duration": -1.0}, "the duration is -1.0, it must be a number above 0"),
        ({"rate": 0}, "rate: the rate is 0, it must be a number above 0; give it in Hz"),
        ({"rate": "50 mm"}, "rate: '50 mm' is not a frequency"),
        ({"rate": float("nan")}, "the rate is nan"),
        ({"duration": 1e9}, "1e+09 s at 50 Hz are 50000000000 rows, allowed are 2 to 20000000"),
        ({"duration": 0.02}, "0.02 s at 50 Hz are 1 rows"),
        ({"hold": "zero_before"}, "hold: unknown hold 'zero_before'; did you mean 'zero-before'?"),
        ({"hold": "unknown"}, "does not say what its voltage did between rows; choose one of zero, zero-before, first"),
        ({"signal": np.ones(9)}, "voltage: the array has shape (9,), there are 10 rows"),
        ({"signal": np.ones((10, 1))}, "the array has shape (10, 1), there are 10 rows"),
        ({"signal": [1.0] * 9 + [np.nan]}, "voltage: row 9 is nan; every row needs the voltage that was applied"),
        ({"signal": np.ma.array(range(10), mask=[0] * 7 + [1] * 3)}, "voltage: row 7 is nan"),
        ({"signal": [1.0] * 9 + [-np.inf]}, "voltage: row 9 is -inf"),
        ({"signal": ["one"] * 10}, "signal: this is a list, not a run, a signal, a text or an array of numbers"),
        (
            {"signal": signals.Samples(time=[0.0, 3.0], voltage=[1.0, 1.0])},
            "it reaches to 3 s, the record to 0.2 s; record longer, or shorten the signal",
        ),
        ({"initial_state": {"beam.velocity": "fast"}}, "0.0, 0.0, 'fast'] is not one finite value"),
        ({"initial_state": [1.0, 2.0]}, "initial_state: [1.0, 2.0] is not one finite value for each of circuit"),
        (
            {"initial_state": {"beam.displacment": 1.0}},
            "initial_state: unknown state 'beam.displacment'; did you mean 'beam.displacement'?",
        ),
    ],
)
def test_bad_input_is_named(friend_2: Actuator, changes: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"signal": np.ones(10), "duration": 0.2, "rate": 50.0} | changes
    with pytest.raises(InputError) as caught:
        simulate(friend_2, arguments.pop("signal"), **arguments)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    "signal", ["step 1e30 V", "cosine 1e30 V 0.1 Hz", [0.0, -1e30, 0.0, 0.0], "step 1 V for 2 s then step 1e6 V"]
)
def test_a_voltage_that_no_strip_can_be_under_is_refused(friend_2: Actuator, signal: object) -> None:
    with pytest.raises(InputError, match=r"row \d+ is .* V, a strip can be under 100000 V at most"):
        simulate(friend_2, signal, duration=4.0, rate=1.0)
    strip = friend_2.simulator(rate=50.0)
    with pytest.raises(InputError, match="at most"):
        strip.step(1e30)


@pytest.mark.parametrize("first_time", [True, False])
@pytest.mark.parametrize("voltage", [1e308, 1e305])
def test_outputs_beyond_floating_point_are_no_run(
    friend_2: Actuator, voltage: float, first_time: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = importlib.import_module("ipmclab.model.outputs")
    monkeypatch.setattr("ipmclab.model.request.MOST_VOLTS", np.inf)  # which refuses them before
    monkeypatch.setattr(module, "_modal_loop", lambda _rows: modal_loop.modal if first_time else kernels.modal)
    with pytest.raises(InputError, match=r"of the simulated .* is .*; these numbers are beyond floating point"):
        simulate(friend_2, f"step {voltage} V", duration=1e6, rate=0.01)
    with pytest.raises(InputError, match="beyond floating point"):
        simulate(friend_2, np.ones(9), duration=9e306, rate=1e-306, hold="first")


@pytest.mark.parametrize("rows", [2, modal_loop.BLOCK, modal_loop.BLOCK + 1, 3 * modal_loop.BLOCK - 1])
def test_the_plain_loop_has_the_digits_of_the_compiled_one(friend_2: Actuator, rows: int) -> None:
    voltage = np.random.default_rng(20261121).normal(size=rows)
    numbers = modal_coefficients(friend_2, 0.02, "first")
    assert numbers is not None
    plain, compiled = np.empty((4, rows)), np.empty((4, rows))
    modal_loop.modal(voltage, numbers, plain)
    kernels.modal(voltage, numbers, compiled)
    np.testing.assert_array_equal(plain, compiled)


@pytest.mark.parametrize("times", [[0.0, 2.0, 1.0], [0.0, np.nan, 1.0], [0.0, 0.0, 1.0], [0.0]])
def test_outputs_at_times_that_do_not_increase_are_refused(friend_2: Actuator, times: list[float]) -> None:
    for call in (
        lambda: simulate_outputs(friend_2, times, np.ones(len(times)), "zero"),
        lambda: sensitivities(friend_2, [], times, np.ones(len(times)), "zero"),
    ):
        with pytest.raises(InputError, match="time: "):
            call()


def test_a_run_takes_no_rate(friend_2: Actuator) -> None:
    record = Run.from_arrays(time=[0.0, 1.0], voltage=[1.0, 1.0])
    with pytest.raises(InputError, match="rate: a run has its own times, the rate 50 cannot be used; leave it out"):
        simulate(friend_2, record, rate=50)
    with pytest.raises(InputError, match="does not say what its voltage did between rows"):
        simulate(friend_2, Run.from_arrays(time=[0.0, 1.0], voltage=[1.0, 1.0], hold="unknown"))
