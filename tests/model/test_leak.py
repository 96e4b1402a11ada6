"""The leak: its laws and the equations they make of a sample, against formulas, ODE solvers and strips without it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from ipmclab import InputError, IpmclabError, load_actuator, simulate
from ipmclab.model import Actuator, simulate_outputs
from ipmclab.model.numerics.law_loop import law, solve_one, solve_several
from ipmclab.model.outputs import leaking_loop
from ipmclab.run import Hold
from tests.independent.thesis import FRIEND_2, OUTPUTS

FORMS = ("cubic", "exponential", "butler_volmer")
EPSILON = np.finfo(float).eps
AREA = FRIEND_2.width * (FRIEND_2.free_length + FRIEND_2.clamped_length)

magnitude = st.floats(-9.0, 9.0).map(lambda exponent: 10.0**exponent)
sharp = st.floats(-3.0, 2.0).map(lambda exponent: 10.0**exponent)
threshold = st.one_of(st.just(0.0), st.floats(0.0, 10.0))
coefficients = st.one_of(
    st.tuples(st.just(0), st.tuples(*[st.one_of(st.just(0.0), magnitude)] * 3)),
    st.tuples(st.sampled_from([1, 2]), st.tuples(st.one_of(st.just(0.0), magnitude), threshold, sharp)),
)


def written_out(form: int, k: tuple[float, float, float], v: float) -> float:
    """The laws as the literature writes them."""
    size = abs(v)
    if form == 0:
        return k[0] * v + k[1] * size * v + k[2] * v**3
    if size <= k[1]:
        return 0.0
    above = (size - k[1]) / k[2]
    return math.copysign(k[0] * math.expm1(above) if form == 1 else 2.0 * k[0] * math.sinh(above / 2.0), v)


@given(coefficients, st.floats(-8.0, 8.0), st.floats(0.0, 1.0))
def test_laws_are_odd_monotone_and_as_written(
    one: tuple[int, tuple[float, float, float]], v: float, more: float
) -> None:
    form, k = one
    numbers = np.array(k)
    with np.errstate(over="ignore"):
        if form and k[2] < 0.02:
            v, more = v / 10.0, more / 10.0  # an exponential that stays in floating point
        here, slope = law(form, numbers, v)
        there, _ = law(form, numbers, v + more)
    assert here == pytest.approx(written_out(form, k, v), rel=1e-12, abs=1e-300)
    assert law(form, numbers, -v)[0] == -here
    assert there >= here
    assert slope >= 0.0


@given(coefficients, magnitude, st.floats(-6.0, 4.0), st.booleans())
def test_one_equation_has_its_solution_to_rounding(
    one: tuple[int, tuple[float, float, float]], q: float, exponent: float, negative: bool
) -> None:
    form, k = one
    r = (-1.0 if negative else 1.0) * 10.0**exponent
    p, w = solve_one(form, np.array(k), q, r)
    assert 0.0 <= p / r <= 1.0 + 4 * EPSILON
    assert abs(p + q * w - r) <= 8 * EPSILON * abs(r)
    exact, slope = law(form, np.array(k), p)
    # A voltage that is rounded moves a steep law: by its slope, and by its curvature over that.
    allowed = 64 * EPSILON * (abs(exact) + slope * (abs(p) + (k[1] if form else 0.0)))
    assert abs(w - exact) <= allowed


@given(
    st.integers(0, 2**32 - 1),
    st.lists(coefficients, min_size=2, max_size=6),
    st.floats(-3.0, 2.0).map(lambda exponent: 10.0**exponent),
    st.integers(0, 2),
)
def test_several_equations_have_one_solution(
    seed: int, laws: list[tuple[int, tuple[float, float, float]]], volts: float, missing: int
) -> None:
    rng = np.random.default_rng(seed)
    m = len(laws)
    factor = rng.normal(size=(m, m))
    q = (factor @ factor.T + 1e-3 * np.eye(m)) * 10.0 ** rng.uniform(-2.0, 2.0)
    q[: min(missing, m - 1)] = q[:, : min(missing, m - 1)] = 0.0  # ports that no current lowers, as a contact
    forms = np.array([form for form, _ in laws])
    k = np.array([numbers for _, numbers in laws])
    k[forms != 0, 2] = np.maximum(k[forms != 0, 2], 0.02 * volts)  # else q may ask for a current beyond floats
    r = rng.normal(size=m) * volts
    found = []
    for guess in (np.zeros(m), r, rng.normal(size=m) * 10.0 * volts):
        p, w = guess.copy(), np.empty(m)
        assert solve_several(forms, k, q, r, p, w)
        scale = np.max(np.abs(r)) + np.max(np.abs(q)) * np.max(np.abs(w))
        assert np.max(np.abs(p + q @ w - r)) <= 1e-12 * scale
        for i in range(m):
            exact, slope = law(forms[i], k[i], p[i])
            assert abs(w[i] - exact) <= 1e-12 * abs(exact) + slope * 1e-12 * max(volts, np.max(np.abs(r)))
        found.append(p)
    assert np.allclose(found[1], found[0], rtol=1e-9, atol=1e-9 * volts)
    assert np.allclose(found[2], found[0], rtol=1e-9, atol=1e-9 * volts)


def test_an_equation_beyond_floating_point_is_told() -> None:
    w = np.empty(2)
    forms, k = np.array([0, 0]), np.ones((2, 3))
    assert not solve_several(forms, k, np.eye(2), np.array([np.inf, 1.0]), np.zeros(2), w)
    # At a contact without resistance nothing holds back the current of a steep law.
    clamped = load_actuator("friend-2+clamp+leak.exponential").replace(**{"leak.exponential.voltage_scale": 1e-3})
    with pytest.raises(IpmclabError) as caught:
        simulate(clamped.replace(**{"clamp.direct_share": 1.0}), np.full(10, 3.0), duration=1, rate=10)
    assert caught.value.code == "no-solution"
    assert caught.value.where == "leak"
    assert caught.value.repair


def outputs(actuator: Actuator, voltage: np.ndarray, rate: float, hold: str, *, dense: bool = False) -> np.ndarray:
    state = np.zeros(len(actuator.state_names)) if dense else None
    run = simulate(actuator, voltage, duration=len(voltage) / rate, rate=rate, hold=hold, initial_state=state)
    return np.array([run.channels[name] for name in OUTPUTS])


def apart(ours: np.ndarray, expected: np.ndarray) -> float:
    return float(np.max(np.max(np.abs(ours - expected), axis=1) / np.max(np.abs(expected), axis=1)))


def rough(rows: int) -> np.ndarray:
    """Steps, slopes, rest and noise, up to 3 V."""
    time = np.arange(rows) / 50.0
    noise = np.random.default_rng(20261121).normal(size=rows)
    volts = 1.5 * np.sin(1.3 * time) + np.sign(np.sin(1.1 * time)) + 0.2 * noise
    volts[rows // 2 : rows // 2 + 20] = 2.5
    return volts


@pytest.mark.parametrize("hold", ["zero", "zero-before", "first"])
@pytest.mark.parametrize("form", FORMS)
def test_a_leak_without_current_is_the_strip_of_the_thesis(form: str, hold: str) -> None:
    expected = outputs(load_actuator("friend-2"), rough(300), 50.0, hold)
    richer = load_actuator(f"friend-2+leak.{form}")
    amplitude = f"leak.{form}.{'cubic' if form == 'cubic' else 'current_density'}"
    off = richer.replace(**{amplitude: 0.0})
    assert apart(outputs(off, rough(300), 50.0, hold), expected) < 1e-12
    assert apart(outputs(off, rough(300), 50.0, hold, dense=True), expected) < 1e-12
    slow = load_actuator(f"friend-2+leak.{form}+leak.slow").replace(**{"leak.slow.growth": 0.0})
    assert apart(outputs(slow, rough(300), 50.0, hold), outputs(richer, rough(300), 50.0, hold)) < 1e-12
    if form != "cubic":
        high = richer.replace(**{f"leak.{form}.threshold": 10.0})
        assert apart(outputs(high, rough(300), 50.0, hold), expected) < 1e-12


@pytest.mark.parametrize("hold", ["zero", "zero-before", "first"])
@pytest.mark.parametrize("name", ["leak.cubic", "leak.exponential", "leak.butler_volmer"])
def test_the_loop_over_modes_equals_the_dense_one(name: str, hold: str) -> None:
    time = np.arange(700) / 50.0
    for changes in ({}, {"threshold": 0.0, "voltage_scale": 0.05}, {"current_density": 1e7, "voltage_scale": 0.004}):
        if name == "leak.cubic":
            changes = {"linear": 3.0, "quadratic": 100.0} if changes else {}
        actuator = load_actuator(f"friend-2+{name}").replace(**{f"{name}.{key}": v for key, v in changes.items()})
        for voltage in (rough(700), np.full(700, 3.0), 3.0 * np.sin(0.6 * time), np.zeros(700)):
            fast, dense = (outputs(actuator, voltage, 50.0, hold, dense=way) for way in (False, True))
            if np.any(voltage):
                # The dense path is given a state, for which the voltage before row 0 is the first one.
                assert apart(fast, dense) < 1e-11, (changes, hold)
            else:
                assert not np.any(fast)


@pytest.mark.parametrize("hold", ["zero", "zero-before", "first"])
@pytest.mark.parametrize(
    "stages",
    [
        "leak.exponential+relaxation.displacement",
        "leak.butler_volmer+relaxation.displacement=2+relaxation.force_pair",
        "leak.cubic+viscoelastic=2+laser",
        "leak.exponential+relaxation.force+viscoelastic",
    ],
)
def test_what_hangs_on_the_node_follows_the_loop_over_modes(stages: str, hold: Hold) -> None:
    actuator = load_actuator(f"friend-2+{stages}")
    assert leaking_loop(actuator, 0.02, hold) is not None  # and not the dense path, with which it is compared
    for voltage in (rough(700), np.full(700, 3.0)):
        assert apart(outputs(actuator, voltage, 50.0, hold), outputs(actuator, voltage, 50.0, hold, dense=True)) < 1e-11
    assert not np.any(outputs(actuator, np.zeros(700), 50.0, hold))
    two = outputs(actuator, np.array([1.0, 3.0]), 50.0, hold)
    assert apart(two[:, 1:], outputs(actuator, np.array([1.0, 3.0]), 50.0, hold, dense=True)[:, 1:]) < 1e-11


@pytest.mark.parametrize("hold", ["zero", "zero-before", "first"])
@pytest.mark.parametrize(
    "stages",
    [
        "relaxation.displacement",
        "viscoelastic=2+laser",
        "leak.butler_volmer+leak.slow+relaxation.force",
        "leak.cubic+clamp",
        "leak.exponential+line.segments=4",
    ],
)
def test_rows_of_one_period_equal_a_time_line(stages: str, hold: Hold) -> None:
    actuator = load_actuator(f"friend-2+{stages}")
    time, later = np.arange(400) / 50.0, np.arange(400) / 50.0
    later[-1] += 0.013  # no regular clock, which is laid on a time line
    for voltage in (rough(400), np.full(400, 3.0)):
        for names in (list(OUTPUTS), ["force", "current"]):
            straight = simulate_outputs(actuator, time, voltage, hold, outputs=names)
            laid = simulate_outputs(actuator, later, voltage, hold, outputs=names)
            assert apart(straight[:, :-1], laid[:, :-1]) < 1e-12


@pytest.mark.parametrize(("rate", "bound"), [(50.0, 2e-6), (10.0, 2e-6)])
@pytest.mark.parametrize("form", FORMS)
def test_a_step_and_a_ramp_against_an_ode_solver(form: str, rate: float, bound: float) -> None:
    """The circuit of Fig. 4.3 with the law in parallel to R_dc, its node found by bisection, stepped by Radau."""
    k = {"cubic": (0.4, 1.5, 3.0), "exponential": (10.0, 1.23, 0.5), "butler_volmer": (12.0, 1.1, 0.4)}[form]
    names = [name for name in load_actuator(f"friend-2+leak.{form}").parameter_values if name.startswith("leak.")]
    actuator = load_actuator(f"friend-2+leak.{form}").replace(**dict(zip(names, k, strict=True)))
    series = 2.0 * FRIEND_2.electrode_resistance
    resistances, capacitances = FRIEND_2.branch_resistances, FRIEND_2.branch_capacitances

    def node(volts: float, charged: np.ndarray) -> float:
        def missing(at: float) -> float:
            drawn = at / FRIEND_2.dc_resistance + AREA * written_out(FORMS.index(form), k, at)
            into = sum((at - v) / r for v, r in zip(charged, resistances, strict=True))
            return (volts - at) / series - drawn - into

        return float(brentq(missing, -10.0, 10.0, xtol=1e-15, rtol=8 * EPSILON))

    for signal, hold in ((lambda _: 3.0, "zero"), (lambda t: 0.6 * t, "first")):

        def flow(t: float, charged: np.ndarray, signal=signal) -> list[float]:  # type: ignore[no-untyped-def]
            at = node(signal(t), charged)
            return [(at - v) / (r * c) for v, r, c in zip(charged, resistances, capacitances, strict=True)]

        time = np.arange(int(5 * rate)) / rate
        solved = solve_ivp(flow, (0.0, time[-1]), [0.0, 0.0], method="Radau", t_eval=time, rtol=1e-9, atol=1e-11)
        at = np.array([node(signal(t), charged) for t, charged in zip(time, solved.y.T, strict=True)])
        current = np.array([(signal(t) - u) / series for t, u in zip(time, at, strict=True)])
        ours = outputs(actuator, np.array([signal(t) for t in time]), rate, hold)
        assert apart(ours[:2], np.array([current, at])) < bound


def test_second_order_and_exact_where_the_law_is_linear_in_the_limit() -> None:
    """A cubic leak with a linear part only is a smaller R_dc."""
    leaking = load_actuator("friend-2+leak.cubic").replace(**{"leak.cubic.cubic": 0.0, "leak.cubic.linear": 40.0})
    conductance = 1.0 / FRIEND_2.dc_resistance + 40.0 * AREA
    scale = FRIEND_2.width * (FRIEND_2.free_length + FRIEND_2.clamped_length) / FRIEND_2.thickness
    linear = load_actuator("friend-2").replace(**{"circuit.dc_resistivity": scale / conductance})
    errors = []
    for rate in (50.0, 100.0, 200.0):
        step = np.full(int(4 * rate), 2.0)
        errors.append(apart(outputs(leaking, step, rate, "zero"), outputs(linear, step, rate, "zero")))
    assert errors[0] < 2e-6
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.1)
    # The small signal about 0 V is that of the smaller R_dc too.
    frequencies = [0.0, 0.1, 3.0, 40.0]
    assert np.allclose(leaking.frequency_response(frequencies), linear.frequency_response(frequencies), rtol=1e-12)
    assert np.allclose(leaking.to_scipy().A, linear.to_scipy().A, rtol=1e-12)
    above = load_actuator("friend-2+leak.exponential")
    assert np.array_equal(
        above.frequency_response(frequencies), load_actuator("friend-2").frequency_response(frequencies)
    )


def test_the_name_of_an_export_says_where_it_holds() -> None:
    pytest.importorskip("control")
    assert load_actuator("friend-2+leak.cubic").to_control().name == "friend-2+leak_cubic about 0 V"
    assert load_actuator("friend-2").to_control().name == "friend-2"


STRUCTURES = [
    "friend-2+leak.exponential",
    "friend-2+leak.butler_volmer+leak.slow",
    "friend-2+leak.cubic+clamp+relaxation.displacement",
    "friend-2+leak.exponential+line.segments=4",
]


@pytest.mark.parametrize("rate", [50.0, 7.0])
@pytest.mark.parametrize("hold", ["zero", "zero-before", "first"])
@pytest.mark.parametrize("name", STRUCTURES)
def test_blocks_joined_equal_one_call(name: str, hold: str, rate: float) -> None:
    actuator = load_actuator(name)
    voltage = rough(120)
    simulator = actuator.simulator(rate, hold)
    joined = np.hstack([simulator.block(part) for part in np.split(voltage, [1, 2, 40, 41, 90])])
    if hold == "zero":
        assert apart(joined, outputs(actuator, voltage, rate, hold)) < 1e-12
    assert apart(joined, outputs(actuator, voltage, rate, hold, dense=True)) < 1e-12


@pytest.mark.parametrize("name", ["leak.exponential", "leak.butler_volmer"])
def test_a_stiff_leak_is_stable_and_ends_at_its_balance(name: str) -> None:
    actuator = load_actuator(f"friend-2+{name}")
    for density, scale in ((1e9, 1e-3), (1e9, 0.5), (1e4, 1e-3)):
        stiff = actuator.replace(**{f"{name}.current_density": density, f"{name}.voltage_scale": scale})
        for rate in (50.0, 2.0):
            voltage = np.concatenate([np.full(int(120 * rate), 5.0), np.full(int(120 * rate), -5.0)])
            current, node, _, _ = outputs(stiff, voltage, rate, "zero")
            assert np.max(np.abs(node)) <= 5.0
            assert np.max(np.abs(np.diff(node[int(5 * rate) : int(120 * rate)]))) < 1e-3  # it does not ring
            series, k = 2.0 * FRIEND_2.electrode_resistance, (density * AREA, 1.23, scale)

            def missing(at: float) -> float:
                form = FORMS.index(name.removeprefix("leak."))
                return (5.0 - at) / series - at / FRIEND_2.dc_resistance - written_out(form, k, at)  # noqa: B023

            top = 1.23 + scale * math.log1p(5.0 / series / k[0]) * 2.0
            balance = brentq(missing, 0.0, top, xtol=1e-15)
            assert node[int(120 * rate) - 1] == pytest.approx(balance, rel=1e-6)
            assert node[-1] == pytest.approx(-balance, rel=1e-6)
            assert current[-1] == pytest.approx(-(5.0 - balance) / series, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("leak.cubic.linear", -1.0),
        ("leak.cubic.quadratic", -1e-9),
        ("leak.cubic.cubic", math.nan),
        ("leak.exponential.current_density", -0.1),
        ("leak.exponential.voltage_scale", 0.0),
        ("leak.butler_volmer.threshold", -1.23),
        ("leak.butler_volmer.voltage_scale", math.inf),
        ("leak.slow.growth", -0.5),
        ("leak.slow.time_constant", 0.0),
    ],
)
def test_what_would_not_be_monotone_is_refused(name: str, value: float) -> None:
    stage = ".".join(name.split(".")[:2])
    actuator = load_actuator(f"friend-2+{stage}" + ("+leak.cubic" if stage == "leak.slow" else ""))
    with pytest.raises(InputError) as caught:
        actuator.replace(**{name: value})
    assert caught.value.where == name
    assert "outside the allowed" in str(caught.value)


@pytest.mark.parametrize("form", ["exponential", "butler_volmer"])
def test_a_leak_without_a_threshold_conducts_at_small_voltages(form: str) -> None:
    """At rest, a small voltage draws in the end what the frequency response says of 0 Hz."""
    changes = {"current_density": 10.0, "threshold": 0.0, "voltage_scale": 0.25}
    leaking = load_actuator(f"friend-2+leak.{form}").replace(
        **{f"leak.{form}.{name}": value for name, value in changes.items()}
    )
    small = 1e-4
    steady = simulate(leaking, f"step {small} V", duration=4000.0, rate=0.5).current
    assert steady is not None
    assert float(leaking.frequency_response([0.0], ["current"])[0, 0].real) == pytest.approx(
        steady[-1] / small, rel=1e-3
    )
