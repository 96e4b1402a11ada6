"""Runs in an environment that changes, against a stiff solver of the equations of the thesis written out here."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp

from ipmclab import InputError, load_actuator, simulate
from ipmclab.model import Actuator
from ipmclab.model.changing import changing_outputs
from ipmclab.model.environment import Environment, EnvironmentHistory, WaterState, equilibrium, values_in
from ipmclab.model.environment.laws import KINDS
from ipmclab.model.environment.path import Grid

FloatArray = npt.NDArray[np.float64]

FRIEND = load_actuator("friend-2")
# Film only, so that the water is one equation; in a wind, so that a few seconds are enough; a beam that rings little.
QUICK = {
    "hydration.diffusivity": 1.0,
    "hydration.thermal_time": 0.0,
    "hydration.film": 0.05,
    "beam.damping_ratio": 0.7,
}
STRIP = load_actuator("friend-2+" + "+".join(kind.name for kind in KINDS)).replace(
    **QUICK, **{"environment.coupling_gain.exponent": 2.0}
)
AIR = EnvironmentHistory.of([(0.0, "20 degC, 80 %RH"), (15.0, "23 degC, 50 %RH")])
LEVELS = [(0.0, 1.0), (1.2, -1.0), (3.0, 2.0)]  # from when [s], volts
END = 5.0


def stiff(strip: Actuator, leak: bool, times: FloatArray) -> FloatArray:
    """Charges, coupling, beam and water as one set of equations: the outputs at some times."""
    stated = strip.parameter_values
    area = 0.030 * stated["geometry.width"]

    def at(t: float, x: FloatArray, volts: float) -> tuple[FloatArray, FloatArray]:
        air = AIR.at(t)
        p = values_in(stated, WaterState(float(x[6]), air.temperature))
        scale = area / p["geometry.thickness"]
        series = 2.0 * p["circuit.sheet_resistance"] * 0.030 / p["geometry.width"] + p["circuit.contact_resistance"]
        r = [p[f"circuit.branches.{i}.resistivity"] / scale for i in range(2)]
        c = [p[f"circuit.branches.{i}.permittivity"] * scale for i in range(2)]
        dc = p["circuit.dc_resistivity"] / scale

        def lost(node: float) -> tuple[float, float]:
            above = max(abs(node) - 0.8, 0.0) if leak else 0.0
            slope = area * 20.0 / 0.5 * math.exp(above / 0.5) if above > 0.0 else 0.0
            return math.copysign(area * 20.0 * math.expm1(above / 0.5), node), slope

        conductance = 1.0 / series + 1.0 / dc + sum(1.0 / one for one in r)
        pulled = volts / series + sum(x[i] / c[i] / r[i] for i in range(2))
        node = pulled / conductance
        for _ in range(30):  # Newton
            gone, slope = lost(node)
            step = (pulled - gone - node * conductance) / (conductance + slope)
            node += step
            if abs(step) < 1e-13:
                break
        flowing = [(node - x[i] / c[i]) / r[i] for i in range(2)]
        z1, z2 = x[2], x[3]
        drive = p["coupling.gain"] / p["coupling.p2"] * (p["coupling.zero"] * z1 + z2)
        stiffness = 1.875**4 * p["beam.modulus"] * p["geometry.thickness"] ** 2 / (12.0 * p["beam.density"] * 0.025**4)
        static = 3.0 * 0.021**2 / p["geometry.thickness"] ** 2 * drive
        damping = 2.0 * p["beam.damping_ratio"] * math.sqrt(stiffness)
        saturated = 611.21 * math.exp((18.678 - air.temperature / 234.5) * air.temperature / (257.14 + air.temperature))
        saturated /= 8.314462618 * (air.temperature + 273.15)
        humidity = 0.8
        for _ in range(30):
            off = 0.043 + humidity * (17.81 + humidity * (-39.85 + humidity * 36.0)) - x[6]
            humidity -= off / (17.81 + humidity * (-79.7 + humidity * 108.0))
        dry = stated["geometry.thickness"] / (1.0 + stated["environment.thickness.swelling"] * 7.219)
        leaves = 2.0 * 0.05 * saturated * (humidity - air.relative_humidity / 100.0)
        split = abs(lost(node)[0]) / area / (2.0 * 96485.33212)
        rates = [
            *flowing,
            z2,
            p["coupling.p2"] * (node - z1) - p["coupling.p1"] * z2,
            x[5],
            stiffness * (static - x[4]) - damping * x[5],
            -(leaves + split) / (1800.0 * dry),
        ]
        force = 3.0 * p["geometry.thickness"] * p["geometry.width"] * p["beam.modulus"] / (4.0 * 0.021) * drive
        return np.array(rates), np.array([(volts - node) / series, node, x[4], force])

    x = np.array([0.0] * 6 + [equilibrium(stated, Environment(20.0, 80.0)).water_content])
    found = []
    for place, (begin, volts) in enumerate(LEVELS):
        end = LEVELS[place + 1][0] if place + 1 < len(LEVELS) else END
        inside = times[(times >= begin) & (times < end)]
        solved = solve_ivp(
            lambda t, y, volts=volts: at(t, y, volts)[0],
            (begin, end),
            x,
            method="LSODA",
            rtol=1e-7,
            atol=1e-10 * np.array([1.0, 1.0, 1.0, 10.0, 1e-3, 0.1, 1.0]),
            t_eval=[*inside, end],
        )
        found += [at(t, y, volts)[1] for t, y in zip(inside, solved.y.T, strict=False)]
        x = solved.y[:, -1]
    return np.array(found).T


@pytest.mark.parametrize("leaking", [False, True])
def test_a_run_in_a_changing_environment_equals_a_stiff_solver(leaking: bool) -> None:
    strip, leak = STRIP, {"current_density": 20.0, "threshold": 0.8, "voltage_scale": 0.5}
    if leaking:
        values = dict(STRIP.parameter_values) | {f"leak.exponential.{name}": one for name, one in leak.items()}
        strip = Actuator(name="leaking", parameter_values=values)
    time = np.arange(int(END * 50)) / 50.0
    voltage = np.zeros(len(time))
    for begin, volts in LEVELS:
        voltage[time >= begin] = volts
    run = simulate(strip, voltage, duration=END, rate=50, environment=AIR)
    seen = np.flatnonzero(np.arange(len(time)) % 10 == 3)
    exact = stiff(strip, leaking, time[seen])
    assert run.current is not None
    plain = simulate(strip, voltage, duration=END, rate=50)
    for row, name in enumerate(("current", "applied_voltage", "displacement", "force")):
        values = run.channels[name]
        peak = np.abs(values).max()
        assert np.abs(values[seen] - exact[row]).max() <= 1e-4 * peak, name
    assert run.force is not None
    assert plain.force is not None
    assert np.abs(run.force - plain.force).max() >= 0.01 * np.abs(run.force).max(), "the environment did something"


def test_fast_and_general_path_agree_for_every_hold() -> None:
    """Modes in pieces against matrices between knots; a state at rest that is given chooses the general path."""
    time = np.arange(1000) / 50.0
    voltage = np.sin(0.7 * time) + 0.3 * np.sign(np.sin(3.0 * time))
    for hold in ("zero", "zero-before", "first"):
        fast = changing_outputs(STRIP, time, voltage, hold, AIR).values
        rest = dict.fromkeys(STRIP.state_names, 0.0)
        begun = changing_outputs(STRIP, time, voltage, hold, AIR, initial_state=rest).values
        peaks = np.abs(fast).max(axis=1)
        # A given state means that the first voltage stood before row 0 where rows are read before they change.
        rows = slice(None) if hold == "zero" else slice(400, None)
        assert np.all(np.abs(fast - begun)[:, rows].max(axis=1) <= 1e-4 * peaks), hold


@pytest.mark.parametrize("richer", [{}, {"amplitude": 0.3, "damping_ratio": 2.0, "frequency": 10.0}])
def test_a_leak_that_flows_goes_by_modes_as_by_matrices(richer: dict[str, float]) -> None:
    leak = {"current_density": 20.0, "threshold": 0.8, "voltage_scale": 0.5}
    values = dict(STRIP.parameter_values) | {f"leak.exponential.{name}": one for name, one in leak.items()}
    values |= {f"viscoelastic.0.{name}": one for name, one in richer.items()}
    strip = Actuator(name="leaking", parameter_values=values)
    time = np.arange(500) / 50.0
    voltage = 1.5 * np.sin(0.7 * time) + 0.5 * np.sign(np.sin(3.0 * time))
    fine = np.arange(10 * len(time)) / 500.0
    finely = np.repeat(voltage, 10)
    modes = changing_outputs(strip, fine, finely, "zero", AIR)
    rest = dict.fromkeys(strip.state_names, 0.0)
    matrices = changing_outputs(strip, fine, finely, "zero", AIR, initial_state=rest)
    peaks = np.abs(modes.values).max(axis=1)
    assert np.all(np.abs(modes.values - matrices.values).max(axis=1) <= 3e-5 * peaks)
    lost, dry = (run.water.contents(9.9) for run in (modes, changing_outputs(STRIP, time, voltage, "zero", AIR)))
    assert float(lost) == pytest.approx(float(matrices.water.contents(9.9)), rel=1e-7)
    # Both directions split water: the mean of what leaks is nearly 0 here.
    area = 0.030 * strip["geometry.width"]
    charge = np.trapezoid(np.abs(area * 20.0 * np.expm1(np.maximum(np.abs(modes.values[1]) - 0.8, 0.0) / 0.5)), fine)
    sites = 1800.0 * strip["geometry.thickness"] / (1.0 + 0.0126 * 7.219) * area
    assert float(dry - lost) == pytest.approx(charge / (2.0 * 96485.33212) / sites, rel=0.3)


def test_a_grid_has_points_where_parameters_move() -> None:
    """One where nothing moves; but a law that multiplies humidity and temperature rests on both lines of reference."""
    gain = load_actuator("friend-2+environment.coupling_gain").parameter_values
    both = load_actuator("friend-2+environment.modulus").replace(
        **{"environment.modulus.humidity": 0.0, "environment.modulus.humidity_temperature": 0.01}
    )
    ends = math.log(7.219), math.log(9.0), 20.0, 25.0
    sizes = [tuple(map(len, Grid.over(one, *ends))) for one in (gain, both.parameter_values)]
    assert sizes[0][1] == 1 < sizes[0][0]
    assert min(sizes[1]) > 1


def test_an_environment_that_stands_is_that_of_the_actuator_there() -> None:
    there, air = STRIP.at(Environment(23.0, 60.0)), EnvironmentHistory.of("23 degC, 60 %RH")
    plain = simulate(there, "sine 1 V 0.5 Hz", duration=20, rate=50)
    for given in ("23 degC, 60 %RH", Environment(23.0, 60.0), air):
        run = simulate(STRIP, "sine 1 V 0.5 Hz", duration=20, rate=50, environment=given)
        for name in ("current", "displacement", "force"):
            peak = np.abs(plain.channels[name]).max()
            assert np.abs(run.channels[name] - plain.channels[name]).max() <= 1e-12 * peak
        assert run.metadata.temperature == pytest.approx(23.0)
        assert run.metadata.relative_humidity == pytest.approx(60.0)
        assert run.metadata.water_content == pytest.approx(4.159, abs=1e-3)
        assert run.metadata.findings == ()
    assert run.temperature is not None
    assert run.time_environment is not None


def test_without_laws_an_environment_changes_nothing_and_it_is_said() -> None:
    plain = simulate(FRIEND, "step 1 V", duration=10, rate=50)
    for given in ("20 degC, 40 %RH", AIR):
        run = simulate(FRIEND, "step 1 V", duration=10, rate=50, environment=given)
        assert run.displacement is not None
        assert plain.displacement is not None
        assert np.array_equal(run.displacement, plain.displacement)
        assert [finding.code for finding in run.metadata.findings] == ["environment-ignored"]


def test_charge_is_kept_where_a_capacitance_changes() -> None:
    """An isolated membrane: with nothing to flow through, q = C V stays while C falls by a fifth."""
    still = load_actuator("friend-2+environment.permittivity").replace(
        **QUICK, **{"circuit.dc_resistivity": 1e9, "circuit.contact_resistance": 1e6}
    )
    shared = [still[f"circuit.branches.{i}.permittivity"] for i in range(2)]
    charged = {f"circuit.branches.{i}.voltage": 1.0 for i in range(2)}
    time = np.arange(500) / 50.0
    found = changing_outputs(still, time, np.ones(500), "zero", AIR, initial_state=charged)
    wet, dry = (equilibrium(still.parameter_values, AIR.at(t)) for t in (0.0, 10.0))
    expected = math.sqrt(wet.water_content / float(found.water.contents(9.98)))
    assert sum(shared) > 0.0
    assert dry.water_content < wet.water_content
    assert found.values[1, -1] == pytest.approx(expected, rel=2e-3)


def test_findings_of_the_environment() -> None:
    # A cold strip into warm and humid air: water condenses before the strip is warm.
    slow = STRIP.replace(**{"hydration.thermal_time": 60.0})
    warm = EnvironmentHistory.of([(0.0, "15 degC, 60 %RH"), (5.0, "35 degC, 80 %RH")])
    run = simulate(slow, "step 1 V", duration=10, rate=50, environment=warm)
    assert [finding.code for finding in run.metadata.findings] == ["condensation"]
    with pytest.raises(InputError, match="here the strip lies in water"):
        EnvironmentHistory.of([(0.0, "20 degC, in water"), (5.0, "20 degC, 50 %RH")])


def test_water_is_split_by_what_leaks_and_the_curl_is_read() -> None:
    leak = {"current_density": 20.0, "threshold": 0.8, "voltage_scale": 0.5}
    still = {"hydration.film": 1e-6, "hydration.diffusivity": 1e-10}
    values = dict(STRIP.parameter_values) | {f"leak.exponential.{name}": one for name, one in leak.items()} | still
    strip = Actuator(name="leaking", parameter_values=values)
    time, air = np.arange(500) / 50.0, EnvironmentHistory.of("20 degC, 80 %RH")
    found = changing_outputs(strip, time, np.full(500, 3.0), "zero", air)
    area = 0.030 * strip["geometry.width"]
    node = np.abs(found.values[1])
    current = area * 20.0 * np.expm1(np.maximum(node - 0.8, 0.0) / 0.5)
    charge = np.trapezoid(current, time)
    dry = strip["geometry.thickness"] / (1.0 + 0.0126 * 7.219)
    lost = charge / (2.0 * 96485.33212) / (1800.0 * dry * area)
    assert found.water.water_content[0] - found.water.water_content[-1] == pytest.approx(lost, rel=0.02)
    curling = STRIP.replace(**{"hydration.linear_swelling": 0.01, "hydration.face_difference": 1.0})
    flat = STRIP.replace(**{"hydration.face_difference": 1.0})
    still_air = EnvironmentHistory.of("20 degC, 50 %RH", WaterState(7.219, 20.0))
    bent, straight = (
        changing_outputs(one, time, np.zeros(500), "zero", still_air).values[2] for one in (curling, flat)
    )
    assert np.abs(straight).max() == 0.0
    assert bent[1:].min() < 0.0, "the anode's closed face keeps its water, and the strip bends to the cathode"


def test_a_leak_below_its_threshold_costs_and_changes_nothing() -> None:
    leak = {"current_density": 20.0, "threshold": 1.23, "voltage_scale": 0.5}
    values = dict(STRIP.parameter_values) | {f"leak.exponential.{name}": one for name, one in leak.items()}
    strip, time = Actuator(name="quiet", parameter_values=values), np.arange(500) / 50.0
    found = changing_outputs(strip, time, np.ones(500), "zero", AIR).values
    assert np.array_equal(found, changing_outputs(STRIP, time, np.ones(500), "zero", AIR).values)
    assert np.abs(changing_outputs(strip, time, np.full(500, 3.0), "zero", AIR).values[1]).max() > 1.23
