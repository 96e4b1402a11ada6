"""The environment of a run: what stands in it, and what is known of the water of its strip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ipmclab.model.environment.conditions import Environment, WaterState
from ipmclab.model.environment.findings import NEAR_DEW, condensation, ignored
from ipmclab.model.environment.history import EnvironmentHistory
from ipmclab.model.environment.hydration import LIQUID, equilibrium
from ipmclab.model.environment.sorption import activity, saturation_pressure
from ipmclab.model.environment.transport import WaterCourse, water_course
from ipmclab.run import Finding, Run

AnyEnvironment = Environment | WaterState | EnvironmentHistory | str


def environment_of(run: Run) -> Environment | None:
    """The mean environment that a run tells; None where it does not tell both temperature and humidity.

    Examples
    --------
    >>> from ipmclab.run import RunMetadata
    >>> told = RunMetadata(temperature=20.0, relative_humidity=80.0)
    >>> environment_of(Run.from_arrays(time=[0.0, 1.0], voltage=[0.0, 0.0], metadata=told))
    Environment(temperature=20.0, relative_humidity=80.0, in_water=False)
    """
    about = run.metadata
    found = []
    for told, read in ((about.temperature, run.temperature), (about.relative_humidity, run.relative_humidity)):
        known = read[np.isfinite(read)] if read is not None else np.zeros(0)
        found.append(told if told is not None else float(known.mean()) if len(known) else None)
    temperature, humidity = found
    if temperature is None or humidity is None:
        return None
    return Environment(temperature, min(max(humidity, 0.0), 100.0))


def water_in_run(values: Mapping[str, float], run: Run) -> WaterState | None:
    """The water of a strip as its run begins, and how it is known.

    It is **measured** where the run tells a content, **computed** where it tells how long the strip was out of water
    (it dried in the air of the run), else **assumed** in equilibrium with that air; None where the run tells no air.

    Parameters
    ----------
    values : mapping of dotted name to float [SI]
        Of an actuator with a table ``[hydration]``.
    run : Run

    Examples
    --------
    >>> from ipmclab.model.environment.hydration import STANDARD
    >>> from ipmclab.run import RunMetadata
    >>> told = RunMetadata(temperature=20.0, relative_humidity=50.0, minutes_out_of_water=10.0)
    >>> run = Run.from_arrays(time=[0.0, 1.0], voltage=[0.0, 0.0], metadata=told)
    >>> found = water_in_run({**STANDARD, "geometry.thickness": 0.2e-3}, run)
    >>> round(found.water_content, 2), found.origin
    (10.36, 'computed')
    """
    air, about = environment_of(run), run.metadata
    if air is None:
        return None
    if about.water_content is not None:
        origin = about.water_content_origin or "measured"
        return WaterState(about.water_content, air.temperature, air.relative_humidity, origin)
    if about.minutes_out_of_water is None:
        return equilibrium(values, air)
    seconds = 60.0 * about.minutes_out_of_water
    wet = WaterState(values[LIQUID], air.temperature, 100.0)
    if seconds == 0.0:
        return replace(wet, relative_humidity=air.relative_humidity, origin="computed")
    dried = water_course(values, EnvironmentHistory.of(air), seconds, start=wet)
    return dried.state(seconds, air.relative_humidity)


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
