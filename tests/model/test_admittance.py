"""The circuit as poles and residues, against an eigensolver of the assembled model and against itself inverted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import load_actuator
from ipmclab.identification.problem.response import lumped, lumped_derivatives
from ipmclab.model.admittance import Elements, admittance, capacitor_voltages, elements
from ipmclab.model.numerics.poles_loop import pole_response, ramp_weights

positive = st.floats(-3.0, 3.0).map(lambda exponent: 10.0**exponent)


def test_poles_and_residues_of_friend_2() -> None:
    actuator = load_actuator("friend-2")
    seen, _ = admittance(lumped(2, actuator.parameter_values))
    np.testing.assert_allclose(seen.poles, [-1.32990, -0.06347], rtol=1e-4)
    assert seen.direct == pytest.approx(6.0348029e-2, rel=1e-7)
    frequency = np.array([0.001, 0.1, 3.0, 200.0])
    s = 2j * np.pi * frequency
    response = seen.direct + np.sum(seen.residues / (s[:, None] - seen.poles), axis=1)
    np.testing.assert_allclose(response, actuator.frequency_response(frequency, ["current"])[0], rtol=1e-12)


@given(st.integers(1, 4), st.data())
def test_the_elements_come_back(branches: int, data: st.DataObject) -> None:
    resistances = np.array([data.draw(positive) for _ in range(branches)])
    # Time constants at least 30 % apart: equal ones are one branch.
    times = np.cumprod([data.draw(positive), *(1.3 + 10.0 * data.draw(st.floats(0, 1)) for _ in range(branches - 1))])
    circuit = Elements(
        data.draw(st.sampled_from([0.0, 0.1, 3.0])), data.draw(positive), resistances, times / resistances
    )
    seen, _ = admittance(circuit)
    assert np.all(seen.poles < 0)
    assert np.all(seen.residues <= 0)
    # What is asked back is the admittance: elements that hardly show in it cannot come back to all digits.
    again, _ = admittance(elements(circuit.series, seen))
    s = 1j * np.geomspace(1e-4, 1e4, 30)[:, None]
    first, second = (a.direct + np.sum(a.residues / (s - a.poles), axis=1) for a in (seen, again))
    np.testing.assert_allclose(second, first, rtol=1e-6)


def test_derivatives_against_differences() -> None:
    circuit = Elements(3.0, 50.0, np.array([0.6, 20.0, 90.0]), np.array([0.07, 0.3, 0.9]))

    def at(point: np.ndarray) -> np.ndarray:
        values = np.exp(point[1:])
        seen, _ = admittance(Elements(point[0], values[0], values[1:4], values[4:]))
        return np.array([seen.direct, *seen.residues, *seen.poles])

    point = np.array([3.0, *np.log([50.0, 0.6, 20.0, 90.0, 0.07, 0.3, 0.9])])
    numeric = np.array([(at(point + h) - at(point - h)) / 2e-5 for h in 1e-5 * np.eye(8)]).T
    exact = admittance(circuit)[1]
    np.testing.assert_allclose(
        exact, numeric, rtol=1e-6, atol=1e-8 * np.max(np.abs(numeric), axis=1, keepdims=True).max()
    )


def test_parameters_reach_the_elements() -> None:
    values = dict(load_actuator("friend-2").parameter_values)
    names = list(values)
    exact = lumped_derivatives(2, values, names)
    for column, name in enumerate(names):
        step = 1e-6 * max(abs(values[name]), 1e-3)
        up, down = (lumped(2, {**values, name: values[name] + sign * step}) for sign in (1, -1))
        logs = [np.log([e.leak, *e.resistances, *e.capacitances]) for e in (up, down)]
        numeric = np.array([up.series - down.series, *(logs[0] - logs[1])]) / (2 * step)
        np.testing.assert_allclose(exact[:, column], numeric, rtol=1e-6, atol=1e-6 * np.max(np.abs(numeric)) + 1e-9)


def test_starting_amplitudes_are_capacitor_voltages() -> None:
    circuit = Elements(16.0, 70.92, np.array([0.58366, 39.594]), np.array([73.457e-3, 294.53e-3]))
    seen, _ = admittance(circuit)
    amplitudes = np.array([2e-3, -7e-4])
    voltages = capacitor_voltages(circuit, amplitudes)
    # With the terminals shorted the current is what the capacitors push through the series resistance.
    conductance = 1 / circuit.series + 1 / circuit.leak + np.sum(1 / circuit.resistances)
    node = np.sum(voltages / circuit.resistances) / conductance
    assert -node / circuit.series == pytest.approx(np.sum(amplitudes), rel=1e-12)
    rate = np.sum((node - voltages) / (circuit.resistances * circuit.capacitances) / circuit.resistances) / conductance
    assert -rate / circuit.series == pytest.approx(np.sum(amplitudes * seen.poles), rel=1e-10)


@pytest.mark.parametrize("z", [1e-9, 1e-3, 0.0499, 0.0501, 1.0, 40.0])
def test_the_step_weights_against_quadrature(z: float) -> None:
    from scipy.integrate import quad

    step, pole = 0.02, -z / 0.02
    found = ramp_weights(step, pole)
    fall, rise = (lambda t: 1 - t / step), (lambda t: t / step)
    for place, (line, moment) in enumerate([(fall, 0), (rise, 0), (fall, 1), (rise, 1)], start=1):
        exact = quad(
            lambda t, f=line, m=moment: (step - t) ** m * np.exp(pole * (step - t)) * f(t), 0, step, epsrel=1e-12
        )
        assert found[place] == pytest.approx(exact[0], rel=1e-10)


def test_a_response_and_its_slope_against_a_convolution() -> None:
    generator = np.random.default_rng(20261121)
    steps = generator.uniform(0.01, 0.2, 60)
    start, end = generator.standard_normal((2, 60))
    poles = np.array([-30.0, -0.7])
    state, slope = np.empty((2, 61)), np.empty((2, 61))
    kind = np.arange(60)
    pole_response(steps, kind, start, end, poles, np.empty(0, np.int64), state, slope)
    knots = np.concatenate([[0], np.cumsum(steps)])
    for row, pole in enumerate(poles):
        total = 0.0
        for k in range(60):
            fine = np.linspace(0, steps[k], 4001)
            line = start[k] + (end[k] - start[k]) * fine / steps[k]
            total += np.trapezoid(np.exp(pole * (knots[-1] - knots[k] - fine)) * line, fine)
        assert state[row, -1] == pytest.approx(total, abs=1e-7)
        moved = [np.empty((1, 61)) for _ in range(4)]
        for sign, keep in ((1, moved[:2]), (-1, moved[2:])):
            pole_response(steps, kind, start, end, np.array([pole * (1 + sign * 1e-6)]), np.empty(0, np.int64), *keep)
        assert slope[row, -1] == pytest.approx((moved[0][0, -1] - moved[2][0, -1]) / (2e-6 * pole), rel=1e-5, abs=1e-9)


@given(st.integers(1, 4), st.sampled_from([0.0, 0.1, 16.0]), st.data())
def test_no_circuit_has_a_pole_of_the_wrong_sign(branches: int, series: float, data: st.DataObject) -> None:
    # Far beyond any strip, where searches go: time constants from 1e-18 s to 1e15 s beside each other.
    resistances = 10.0 ** np.array([data.draw(st.floats(-6.0, 9.0)) for _ in range(branches)])
    capacitances = 10.0 ** np.array([data.draw(st.floats(-12.0, 6.0)) for _ in range(branches)])
    seen, derivatives = admittance(Elements(series, 50.0, resistances, capacitances))
    assert np.all(seen.poles < 0.0)
    assert np.all(seen.residues <= 0.0)
    assert np.isfinite(derivatives).all()
