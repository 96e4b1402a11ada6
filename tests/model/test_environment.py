"""Parameters that follow the environment: by the laws of the literature, and by a law that is defined here."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from ipmclab import InputError, load_actuator, simulate
from ipmclab.model import actuator_from_text, actuator_to_text
from ipmclab.model.environment import Environment, EnvironmentLaw, WaterState, in_state, reference, values_in
from ipmclab.model.environment.laws import KINDS
from ipmclab.model.order import Order

ROOM = Environment(temperature=25.0, relative_humidity=50.0)


def arrhenius(stated: float, environment: Environment) -> float:
    """Conduction with an activation energy of 12 kJ/mol, stated at 25 degC."""
    return stated * math.exp(12e3 / 8.314 * (1.0 / (environment.temperature + 273.15) - 1.0 / 298.15))


STRIP = load_actuator("friend-2")
FOLLOWS = replace(STRIP, environment_laws=(EnvironmentLaw("circuit.dc_resistivity", arrhenius),))


def test_without_laws_the_actuator_is_the_same() -> None:
    assert STRIP.at(ROOM) is STRIP


def test_a_law_gives_the_parameter_once() -> None:
    assert FOLLOWS.at(ROOM).parameter_values == STRIP.parameter_values
    warm = FOLLOWS.at(Environment(temperature=45.0, relative_humidity=50.0))
    # exp(12000/8.314 (1/318.15 - 1/298.15)) by hand
    assert warm["circuit.dc_resistivity"] == pytest.approx(0.737623 * STRIP["circuit.dc_resistivity"], rel=1e-5)
    assert warm.at(Environment(temperature=45.0, relative_humidity=50.0)) is warm
    leaked = [simulate(one, "step 1 V", duration=100, rate=10).current[-1] for one in (STRIP, warm)]
    assert leaked[1] > leaked[0]
    assert pickle.loads(pickle.dumps(FOLLOWS)).at(ROOM).parameter_values == STRIP.parameter_values


def test_what_cannot_be_used_is_refused_by_name() -> None:
    with pytest.raises(InputError, match=r"unknown parameter 'circuit\.dc'"):
        replace(STRIP, environment_laws=(EnvironmentLaw("circuit.dc", arrhenius),))
    with pytest.raises(InputError, match="from 0 to 100 percent"):
        Environment(temperature=25.0, relative_humidity=120.0)
    with pytest.raises(InputError, match="a file does not hold the laws"):
        actuator_to_text(FOLLOWS)


EVERY = load_actuator("friend-2+" + "+".join(kind.name for kind in KINDS) + "+hydration.coating")
WARM_AND_WET = WaterState(water_content=12.0, temperature=33.0)


def test_laws_are_parameters_that_stand_in_a_file() -> None:
    again = actuator_from_text(actuator_to_text(EVERY))
    assert again.parameter_values == EVERY.parameter_values
    assert {name.split(".")[1] for name in again.parameter_values if name.startswith("environment.")} == {
        kind.name.removeprefix("environment.") for kind in KINDS
    }
    text = actuator_to_text(STRIP) + (
        '[hydration]\nreference_water_content = 7.219\nreference_temperature = "20 degC"\nsorption = "zawodzinski-H"\n'
        '[[environment.branches]]\nexponent = 1.0\nenergy = "10.5 kJ/mol"\n'
    )
    named = actuator_from_text(text)
    assert named["environment.branches.0.energy"] == 10.5e3
    assert named["environment.branches.1.exponent"] == 0.0, "a branch without a law follows nothing"
    assert named["hydration.sorption.cubic"] == 36.0
    with pytest.raises(InputError, match="no isotherm is called 'zawodzinsky-H'; did you mean 'zawodzinski-H'"):
        actuator_from_text(text.replace("zawodzinski", "zawodzinsky"))
    with pytest.raises(InputError, match="the isotherm falls at"):
        EVERY.replace(**{"hydration.sorption.linear": 5.0})


def test_in_its_state_of_reference_an_actuator_is_what_it_states() -> None:
    there = EVERY.at(reference(EVERY.parameter_values)).parameter_values
    assert dict(there) == {name: value for name, value in EVERY.parameter_values.items() if name in there}
    assert set(there) == set(STRIP.parameter_values)


def test_each_law_is_the_ratio_that_is_printed() -> None:
    found, stated = EVERY.at(WARM_AND_WET), EVERY
    inverse = 1.0 / 306.15 - 1.0 / 293.15
    grows = math.exp(-10.5e3 / 8.314462618 * inverse)
    ratio, thicker = 12.0 / 7.219, (1.0 + 0.0126 * 12.0) / (1.0 + 0.0126 * 7.219)
    humidity = 0.9534344340757175 - 0.8  # a(12): the root of Zawodzinski's cubic by bisection
    softer = 1.013 * humidity + 0.01103 * 13.0 + 0.01077 * 13.0 * humidity
    expected = {
        "circuit.branches.0.resistivity": (7.219 - 0.634) / (12.0 - 0.634) / grows,
        "circuit.branches.1.permittivity": math.sqrt(ratio),
        "circuit.dc_resistivity": 1.0 / grows,
        "circuit.sheet_resistance": 1.0 + 3.9e-3 * 13.0,
        "coupling.gain": ratio,
        "coupling.p1": ratio,
        "coupling.p2": ratio**2,
        "coupling.zero": ratio,
        "beam.modulus": math.exp(-softer),
        "geometry.thickness": thicker,
    }
    for name, factor in expected.items():
        assert found[name] / stated[name] == pytest.approx(factor, rel=1e-7), name
    # Mass of an area: what it was, and the water that came.
    dry = stated["geometry.thickness"] / (1.0 + 0.0126 * 7.219)
    came = 1800.0 * 18.015e-3 * (12.0 - 7.219) * dry
    before = stated["beam.density"] * stated["geometry.thickness"]
    assert found["beam.density"] * found["geometry.thickness"] == pytest.approx(before + came, rel=1e-12)


def test_the_conductivity_of_the_ions_is_that_of_the_table() -> None:
    """Springer's conductivity, (0.5139 lambda - 0.326) exp(1268 K (1/303 K - 1/T)), as ratios to 80 %RH at 25 degC."""
    ions = load_actuator("friend-2+environment.branches").replace(
        **{
            "hydration.reference_temperature": 25.0,
            "hydration.percolation": 0.326 / 0.5139,
            "environment.branches.0.exponent": 1.0,
            "environment.branches.0.energy": 1268.0 * 8.314462618,
        }
    )
    table = {  # S/m at 25, 30 and 60 degC
        2.7715: (1.025998, 1.100550, 1.603943),
        3.4855: (1.368775, 1.468236, 2.139807),
        5.3315: (2.255004, 2.418861, 3.525250),
        7.219: (3.161157, 3.390858, 4.941839),
        10.0375: (4.514264, 4.842288, 7.057153),
        14.003: (6.418025, 6.884382, 10.033303),
    }
    for content, row in table.items():
        for temperature, conductivity in zip((25.0, 30.0, 60.0), row, strict=True):
            there = values_in(ions.parameter_values, WaterState(content, temperature))
            ratio = ions["circuit.branches.0.resistivity"] / there["circuit.branches.0.resistivity"]
            assert 3.161157 * ratio == pytest.approx(conductivity, rel=1e-6)


