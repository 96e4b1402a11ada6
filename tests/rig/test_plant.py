"""The plant against the model's own simulation, a closed form, the tables of IEC 60751 and the words of its hands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import InputError, load_actuator, simulate
from ipmclab.model import Actuator, with_stages
from ipmclab.model.environment import Environment
from ipmclab.model.environment.charge import charges
from ipmclab.model.environment.history import EnvironmentHistory
from ipmclab.model.environment.hydration import STANDARD, equilibrium
from ipmclab.model.environment.transport import curl_displacement, water_course
from ipmclab.rig.channels import THESIS_RIG, VirtualStrip
from ipmclab.rig.exact import TICK
from ipmclab.rig.operator_actions import WORDS, carry_out
from ipmclab.rig.plant import PRELOAD_TIME, StripPlant
from ipmclab.rig.thermometer import platinum_resistance, platinum_temperature

SEED = 20261121
OUTPUT = "cDAQ1Mod2/ao0"
SHUNT, LASER, CELL, VOLTAGE, HUMIDITY = (f"cDAQ1Mod1/ai{number}" for number in range(5))
AIR, SURFACE = "cDAQ1Mod3/ai1", "cDAQ1Mod3/ai0"
QUIET = replace(THESIS_RIG, channels=tuple(replace(one, sensor_noise=0.0) for one in THESIS_RIG.channels))


@pytest.fixture(scope="module")
def strip() -> Actuator:
    return load_actuator("friend-2")


def advance(plant: StripPlant, times: np.ndarray, volts: np.ndarray) -> dict[str, np.ndarray]:
    return plant.advance(times, {OUTPUT: volts})


@pytest.mark.parametrize("chunk", [1, 7, 2000])
def test_blocks_of_any_length_are_the_simulation(strip: Actuator, chunk: int) -> None:
    plant = StripPlant(QUIET, strip)
    rows = np.arange(2000)
    volts = np.sign(np.sin(2 * np.pi * rows / 170.0)) * (rows > 0)
    parts = [advance(plant, rows[k : k + chunk] / 50.0, volts[k : k + chunk]) for k in range(0, len(rows), chunk)]
    in_series = strip.replace(**{"circuit.contact_resistance": 1.0})
    exact = simulate(in_series, volts, duration=40.0, rate=50.0, hold="zero-before")
    read = {name: np.concatenate([part[name] for part in parts]) for name in (SHUNT, LASER, CELL, VOLTAGE)}
    assert read[SHUNT] == pytest.approx(exact.current, rel=1e-9, abs=1e-12)
    assert read[VOLTAGE].tolist() == volts.tolist()
    assert THESIS_RIG["force"].to_quantity(read[CELL]) - 4.48e-3 == pytest.approx(exact.force, rel=1e-8, abs=1e-12)
    moved = THESIS_RIG["displacement"].to_quantity(read[LASER]) - 12.3e-3
    assert moved == pytest.approx(exact.displacement, rel=1e-6, abs=1e-12)


def test_calls_at_any_time_do_not_change_what_blocks_read(strip: Actuator) -> None:
    """A rate that changes, calls between the rows of a block, two calls at one time: the strip is the same."""
    rng = np.random.default_rng(SEED)
    edges = np.cumsum(rng.exponential(0.05, 300))
    volts = rng.uniform(-1, 1, 300)

    def output(times: np.ndarray) -> np.ndarray:
        return volts[np.searchsorted(edges, times, side="left").clip(0, 299)]  # volts[k] since edge k-1

    coarse, fine = StripPlant(QUIET, strip), StripPlant(QUIET, strip)
    expected = advance(coarse, edges, volts)
    between = np.sort(np.concatenate([edges, edges, rng.uniform(0, edges[-1], 2000), np.arange(1, 60e3) / 60e3]))
    between = between[between <= edges[-1]]
    at_edges = np.searchsorted(between, edges)
    parts, start = [], 0
    for length in rng.integers(1, 4000, 1000):
        times = between[start : start + length]
        parts.append(advance(fine, times, output(times))[SHUNT])
        start += length
    assert np.concatenate(parts)[at_edges] == pytest.approx(expected[SHUNT], rel=1e-7, abs=1e-11)


def test_a_dummy_load_is_a_resistor_and_a_capacitor() -> None:
    rig = replace(QUIET, virtual=VirtualStrip(load="dummy"), source_resistance=0.5)
    plant = StripPlant(rig)
    times = np.arange(1, 500) / 100.0
    read = advance(plant, times, np.full(499, 2.0))
    current = 2.0 / 11.5 * np.exp(-times / (11.5 * 0.1))
    assert read[SHUNT] == pytest.approx(current, rel=1e-9)
    assert read[VOLTAGE] == pytest.approx(2.0 - 0.5 * current, rel=1e-9)
    assert set(read[LASER]) == {1.5}, "the laser sees no strip"
    assert not read[CELL].any(), "nothing touches the load cell"


def test_the_air_follows_the_chamber(strip: Actuator) -> None:
    plant = StripPlant(replace(QUIET, virtual=VirtualStrip(temperature=20.0, relative_humidity=40.0)), strip)
    before = plant.advance([10.0], {})
    assert platinum_temperature(before[AIR]) == pytest.approx([20.0])
    assert before[HUMIDITY] == pytest.approx([4.0])
    plant.set_chamber(temperature=40.0, relative_humidity=90.0)
    after = plant.advance([10.0 + 300.0, 10.0 + 3000.0], {})
    assert platinum_temperature(after[AIR]) == pytest.approx([20.0 + 20.0 * (1 - np.exp(-1)), 40.0], abs=2e-3)
    assert after[HUMIDITY] == pytest.approx([4.0 + 5.0 * (1 - np.exp(-1)), 9.0], abs=1e-3)
    with pytest.raises(InputError, match="temperature: the chamber cannot be set to 300"):
        plant.set_chamber(temperature=300.0)


def test_the_thermometer_is_that_of_the_standard() -> None:
    # IEC 60751, table of a Pt100.
    table = {-200.0: 18.52, -100.0: 60.26, -20.0: 92.16, 0.0: 100.0, 25.0: 109.73, 100.0: 138.51, 400.0: 247.09}
    assert platinum_resistance(list(table)) == pytest.approx(list(table.values()), abs=0.005)
    assert platinum_temperature(platinum_resistance(list(table))) == pytest.approx(list(table), abs=1e-6)
    assert platinum_resistance([25.0], 1000.0) == pytest.approx([1097.35], abs=0.005)


def test_four_probes_read_the_sheet_resistance(strip: Actuator) -> None:
    probe = THESIS_RIG.four_probe
    assert probe is not None
    resistance = StripPlant(QUIET, strip).advance([1.0], {})[SURFACE][0]
    assert resistance == pytest.approx(4.0 / 3.0 * 10.0 / 5.0)  # 10 mm of a strip 5 mm wide are two squares
    assert probe.sheet_resistance(resistance, strip["geometry.width"]) == pytest.approx(4.0 / 3.0)


def test_the_preload_falls_slowly(strip: Actuator) -> None:
    plant = StripPlant(replace(QUIET, virtual=VirtualStrip(preload_drift=1e-3)), strip)
    told = THESIS_RIG["force"].to_quantity(plant.advance([1e-6, PRELOAD_TIME, 1e5], {})[CELL])
    assert told == pytest.approx([4.48e-3, 4.48e-3 - 1e-3 * (1 - np.exp(-1)), 3.48e-3], abs=1e-8)


def test_a_strip_that_dries_curls_however_it_is_read(strip: Actuator) -> None:
    """By the antisymmetric mode of its water; in equilibrium with its air it does not move."""
    water = {**STANDARD, "hydration.linear_swelling": 0.01, "hydration.face_difference": -0.1}
    drying = replace(strip, parameter_values={**strip.parameter_values, **water}, fit_table=None)
    times = np.linspace(1.0, 120.0, 120)

    def read(*blocks: np.ndarray, hydrated: bool) -> np.ndarray:
        plant = StripPlant(replace(QUIET, virtual=VirtualStrip(hydrated=hydrated)), drying)
        return np.concatenate([advance(plant, block, np.zeros(len(block)))[LASER] for block in blocks])

    volts = read(times, hydrated=True)
    moved = THESIS_RIG["displacement"].to_quantity(volts - read(times, hydrated=False))
    course = water_course(
        drying.parameter_values,
        EnvironmentHistory.of("22 degC, 45 %RH"),
        120.0,
        start=equilibrium(drying.parameter_values, Environment(22.0, 100.0, in_water=True)),
    )
    expected = curl_displacement(drying.parameter_values, course.gradients(times))
    assert np.ptp(moved) > 0.5e-3
    assert np.ptp(moved - expected) < 0.01 * np.ptp(expected)
    assert read(*np.split(times, [7, 40, 90]), hydrated=True) == pytest.approx(volts, abs=1e-3)


def test_hands_do_what_they_say(strip: Actuator) -> None:
    plant = StripPlant(QUIET, strip)
    step = np.array([1.0])

    def read(time: float) -> dict[str, float]:
        return {terminal: float(values[0]) for terminal, values in advance(plant, np.array([time]), step).items()}

    either = read(1.0)
    carry_out(plant, "tip clear")
    assert read(1.0)[CELL] == 0.0
    assert read(1.0)[LASER] == either[LASER]
    carry_out(plant, "tip  on cell")
    assert read(1.0)[CELL] == either[CELL]
    assert read(1.0)[LASER] == pytest.approx(2.0 + 8.0 * 12.3 / 25.0)
    carry_out(plant, "laser blocked")
    assert read(1.0)[LASER] == 1.5
    carry_out(plant, "contact open")
    assert abs(read(1.0)[SHUNT]) < 1e-6
    carry_out(plant, "contact bad")
    assert 0.1 < read(1.0)[SHUNT] / either[SHUNT] < 0.4  # 67 ohm in place of 17
    carry_out(plant, "contact good")
    assert read(1.0)[SHUNT] == pytest.approx(either[SHUNT], rel=1e-12), "what was charged stays so"
    carry_out(plant, "rest")
    peak = simulate(strip, "step 1 V", duration=1.0, rate=50.0).current[0]
    assert read(1.0)[SHUNT] == pytest.approx(1.0 / (1.0 / peak + 1.0)), "it was discharged"
    for words in WORDS:
        carry_out(plant, words)
    with pytest.raises(InputError, match=r"unknown words 'tip cleer'; did you mean 'tip clear'\?"):
        carry_out(plant, "tip cleer\n")
    with pytest.raises(InputError, match="humidity: '60' has no unit"):
        carry_out(plant, "humidity 60")


def test_time_does_not_go_back(strip: Actuator) -> None:
    plant = StripPlant(QUIET, strip)
    plant.advance([2.0], {})
    with pytest.raises(ValueError, match="the time goes back to 1 s, from 2 s"):
        plant.advance([1.0], {})


def test_a_strip_that_bends_far_is_lost_by_the_laser_as_in_the_simulation() -> None:
    strip = load_actuator("friend-2+laser")
    strip = strip.replace(**{"coupling.gain": 10.0 * strip["coupling.gain"], "laser.range": 5e-3})
    plant = StripPlant(QUIET, strip)
    volts = np.where(np.arange(1500) > 20, 1.2, 0.0)
    read = advance(plant, np.arange(1500) / 50.0, volts)[LASER]
    in_series = strip.replace(**{"circuit.contact_resistance": 1.0})
    exact = simulate(in_series, volts, duration=30.0, rate=50.0, hold="zero-before").displacement
    assert exact is not None
    kept = np.isfinite(exact)
    assert 50 < kept.sum() < 1400
    laser = THESIS_RIG["displacement"]
    np.testing.assert_allclose(laser.to_quantity(read[kept]) - laser.rest, exact[kept], rtol=1e-6, atol=1e-12)
    assert np.all(read[~kept] == laser.lost)


def test_a_strip_with_laws_follows_the_air_around_it() -> None:
    """At first it is that of the room's air; hours after the chamber was set it is that of the chamber's."""
    wet = with_stages(load_actuator("friend-2"), "environment.coupling_gain", "environment.permittivity")
    plant = StripPlant(QUIET, wet)
    room, volts = QUIET.virtual, np.where(np.arange(500) > 0, 1.0, 0.0)

    def moved(begin: float) -> np.ndarray:
        read = advance(plant, begin + np.arange(500) / 50.0, volts)[LASER]
        return np.asarray(THESIS_RIG["displacement"].to_quantity(read) - 12.3e-3)

    def expected(humidity: float) -> np.ndarray:
        there = wet.at(Environment(room.temperature, humidity)).replace(**{"circuit.contact_resistance": 1.0})
        found = simulate(there, volts, duration=10.0, rate=50.0, hold="zero-before").displacement
        assert found is not None
        return found

    np.testing.assert_allclose(moved(0.0), expected(room.relative_humidity), rtol=1e-6, atol=1e-12)
    plant.set_chamber(relative_humidity=80.0)
    for at in np.arange(600.0, 8 * 3600.0, 600.0):
        plant.advance([at], {})
    plant.rest()
    np.testing.assert_allclose(moved(8 * 3600.0), expected(80.0), rtol=5e-3, atol=1e-9)
    assert expected(80.0)[-1] > 1.2 * expected(room.relative_humidity)[-1]


def test_charge_goes_on_where_a_strip_becomes_wetter() -> None:
    wet = with_stages(load_actuator("friend-2"), "environment.permittivity")
    plant = StripPlant(QUIET, wet)
    plant.advance([0.0, 40.0], {OUTPUT: np.array([1.0, 1.0])})
    water, names, before = plant._water, plant._strip._system.states, plant._strip.state.copy()
    assert water is not None
    earlier = water.strip.parameter_values
    plant.set_chamber(relative_humidity=90.0)
    plant._now += round(3600.0 / TICK)  # an hour in which nothing flows
    plant._follow_air()
    later = water.strip.parameter_values
    assert later["circuit.branches.1.permittivity"] > 1.05 * earlier["circuit.branches.1.permittivity"]
    np.testing.assert_allclose(plant._strip.state * charges(names, later), before * charges(names, earlier), rtol=1e-12)
