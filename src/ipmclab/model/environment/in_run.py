"""The environment of a simulated run: what is in it, and what is to be said of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.actuator import Actuator
from ipmclab.model.environment.conditions import Environment, WaterState
from ipmclab.model.environment.findings import NEAR_DEW, condensation, ignored
from ipmclab.model.environment.history import EnvironmentHistory
from ipmclab.model.environment.hydration import equilibrium
from ipmclab.model.environment.sorption import activity, saturation_pressure
from ipmclab.model.environment.transport import WaterCourse
from ipmclab.run import Finding

FloatArray = npt.NDArray[np.float64]

AnyEnvironment = Environment | WaterState | EnvironmentHistory | str

_AIR: Final = ("temperature", "relative_humidity")


class Surroundings(NamedTuple):
    """What a run says of the environment of its strip.

    Parameters
    ----------
    readings : mapping of channel, or "time_environment", to float array
        The air where it changes.
    about : mapping of name to value
        What ``metadata`` has of it.
    findings : sequence of Finding
    """

    readings: Mapping[str, Any]
    about: Mapping[str, Any]
    findings: Sequence[Finding]


def surroundings(
    actuator: Actuator,
    given: Environment | WaterState | EnvironmentHistory,
    begin: float,
    end: float,
    water: WaterCourse | None,
) -> Surroundings:
    """What a simulated run says of its environment: the air at its times, and the water of the strip at its begin.

    Parameters
    ----------
    actuator : Actuator
        As it was given, not as it is in that environment.
    given : Environment, WaterState or EnvironmentHistory
    begin, end : float [s]
        Of the rows.
    water : WaterCourse, optional
        Through which its strip went.
    """
    if not isinstance(given, EnvironmentHistory):
        return actuator.keep(("surroundings", given), lambda: _standing(actuator, given))
    went = () if water is None else (water.water_content.tobytes(), water.temperature.tobytes())
    key = ("surroundings", begin, end, given.key, *(hash(one) for one in went))
    return actuator.keep(key, lambda: _changing(actuator, given, begin, end, water))


def _standing(actuator: Actuator, given: Environment | WaterState) -> Surroundings:
    values, said = actuator.parameter_values, [] if _has_laws(actuator) else [ignored(_words(given))]
    if isinstance(given, Environment):
        state = equilibrium(values, given) if actuator.structure.hydration else None
        air = given.temperature, given.relative_humidity
        if _has_laws(actuator):
            said += filter(None, [condensation(given.temperature, given)])
        return Surroundings({}, _about(*air, state), said)
    humidity = _humidity(values, given) if actuator.structure.hydration else given.relative_humidity
    return Surroundings({}, _about(given.temperature, humidity, given), said)


def _changing(
    actuator: Actuator, given: EnvironmentHistory, begin: float, end: float, water: WaterCourse | None
) -> Surroundings:
    inside = given.time[(given.time > begin) & (given.time < end)]
    time = np.concatenate([[begin], inside, [end]])
    air = {name: np.interp(time, given.time, getattr(given, name)) for name in _AIR}
    means = [float(np.trapezoid(one, time) / (end - begin)) for one in air.values()]
    said = filter(None, [ignored(_words(given)) if not _has_laws(actuator) else _dew(given, begin, end, water)])
    state = None if water is None else water.state(begin)
    return Surroundings({"time_environment": time, **air}, _about(means[0], means[1], state), tuple(said))


def _about(temperature: float, relative_humidity: float | None, state: WaterState | None) -> dict[str, Any]:
    air = {"temperature": temperature, "relative_humidity": relative_humidity}
    if state is None:
        return air
    return {**air, "water_content": state.water_content, "water_content_origin": state.origin}


def _has_laws(actuator: Actuator) -> bool:
    return bool(actuator.structure.environment or actuator.environment_laws)


def _dew(given: EnvironmentHistory, begin: float, end: float, water: WaterCourse | None) -> Finding | None:
    """Where water first condenses on the strip, if it does."""
    if water is None:
        return None
    times = np.unique(np.concatenate([np.linspace(begin, end, 65), given.time]))
    strip = water.temperatures(times)
    air, humidity = (np.interp(times, given.time, one) for one in (given.temperature, given.relative_humidity))
    wet = np.flatnonzero(saturation_pressure(strip - NEAR_DEW) < 0.01 * humidity * saturation_pressure(air))
    if not len(wet):
        return None
    return condensation(float(strip[wet[0]]), Environment(float(air[wet[0]]), float(humidity[wet[0]])))


def _humidity(values: Mapping[str, float], state: WaterState) -> float:
    if state.relative_humidity is not None:
        return state.relative_humidity
    return 100.0 * float(activity(values, state.water_content))


def _words(given: Environment | WaterState | EnvironmentHistory) -> str:
    if isinstance(given, Environment):
        return str(given)
    if isinstance(given, WaterState):
        return f"a water content of {given.water_content:g}"
    return "every environment of this history"
