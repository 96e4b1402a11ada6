"""The environment of a simulated run: what stands in it, and what is to be said of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ipmclab.model.environment.conditions import Environment, WaterState
from ipmclab.model.environment.findings import NEAR_DEW, condensation, ignored
from ipmclab.model.environment.history import EnvironmentHistory
from ipmclab.model.environment.hydration import equilibrium
from ipmclab.model.environment.sorption import activity, saturation_pressure
from ipmclab.model.environment.transport import WaterCourse
from ipmclab.run import Finding, Run

AnyEnvironment = Environment | WaterState | EnvironmentHistory | str


def with_environment(
    run: Run,
    given: Environment | WaterState | EnvironmentHistory,
    values: Mapping[str, float],
    water: WaterCourse | None,
) -> Run:
    """A simulated run with its environment: the air at its times, and the water of the strip at its begin.

    Parameters
    ----------
    run : Run
    given : Environment, WaterState or EnvironmentHistory
    values : mapping of dotted name to float [SI]
        Of the actuator, with ``hydration.`` where it is known.
    water : WaterCourse, optional
        Through which it went.
    """
    begin, end = float(run.time[0]), float(run.time[-1])
    known = any(name.startswith("hydration.") for name in values)
    state: WaterState | None = None
    means: list[float | None]
    if isinstance(given, EnvironmentHistory):
        inside = given.time[(given.time > begin) & (given.time < end)]
        time = np.concatenate([[begin], inside, [end]])
        air = [given.at(float(one)) for one in time]
        temperature, humidity = (np.array([getattr(one, name) for one in air]) for name in _AIR)
        run = replace(run, time_environment=time, temperature=temperature, relative_humidity=humidity)
        means = [float(np.trapezoid(one, time) / (end - begin)) for one in (temperature, humidity)]
        state = water.state(begin) if water is not None else None
    else:
        if isinstance(given, Environment):
            state = equilibrium(values, given) if known else None
            means = [given.temperature, given.relative_humidity]
        else:
            state = given
            means = [given.temperature, _humidity(values, given) if known else given.relative_humidity]
    about = replace(run.metadata, temperature=means[0], relative_humidity=means[1])
    if state is not None:
        about = replace(about, water_content=state.water_content, water_content_origin=state.origin)
    return replace(run, metadata=about)


def findings_in(
    run: Run, given: Environment | WaterState | EnvironmentHistory, known: bool, water: WaterCourse | None
) -> Sequence[Finding]:
    """What is to be said of the environment of a simulated run.

    Parameters
    ----------
    run : Run
    given : Environment, WaterState or EnvironmentHistory
    known : bool
        Whether the actuator has laws.
    water : WaterCourse, optional
        Through which its strip went.
    """
    if not known:
        return (ignored(_words(given)),)
    if isinstance(given, Environment):
        return tuple(filter(None, [condensation(given.temperature, given)]))
    if water is None or not isinstance(given, EnvironmentHistory):
        return ()
    times = np.unique(np.concatenate([np.linspace(run.time[0], run.time[-1], 65), given.time]))
    strip = water.temperatures(times)
    air, humidity = (np.interp(times, given.time, one) for one in (given.temperature, given.relative_humidity))
    wet = np.flatnonzero(saturation_pressure(strip - NEAR_DEW) < 0.01 * humidity * saturation_pressure(air))
    if not len(wet):
        return ()
    said = condensation(float(strip[wet[0]]), Environment(float(air[wet[0]]), float(humidity[wet[0]])))
    return () if said is None else (said,)


_AIR = ("temperature", "relative_humidity")


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
