"""Derivatives of the outputs, against central differences of the thesis's equations done the long way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ipmclab
from ipmclab.model.outputs import simulate_outputs
from ipmclab.model.sensitivity import sensitivities
from tests.independent.thesis import FRIEND_2, OUTPUTS, Strip, respond, respond_between_rows

RATE, ROWS = 50.0, 150
FIELDS = {
    "circuit.dc_resistivity": "dc_resistance",
    "circuit.sheet_resistance": "electrode_resistance",
    "coupling.gain": "gain",
    "coupling.zero": "zero",
    "coupling.p1": "p1",
    "coupling.p2": "p2",
    "beam.modulus": "modulus",
    "beam.density": "density",
    "beam.damping_ratio": "damping_ratio",
    "geometry.sensing_length": "sensing_length",
}


def load(strip: Strip, folder: Path) -> ipmclab.Actuator:
    path = folder / "strip.toml"
    path.write_text(strip.toml(), encoding="utf-8")
    return ipmclab.load_actuator(path)


@pytest.mark.parametrize("hold", ["zero", "zero-before", "first"])
@pytest.mark.parametrize("strip", [FRIEND_2, FRIEND_2.changed(p1=8.0, p2=16.0)], ids=["real poles", "equal poles"])
def test_by_parameters(strip: Strip, hold: str, tmp_path: Path) -> None:
    time = np.arange(ROWS) / RATE
    voltage = np.sin(9.0 * time) + (time > 1.0)
    voltage[0] = 0.0
    found = sensitivities(load(strip, tmp_path), list(FIELDS), time, voltage, hold, outputs=OUTPUTS)
    assert found.values.shape == (4, ROWS)
    assert found.parameters.shape == (4, ROWS, len(FIELDS))
    for index, field in enumerate(FIELDS.values()):
        step = 1e-6
        value = getattr(strip, field)
        up = respond(strip.changed(**{field: value * (1 + step)}), voltage, RATE, hold)
        down = respond(strip.changed(**{field: value * (1 - step)}), voltage, RATE, hold)
        for row, output in enumerate(OUTPUTS):
            # By the logarithm of the parameter: the same in both spellings of R_e and R_dc.
            expected = (up[output] - down[output]) / (2 * step)
            parameter = load(strip, tmp_path).parameters()[list(FIELDS)[index]].value
            ours = found.parameters[row, :, index] * parameter
            # Each row of the recursion adds one rounding of the output to what the difference divides by its step:
            # at most 150 * 2.2e-16 / 1e-6 = 3.3e-8 of the output. The kernels of four processors show 1.0e-8.
            rounding = ROWS * np.finfo(float).eps / step
            allowed = 1e-5 * np.max(np.abs(expected)) + rounding * np.max(np.abs(found.values[row]))
            assert np.max(np.abs(ours - expected)) < allowed, (field, output)


@pytest.mark.parametrize("delay", [0.3, -0.3])
def test_by_the_delay_and_with_one(delay: float, tmp_path: Path) -> None:
    time = np.arange(ROWS) / RATE
    voltage = np.where((time > 0.5) & (time < 1.7), 1.0, 0.0)
    actuator = load(FRIEND_2, tmp_path)
    seconds = delay / RATE
    found = sensitivities(actuator, [], time, voltage, "zero", outputs=OUTPUTS, delay=seconds)
    step = 1e-3 / RATE
    for row, output in enumerate(OUTPUTS):
        exact = respond_between_rows(FRIEND_2, voltage, time, seconds, output)
        np.testing.assert_allclose(found.values[row], exact, rtol=0, atol=1e-9 * np.max(np.abs(exact)))
        slope = (
            respond_between_rows(FRIEND_2, voltage, time, seconds + step, output)
            - respond_between_rows(FRIEND_2, voltage, time, seconds - step, output)
        ) / (2 * step)
        assert np.max(np.abs(found.delay[row] - slope)) < 1e-4 * np.max(np.abs(slope)), output


def test_by_the_initial_state(tmp_path: Path) -> None:
    time = np.arange(ROWS) / RATE
    voltage = np.cos(3.0 * time)
    actuator = load(FRIEND_2, tmp_path)
    states = np.zeros(len(actuator.state_names))
    found = sensitivities(actuator, [], time, voltage, "zero", outputs=OUTPUTS, initial_state=np.zeros_like(states))
    assert found.states.shape == (4, ROWS, len(states))
    still = simulate_outputs(actuator, time, voltage, "zero", outputs=OUTPUTS, initial_state=np.zeros_like(states))
    for index in range(len(states)):
        moved = np.zeros_like(states)
        moved[index] = 1.0
        # Linear: the difference is the derivative.
        change = simulate_outputs(actuator, time, voltage, "zero", outputs=OUTPUTS, initial_state=moved) - still
        assert np.max(np.abs(found.states[:, :, index] - change)) < 1e-9 * max(np.max(np.abs(change)), 1e-12)


def test_charged_branches_discharge_as_the_circuit_says(tmp_path: Path) -> None:
    # Both branches charged to 1 V, nothing applied: the current flows back, as the dense circuit has it.
    from scipy.linalg import expm

    from tests.independent.thesis import circuit

    a, _, c, _ = circuit(FRIEND_2)
    actuator = load(FRIEND_2, tmp_path)
    time = np.arange(ROWS) / RATE
    expected = np.array([c[0] @ expm(a * t) @ np.ones(2) for t in time])
    # After a long 1 V every capacitor holds the node's share of it; then the voltage goes away.
    share = FRIEND_2.dc_resistance / (FRIEND_2.dc_resistance + FRIEND_2.series_resistance)
    rest = actuator.simulator(rate=1.0, hold="zero")
    rest.block(np.ones(2000))
    run = ipmclab.simulate(actuator, np.zeros(ROWS), duration=ROWS / RATE, rate=RATE, initial_state=rest.state)
    assert run.current is not None
    np.testing.assert_allclose(run.current, share * expected, rtol=0, atol=1e-9 * np.max(np.abs(expected)))