def test_derivatives_are_those_of_differences() -> None:
    stated, moved = dict(EVERY.parameter_values), in_state(EVERY.parameter_values, WARM_AND_WET)
    assert moved.values == pytest.approx(values_in(stated, WARM_AND_WET), rel=1e-14)
    sizes = np.abs(list(moved.values.values()))
    for column, name in enumerate(moved.parameters):
        step = 1e-5 * (abs(stated[name]) or 1e-2)
        ends = [values_in({**stated, name: stated[name] + sign * step}, WARM_AND_WET) for sign in (-1.0, 1.0)]
        slope = (np.array(list(ends[1].values())) - list(ends[0].values())) / (2.0 * step)
        bound = 1e-8 * sizes / (abs(stated[name]) or 1.0) + 1e-300
        assert np.all(np.abs(slope - moved.jacobian[:, column]) <= bound), name
    for column, state in enumerate((lambda move: (12.0 + move, 33.0), lambda move: (12.0, 33.0 + move))):
        step = 1e-4
        ends = [values_in(stated, WaterState(*state(sign * step))) for sign in (-1.0, 1.0)]
        slope = (np.array(list(ends[1].values())) - list(ends[0].values())) / (2.0 * step)
        assert np.all(np.abs(slope - moved.by_state[:, column]) <= 1e-9 * sizes)


def test_water_and_saturated_air_are_two_environments() -> None:
    wet, saturated = (EVERY.at(Environment.parse(f"20 degC, {air}")) for air in ("in water", "100 %RH"))
    assert wet["coupling.gain"] / saturated["coupling.gain"] == pytest.approx(22.0 / 14.003)
    with pytest.raises(InputError, match=r"a membrane conducts above 0\.634"):
        EVERY.at(WaterState(0.5, 20.0))
    for text in ("20 degC", "80 %RH, 20 degC", "20 degC, 80"):
        with pytest.raises(InputError):
            Environment.parse(text)


@pytest.mark.parametrize("text", ["295 degC", "500 degC", "-60 degC"])
def test_a_temperature_that_no_wet_strip_has_is_refused(text: str) -> None:
    """A slip of the pen, such as kelvin, was simulated without a word."""
    with pytest.raises(InputError, match="is no temperature of a strip that holds water; give -40 to 150 degC"):
        Environment.parse(f"{text}, 70 %RH")


def test_branches_keep_their_laws_when_they_change_places() -> None:
    values = {**EVERY.parameter_values, "circuit.branches.0.resistivity": 1e3}
    assert Order(values)("environment.branches.0.energy") == "environment.branches.1.energy"
