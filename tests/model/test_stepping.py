"""Stepping: blocks joined are one call, and the state has a meaning."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import InputError, load_actuator, simulate
from ipmclab.model import Actuator
from tests.independent.thesis import OUTPUTS
from tests.profiles import costly

RATE = 50.0
VOLTAGE = np.random.default_rng(20261121).normal(size=400) + 1.0


@pytest.mark.parametrize("hold", ["zero", "zero-before", "first"])
@costly()
@given(cuts=st.lists(st.integers(0, len(VOLTAGE)), max_size=6))
def test_blocks_joined_equal_one_call(hold: str, cuts: list[int]) -> None:
    actuator = load_actuator("friend-2")
    run = simulate(actuator, VOLTAGE, duration=len(VOLTAGE) / RATE, rate=RATE, hold=hold)
    whole = np.array([run.channels[output] for output in OUTPUTS])
    simulator = actuator.simulator(RATE, hold)
    blocks = np.hstack([simulator.block(part) for part in np.split(VOLTAGE, sorted(cuts))])
    assert np.all(np.abs(blocks - whole) <= 1e-12 * np.max(np.abs(whole), axis=1, keepdims=True))


@pytest.mark.parametrize("hold", ["zero", "zero-before", "first"])
def test_steps_equal_blocks(hold: str, friend_2: Actuator) -> None:
    one, other = friend_2.simulator(RATE, hold), friend_2.simulator(RATE, hold)
    steps = np.array([one.step(voltage) for voltage in VOLTAGE[:50]]).T
    np.testing.assert_array_equal(steps, other.block(VOLTAGE[:50]))


def test_state_is_physical(friend_2: Actuator) -> None:
    simulator = friend_2.simulator(RATE, "zero-before")
    outputs = simulator.block(np.ones(50_000))[:, -1]
    state = simulator.state
    assert tuple(state) == friend_2.state_names
    current, node, displacement, _ = outputs
    elements = friend_2.circuit_elements()
    # At the end every capacitor, and the coupling's filter, stand at the node voltage of the divider.
    assert node == pytest.approx(elements.dc / (elements.dc + 2.0 * elements.electrode), rel=1e-9)
    assert current == pytest.approx(1.0 / (elements.dc + 2.0 * elements.electrode), rel=1e-9)
    for name in ("circuit.branches.0.voltage", "circuit.branches.1.voltage", "coupling.filtered_voltage"):
        assert state[name] == pytest.approx(node, rel=1e-9)
    assert state["beam.displacement"] == pytest.approx(displacement, rel=1e-9)
    assert abs(state["beam.velocity"]) < 1e-12


def test_a_state_starts_another_simulation(friend_2: Actuator) -> None:
    simulator = friend_2.simulator(RATE)
    simulator.block(VOLTAGE[:150])
    rest = simulate(friend_2, VOLTAGE[150:], duration=5.0, rate=RATE, initial_state=simulator.state)
    again = friend_2.simulator(RATE, initial_state=simulator.state).block(VOLTAGE[150:])
    np.testing.assert_allclose(rest.channels["force"], again[3], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(rest.channels["force"], simulator.block(VOLTAGE[150:])[3], rtol=1e-12, atol=1e-15)


def test_bad_input(friend_2: Actuator) -> None:
    with pytest.raises(InputError, match="rate: the rate is 0, it must be a number above 0"):
        friend_2.simulator(0)
    with pytest.raises(InputError, match="rate: '50 s' is not a frequency"):
        friend_2.simulator("50 s")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="does not say what its voltage did"):
        friend_2.simulator(50, "unknown")
    with pytest.raises(InputError, match="voltage: row 1 is nan"):
        friend_2.simulator(50).block([0.0, float("nan")])
    with pytest.raises(InputError, match="frequency: a frequency is negative or not finite"):
        friend_2.frequency_response([-1.0])
