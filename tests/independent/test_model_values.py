"""Outputs of friend-2 against published reference values and against the thesis's equations done the long way."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest

import ipmclab
from tests.independent.thesis import FRIEND_2, OUTPUTS, Strip, respond, state_space

RATE = 50.0


@pytest.fixture(scope="module")
def step() -> ipmclab.Run:
    return ipmclab.simulate(ipmclab.load_actuator("friend-2"), "step 1 V", duration=60.0, rate=RATE)


@pytest.mark.parametrize(
    ("time", "current", "force", "displacement"),
    [
        (0.0, 6.0348029019e-2, 0.0, 0.0),
        (1.0, 3.3778665796e-2, 7.5582026187e-4, 2.6250404485e-4),
        (5.0, 2.1655390462e-2, 1.4315884233e-3, 4.9738925573e-4),
        (40.0, 1.2600925334e-2, 1.7604920245e-3, 6.1166752099e-4),
    ],
)
def test_reference_values_of_the_one_volt_step(
    step: ipmclab.Run, time: float, current: float, force: float, displacement: float
) -> None:
    # Eleven digits, from an exact computation by six independent programs.
    row = round(time * RATE)
    assert step.current is not None
    assert step.force is not None
    assert step.displacement is not None
    assert step.current[row] == pytest.approx(current, rel=1e-10)
    assert step.force[row] == pytest.approx(force, rel=1e-10, abs=1e-17)
    assert step.displacement[row] == pytest.approx(displacement, rel=1e-10, abs=1e-17)


def test_step_values_known_to_an_outsider(step: ipmclab.Run) -> None:
    def at(values: np.ndarray | None, time: float) -> float:
        assert values is not None
        return float(values[round(time * RATE)])

    current = ((0.0, 60.348), (0.1, 55.906), (1.0, 33.779), (5.0, 21.655), (10.0, 18.862), (30.0, 13.572))
    for time, milliampere in current:
        assert at(step.current, time) == pytest.approx(milliampere * 1e-3, rel=1e-3)
    force = ((0.1, 0.0188), (1.0, 0.7558), (2.0, 1.1972), (5.0, 1.4316), (10.0, 1.5340), (30.0, 1.7253))
    for time, millinewton in force:
        assert at(step.force, time) == pytest.approx(millinewton * 1e-3, rel=3e-3 if time == 0.1 else 1e-3)
    for time, millimetre in ((1.0, 0.2626), (5.0, 0.4974), (10.0, 0.5330)):
        assert at(step.displacement, time) == pytest.approx(millimetre * 1e-3, rel=1e-3)
    # Quasi-static stiffness Y w h^3/(4 L_s^3), eq. 4.11.
    assert at(step.force, 60.0 - 1 / RATE) / at(step.displacement, 60.0 - 1 / RATE) == pytest.approx(2.8782, rel=1e-3)


def test_steady_values_from_the_frequency_response_at_dc() -> None:
    actuator = ipmclab.load_actuator("friend-2")
    long = ipmclab.simulate(actuator, "step 1 V", duration=400.0, rate=5.0)
    for name, value in (("current", 11.505e-3), ("force", 1.8001e-3), ("displacement", 0.6254e-3)):
        assert getattr(long, name)[-1] == pytest.approx(value, rel=1e-3)


@pytest.mark.parametrize(
    ("frequency", "current", "force", "displacement"),
    [(0.1, 34.955e-3, 1.1866e-3, 0.4123e-3), (1.0, 59.289e-3, 0.1176e-3, 0.0409e-3)],
)
def test_amplitudes_of_the_one_volt_sine(frequency: float, current: float, force: float, displacement: float) -> None:
    actuator = ipmclab.load_actuator("friend-2")
    expected = {"current": current, "force": force, "displacement": displacement}
    # In the time domain, the last whole period after 120 s, with straight lines between fine rows.
    rate = 200.0
    run = ipmclab.simulate(actuator, f"sine 1 V {frequency} Hz", duration=120.0, rate=rate, hold="first")
    period = round(rate / frequency)
    for name, amplitude in expected.items():
        last = getattr(run, name)[-period:]
        phasor = 2.0 * np.mean(last * np.exp(-2j * np.pi * frequency * run.time[-period:]))
        assert abs(phasor) == pytest.approx(amplitude, rel=2e-3)
        if name == "displacement" and frequency == 0.1:
            assert np.angle(1j * phasor, deg=True) == pytest.approx(-39.4, abs=0.3)


@pytest.mark.parametrize("frequency", [0.001, 0.1, 1.0, 10.0, 38.29, 200.0])
def test_frequency_response_against_the_dense_state_space(frequency: float) -> None:
    a, b, c, d = state_space(FRIEND_2)
    s = 2j * np.pi * frequency
    expected = (c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d)[:, 0]
    actuator = ipmclab.load_actuator("friend-2")
    response = np.asarray(actuator.frequency_response(np.array([frequency])))
    assert response.shape == (len(OUTPUTS), 1)
    np.testing.assert_allclose(response[:, 0], expected, rtol=1e-8)


def test_first_mode_is_at_38_hz() -> None:
    # The undamped resonance: displacement lags force by 90 degrees there.
    assert FRIEND_2.natural_frequency / (2 * np.pi) == pytest.approx(38.29, rel=1e-3)
    actuator = ipmclab.load_actuator("friend-2")
    response = np.asarray(actuator.frequency_response(np.array([38.2896])))
    ratio = response[OUTPUTS.index("displacement"), 0] / response[OUTPUTS.index("force"), 0]
    assert np.angle(ratio, deg=True) == pytest.approx(-90.0, abs=0.1)


def three_branches() -> Strip:
    return FRIEND_2.changed(resistivities=(0.35734, 5.1, 24.2415), permittivities=(0.11998, 0.21, 0.48106))


STRIPS: dict[str, Strip] = {
    "two branches, real poles": FRIEND_2,
    "three branches, real poles": three_branches(),
    "one branch": FRIEND_2.changed(resistivities=(0.35734,), permittivities=(0.11998,)),
    "two branches, equal poles": FRIEND_2.changed(p1=8.0, p2=16.0),
    "three branches, equal poles": three_branches().changed(p1=8.0, p2=16.0),
    "nearly equal poles": FRIEND_2.changed(p1=8.0, p2=16.0 * (1 - 1e-9)),
    "two branches, complex poles": FRIEND_2.changed(p1=3.0, p2=41.097),
    "three branches, complex poles": three_branches().changed(p1=3.0, p2=41.097),
    # -1.3298959 and -0.0634659 are poles of the circuit: d(s) has one of them too.
    "a pole of d on a pole of the circuit": FRIEND_2.changed(p1=1.3298959260512 + 12.6, p2=1.3298959260512 * 12.6),
    "a pole of d near a pole of the circuit": FRIEND_2.changed(p1=1.32990 + 12.6, p2=1.32990 * 12.6),
    "equal branches": FRIEND_2.changed(resistivities=(5.0, 5.0), permittivities=(0.2, 0.2)),
    "a contact resistance": FRIEND_2.changed(contact_resistance=1.0),
    "an overdamped beam": FRIEND_2.changed(damping_ratio=1.0),
}


@pytest.mark.parametrize("hold", ["zero", "zero-before", "first"])
@pytest.mark.parametrize("case", STRIPS)
def test_every_sample_against_dense_matrix_exponentials(case: str, hold: str, tmp_path) -> None:
    strip = STRIPS[case]
    path = tmp_path / "strip.toml"
    path.write_text(strip.toml(), encoding="utf-8")
    actuator = ipmclab.load_actuator(path)
    time = np.arange(2000) / RATE
    signals = {"step": (time >= 0.02).astype(float), "rough": np.sin(7.1 * time) + np.sign(np.sin(1.3 * time))}
    for name, voltage in signals.items():
        voltage = voltage.copy()
        voltage[0] = 0.0  # before row 0 the strip rests, whichever way the hold is read
        expected = respond(strip, voltage, RATE, hold)
        run = ipmclab.simulate(actuator, voltage, duration=40.0, rate=RATE, hold=hold)
        assert run.hold == hold
        for output in OUTPUTS:
            error = np.max(np.abs(getattr(run, output) - expected[output])) / np.max(np.abs(expected[output]))
            assert error < 1e-9, f"{case}, {hold}, {name}: {output} is off by {error:.2e} of its peak"


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_step_from_row_zero(hold: str) -> None:
    expected = respond(FRIEND_2, np.ones(2000), RATE, hold)
    run = ipmclab.simulate(ipmclab.load_actuator("friend-2"), "step 1 V", duration=40.0, rate=RATE, hold=hold)
    assert len(run) == 2000
    np.testing.assert_array_equal(run.time, np.arange(2000) / RATE)
    for output in OUTPUTS:
        np.testing.assert_allclose(
            getattr(run, output), expected[output], rtol=0, atol=1e-9 * np.max(np.abs(expected[output]))
        )


@pytest.mark.parametrize("hold", ["zero", "zero-before", "first"])
@pytest.mark.parametrize("case", ["two branches, real poles", "two branches, equal poles"])
def test_blocks_joined_equal_one_call(case: str, hold: str, tmp_path) -> None:
    path = tmp_path / "strip.toml"
    path.write_text(STRIPS[case].toml(), encoding="utf-8")
    actuator = ipmclab.load_actuator(path)
    voltage = np.random.default_rng(20261121).normal(size=300)
    voltage[0] = 0.0
    whole = ipmclab.simulate(actuator, voltage, duration=6.0, rate=RATE, hold=hold)
    simulator = actuator.simulator(rate=RATE, hold=hold)
    blocks = [simulator.block(part) for part in (voltage[:1], voltage[1:120], voltage[120:])]
    joined = np.concatenate([np.asarray(block) for block in blocks], axis=-1)
    stepper = actuator.simulator(rate=RATE, hold=hold)
    stepped = np.stack([np.asarray(stepper.step(float(v))) for v in voltage], axis=-1)
    for index, output in enumerate(OUTPUTS):
        values = getattr(whole, output)
        peak = np.max(np.abs(values))
        np.testing.assert_allclose(joined[index], values, rtol=0, atol=1e-12 * peak)
        np.testing.assert_allclose(stepped[index], values, rtol=0, atol=1e-12 * peak)


def test_exports_give_the_same_system(require: Callable[[str, object], None]) -> None:
    a, b, c, d = state_space(FRIEND_2)
    frequencies = np.array([0.01, 0.5, 20.0])
    s = 2j * np.pi * frequencies
    expected = np.array([(c @ np.linalg.solve(x * np.eye(len(a)) - a, b) + d)[:, 0] for x in s]).T
    actuator = ipmclab.load_actuator("friend-2")
    system = actuator.to_scipy()
    exported = np.array(
        [(system.C @ np.linalg.solve(x * np.eye(len(system.A)) - system.A, system.B) + system.D)[:, 0] for x in s]
    ).T
    np.testing.assert_allclose(exported, expected, rtol=1e-9)
    pytest.importorskip("control")
    np.testing.assert_allclose(np.squeeze(actuator.to_control()(s)), expected, rtol=1e-9)


def test_the_first_call_of_a_process_gives_the_same_digits() -> None:
    # Before the compiled loop is loaded, a short record may be computed by other means: not with other digits.
    code = (
        "import ipmclab, numpy as np\n"
        "actuator = ipmclab.load_actuator('friend-2')\n"
        "signal = 'random 1 V 0.1 s'\n"
        "runs = [ipmclab.simulate(actuator, signal, duration=20, rate=50, hold='first') for _ in range(3)]\n"
        "for name in ('current', 'applied_voltage', 'displacement', 'force'):\n"
        "    for run in runs[1:]:\n"
        "        np.testing.assert_array_equal(getattr(run, name), getattr(runs[0], name))\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=300)
