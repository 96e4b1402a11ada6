"""Delays, irregular clocks and derivatives against fine grids, lsim and differences of other programs."""

from __future__ import annotations

import re

import numpy as np
import pytest
import scipy.signal

from ipmclab import InputError
from ipmclab.model import Actuator, sensitivities, simulate_outputs
from ipmclab.model.joined import Joined
from ipmclab.model.numerics import tangents_modal
from ipmclab.model.numerics.tangents_modal import Modes
from ipmclab.model.sensitivity import Kept, _Point
from ipmclab.model.variants import with_stages
from tests.independent.thesis import FRIEND_2, OUTPUTS, Strip, respond
from tests.model.conftest import STRIPS, actuator_of

RATE = 50.0
PERIOD = 1.0 / RATE
ROWS = 150
FINE = 10
HOLDS = ("zero", "zero-before", "first")
TIME = np.arange(ROWS) * PERIOD


def rough() -> np.ndarray:
    voltage = np.sign(np.sin(2.3 * TIME)) + np.sin(17.0 * TIME)
    voltage[0] = 0.0
    return voltage


def on_fine_grid(strip: Strip, voltage: np.ndarray, hold: str, delay: int) -> np.ndarray:
    """Every output at the rows, with the voltage ``delay`` tenths of a period late, by a grid ten times as fine."""
    early = max(0, -delay)
    ticks = np.arange(-early, FINE * (len(voltage) - 1) + 1)
    if hold == "first":
        fine = np.interp((ticks - delay) / FINE, np.arange(len(voltage)), voltage)
    elif hold == "zero":
        held = (ticks - delay) // FINE
        fine = np.where(held >= 0, voltage[held.clip(0, len(voltage) - 1)], 0.0)
    else:  # what was held just before each tick
        held = -((delay - ticks) // FINE)
        fine = voltage[held.clip(0, len(voltage) - 1)]
    found = respond(strip, fine, RATE * FINE, hold)
    return np.array([found[output][early::FINE] for output in OUTPUTS])


def peak(values: np.ndarray) -> np.ndarray:
    return np.max(np.abs(values), axis=1, keepdims=True)


@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("delay", [0, 3, 9, 10, 20, 27, -4, -10, -13])
def test_delays_against_a_fine_grid(hold: str, delay: int) -> None:
    values = simulate_outputs(actuator_of(FRIEND_2), TIME, rough(), hold, delay=delay * PERIOD / FINE)
    expected = on_fine_grid(FRIEND_2, rough(), hold, delay)
    np.testing.assert_array_less(np.abs(values - expected) / peak(expected), 1e-10)


@pytest.mark.parametrize("hold", HOLDS)
def test_an_irregular_clock_against_a_fine_grid(hold: str) -> None:
    # Rows on some ticks of a fine grid; the voltage is laid out by hand on all of them.
    ticks = np.cumsum(np.random.default_rng(20261121).integers(1, 13, size=ROWS)) - 1
    ticks -= ticks[0]
    voltage, every = rough(), np.arange(ticks[-1] + 1)
    if hold == "first":
        fine = np.interp(every, ticks, voltage)
    elif hold == "zero":
        fine = voltage[np.searchsorted(ticks, every, side="right") - 1]
    else:
        fine = voltage[np.searchsorted(ticks, every, side="left")]
    expected = respond(FRIEND_2, fine, RATE * FINE, hold)
    times = 100.0 + ticks * PERIOD / FINE
    values = simulate_outputs(actuator_of(FRIEND_2), times, voltage, hold)
    expected_rows = np.array([expected[output][ticks] for output in OUTPUTS])
    np.testing.assert_array_less(np.abs(values - expected_rows) / peak(expected_rows), 1e-8)


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_an_initial_state_against_lsim(hold: str, friend_2: Actuator) -> None:
    state = np.array([0.3, -0.2, 0.5, 1.5, 2e-4, -3e-3])
    voltage = rough() + 1.0
    values = simulate_outputs(friend_2, TIME, voltage, hold, initial_state=state)
    _, expected, _ = scipy.signal.lsim(friend_2.to_scipy(), voltage, TIME, X0=state, interp=hold == "first")
    np.testing.assert_array_less(np.abs(values - expected.T) / peak(expected.T), 1e-10)
    named = simulate_outputs(
        friend_2, TIME, voltage, hold, initial_state=dict(zip(friend_2.state_names, state, strict=True))
    )
    np.testing.assert_array_equal(named, values)


def test_of_no_output_there_are_no_sensitivities(friend_2: Actuator) -> None:
    found = sensitivities(friend_2, ["coupling.gain"], [0.0, 0.02, 0.04], [1.0, 1.0, 1.0], "zero", outputs=[])
    assert found.values.shape == (0, 3)
    assert found.parameters.shape == (0, 3, 1)


def test_outputs_come_in_the_wanted_order(friend_2: Actuator) -> None:
    every = simulate_outputs(friend_2, TIME, rough(), "zero")
    chosen = simulate_outputs(friend_2, TIME, rough(), "zero", outputs=["force", "current"])
    np.testing.assert_array_equal(chosen, every[[3, 0]])
    with pytest.raises(InputError, match="outputs: unknown output 'forse'; did you mean 'force'"):
        simulate_outputs(friend_2, TIME, rough(), "zero", outputs=["forse"])
    with pytest.raises(InputError, match=re.escape("unknown parameter 'coupling.gains'; did you mean 'coupling.gain'")):
        sensitivities(friend_2, ["coupling.gains"], TIME, rough(), "zero")


FIELDS = {
    "geometry.free_length": "free_length",
    "geometry.thickness": "thickness",
    "circuit.contact_resistance": "contact_resistance",
    "coupling.gain": "gain",
    "coupling.zero": "zero",
    "coupling.p1": "p1",
    "coupling.p2": "p2",
    "beam.modulus": "modulus",
    "beam.damping_ratio": "damping_ratio",
}


def central(strip: Strip, voltage: np.ndarray, hold: str, name: str, step: float) -> np.ndarray:
    """A derivative by four-point differences of the dense reference, in steps of its own (not dotted) parameters."""
    total = np.zeros((len(OUTPUTS), len(voltage)))
    for factor, weight in ((1.0, 8.0), (2.0, -1.0)):
        for sign in (1.0, -1.0):
            moved = respond(changed(strip, name, sign * factor * step), voltage, RATE, hold)
            total += sign * weight * np.array([moved[output] for output in OUTPUTS])
    return total / (12.0 * step)


def changed(strip: Strip, name: str, by: float) -> Strip:
    if name in FIELDS:
        moved = strip.changed(**{FIELDS[name]: getattr(strip, FIELDS[name]) + by})
        if name.startswith("geometry."):  # the reference holds resistances, we hold sheet resistance and resistivity
            length, old = moved.total_length / moved.width, strip.total_length / strip.width
            shape = moved.thickness / (moved.total_length * moved.width)
            moved = moved.changed(
                electrode_resistance=strip.electrode_resistance * length / old,
                dc_resistance=strip.dc_resistivity * shape,
            )
        return moved
    if name == "circuit.sheet_resistance":
        squares = strip.total_length / strip.width
        return strip.changed(electrode_resistance=strip.electrode_resistance + by * squares)
    if name == "circuit.dc_resistivity":
        scale = strip.thickness / (strip.total_length * strip.width)
        return strip.changed(dc_resistance=strip.dc_resistance + by * scale)
    _, _, index, kind = name.split(".")
    field = "resistivities" if kind == "resistivity" else "permittivities"
    values = list(getattr(strip, field))
    values[int(index)] += by
    return strip.changed(**{field: tuple(values)})


@pytest.mark.parametrize("case", ["friend-2", "equal poles of d(s)", "complex poles of d(s)", "three branches"])
def test_derivatives_by_parameters(case: str) -> None:
    strip = STRIPS[case].changed(contact_resistance=0.7)
    actuator = actuator_of(strip)
    left_out = {"geometry.clamped_length", "geometry.width", "geometry.sensing_length", "beam.density"}
    names = [name for name in actuator.parameters() if name not in left_out]
    for hold in HOLDS:
        found = sensitivities(actuator, names, TIME, rough(), hold)
        for index, name in enumerate(names):
            expected = central(strip, rough(), hold, name, 1e-3 * actuator[name])
            derivative = found.parameters[:, :, index]
            scale = peak(expected) + 1e-3 * peak(found.values) / actuator[name]
            np.testing.assert_array_less(np.abs(derivative - expected) / scale, 1e-6, err_msg=f"{hold} {name}")


def test_a_derivative_at_a_parameter_that_is_zero(friend_2: Actuator) -> None:
    assert friend_2["circuit.contact_resistance"] == 0.0
    found = sensitivities(friend_2, ["circuit.contact_resistance"], TIME, rough(), "zero").parameters[:, :, 0]
    expected = central(FRIEND_2, rough(), "zero", "circuit.contact_resistance", 1e-3)
    np.testing.assert_array_less(np.abs(found - expected) / peak(expected), 1e-8)


@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("delay", [0.0, 0.3 * PERIOD, -1.6 * PERIOD])
def test_values_are_those_of_simulate_outputs(hold: str, delay: float, friend_2: Actuator) -> None:
    found = sensitivities(friend_2, ["coupling.p1"], TIME, rough(), hold, delay=delay)
    values = simulate_outputs(friend_2, TIME, rough(), hold, delay=delay)
    np.testing.assert_array_less(np.abs(found.values - values) / peak(values), 1e-12)
    # Derivatives by parameters with a delay: differences of the values, which the fine grid proves.
    step = 1e-4 * friend_2["coupling.p1"]
    around = [
        simulate_outputs(
            friend_2.replace(**{"coupling.p1": friend_2["coupling.p1"] + by}), TIME, rough(), hold, delay=delay
        )
        for by in (step, -step)
    ]
    expected = (around[0] - around[1]) / (2.0 * step)
    np.testing.assert_array_less(np.abs(found.parameters[2:, :, 0] - expected[2:]) / peak(expected[2:]), 1e-6)


@pytest.mark.parametrize("hold", HOLDS)
def test_derivatives_by_initial_states_are_the_free_responses(hold: str, friend_2: Actuator) -> None:
    state = np.array([0.3, -0.2, 0.5, 1.5, 2e-4, -3e-3])
    found = sensitivities(friend_2, [], TIME, rough(), hold, initial_state=state)
    for index, unit in enumerate(np.eye(len(state))):
        _, free, _ = scipy.signal.lsim(friend_2.to_scipy(), np.zeros(ROWS), TIME, X0=unit)
        np.testing.assert_allclose(found.states[:, :, index], free.T, atol=1e-10 * np.max(peak(free.T)), rtol=1e-9)


@pytest.mark.parametrize("delay", [0.31, 1.73, -0.45, -1.2])
@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("rest", [True, False])
def test_derivative_by_the_delay(hold: str, delay: float, rest: bool, friend_2: Actuator) -> None:
    voltage = rough() + 0.4
    state = None if rest else np.array([0.3, -0.2, 0.5, 1.5, 2e-4, -3e-3])

    def values(late: float) -> np.ndarray:
        return simulate_outputs(friend_2, TIME, voltage, hold, initial_state=state, delay=late)

    found = sensitivities(friend_2, [], TIME, voltage, hold, initial_state=state, delay=delay * PERIOD).delay
    step = 1e-3 * PERIOD
    ahead, behind = (values(delay * PERIOD + by) for by in (step, -step))
    far_ahead, far_behind = (values(delay * PERIOD + 2 * by) for by in (step, -step))
    expected = (8.0 * (ahead - behind) - (far_ahead - far_behind)) / (12.0 * step)
    np.testing.assert_array_less(np.abs(found - expected) / peak(expected), 1e-6)


@pytest.mark.parametrize("delay", [0.0, 0.007])
@pytest.mark.parametrize("stages", [(), ("leak.exponential",), ("clamp", "line.segments=3", "leak.cubic"), ("laser",)])
def test_what_is_kept_and_what_is_left_out_change_nothing(
    stages: tuple[str, ...], delay: float, friend_2: Actuator
) -> None:
    strip, kept = with_stages(friend_2, *stages), Kept()
    names = ["coupling.gain", "circuit.dc_resistivity", "circuit.branches.0.permittivity"]
    voltage, outputs = 2.0 * rough(), ["current", "displacement"]
    # There and back, so that what was kept at one point is not taken for another.
    for factor in (1.0, 1.01, 1.0):
        at = strip.replace(**{"coupling.gain": strip["coupling.gain"] * factor})
        alone = sensitivities(at, names, TIME, voltage, "zero", outputs=outputs, delay=delay)
        again = sensitivities(at, names, TIME, voltage, "zero", outputs=outputs, delay=delay, kept=kept)
        fewer = sensitivities(at, names, TIME, voltage, "zero", outputs=outputs, delay=delay, kept=kept, asked=())
        for field in ("values", "parameters", "states", "delay"):
            assert np.array_equal(getattr(alone, field), getattr(again, field)), field
        for field in ("values", "parameters"):
            assert np.array_equal(getattr(alone, field), getattr(fewer, field)), field
        assert not fewer.states.any()
        assert not fewer.delay.any()


NAMES = ("circuit.dc_resistivity", "circuit.branches.0.permittivity", "coupling.p1", "coupling.p2", "beam.modulus")


def modes_of(strip: Actuator) -> Modes | None:
    return _Point(Joined.of(strip, NAMES, range(4), ())).modes


@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("clock", ["even", "uneven"])
@pytest.mark.parametrize("at_rest", [True, False])
@pytest.mark.parametrize("stages", [(), ("branches=3", "load"), ("relaxation.displacement=2",), ("viscoelastic",)])
def test_by_modes_and_by_the_matrix_exponential_they_are_the_same(
    stages: tuple[str, ...], at_rest: bool, clock: str, hold: str, friend_2: Actuator, monkeypatch: pytest.MonkeyPatch
) -> None:
    strip = with_stages(friend_2, *stages)
    draw = np.random.default_rng(7)
    time = TIME + (draw.uniform(-0.2, 0.2, ROWS) * PERIOD if clock == "uneven" else 0.0)
    state = None if at_rest else 1e-2 * draw.standard_normal(len(strip.state_names))

    def found() -> tuple[np.ndarray, ...]:
        one = sensitivities(strip, NAMES, time, rough(), hold, initial_state=state, delay=0.3 * PERIOD)
        size = np.abs(one.values).max(axis=1)[:, None, None]
        by = one.parameters * np.array([strip[name] for name in NAMES]) / size
        return one.values / size[:, :, 0], by, one.states, one.delay

    assert modes_of(strip) is not None
    by_modes = found()
    monkeypatch.setattr(tangents_modal, "LOST", 0.0)  # never sure enough
    for one, other in zip(by_modes, found(), strict=True):
        scale = max(1.0, np.abs(other).max(initial=0.0))
        np.testing.assert_allclose(one / scale, other / scale, rtol=0.0, atol=1e-11)


def test_where_modes_lose_digits_they_are_not_used(friend_2: Actuator) -> None:
    """Poles that are equal or nearly so."""
    double = friend_2.replace(**{"coupling.p1": 16.0, "coupling.p2": 64.0})
    nearly = friend_2.replace(**{"coupling.p1": 16.0, "coupling.p2": 64.0 * (1.0 + 1e-9)})
    for strip in (double, nearly):
        assert modes_of(strip) is None


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-12, 0.0])
def test_slow_modes_side_by_side_may_meet(gap: float, friend_2: Actuator, monkeypatch: pytest.MonkeyPatch) -> None:
    """No parameter mixes them, so that nothing is lost where their poles are the same."""
    strip = with_stages(friend_2, "relaxation.displacement=2", "relaxation.force=1")
    strip = strip.replace(
        **{
            "relaxation.displacement.0.time_constant": 3.0,
            "relaxation.displacement.1.time_constant": 3.0 * (1.0 + gap),
            "relaxation.force.0.time_constant": 3.0,
        }
    )
    names = [*NAMES, *(name for name in strip.parameter_values if name.startswith("relaxation."))]

    def found() -> tuple[np.ndarray, ...]:
        one = sensitivities(strip, names, TIME, rough(), "zero", delay=0.3 * PERIOD)
        return one.parameters, one.states, one.delay

    assert modes_of(strip) is not None
    by_modes = found()
    monkeypatch.setattr(tangents_modal, "LOST", 0.0)
    for one, other in zip(by_modes, found(), strict=True):
        assert np.all(np.abs(one - other) <= 1e-9 * np.abs(other).max(axis=1, keepdims=True))


def test_modes_that_take_hours_beside_a_beam_that_swings(friend_2: Actuator, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the whole matrix, whose norm is that of the beam, half of the slowest pole's digits were rounding."""
    slow = friend_2.replace(**{"circuit.dc_resistivity": 1e8, "circuit.branches.1.permittivity": 1e3})
    assert modes_of(slow) is not None
    by_modes = sensitivities(slow, NAMES, TIME, rough(), "zero", delay=0.3 * PERIOD)
    monkeypatch.setattr(tangents_modal, "LOST", 0.0)
    by_exponentials = sensitivities(slow, NAMES, TIME, rough(), "zero", delay=0.3 * PERIOD)
    for one, other in ((by_modes.parameters, by_exponentials.parameters), (by_modes.states, by_exponentials.states)):
        assert np.all(np.abs(one - other) <= 1e-9 * np.abs(other).max(axis=1, keepdims=True))
