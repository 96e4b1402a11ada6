"""Parameters that follow the environment, by a law that is defined here."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace

import pytest

from ipmclab import InputError, load_actuator, simulate
from ipmclab.model import actuator_to_text
from ipmclab.model.environment import Environment, EnvironmentLaw

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
