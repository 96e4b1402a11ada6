"""In which state a strip was in each run, and how its water content is known."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from ipmclab.errors import InputError
from ipmclab.model import Actuator
from ipmclab.model.environment import Environment, EnvironmentHistory, WaterState, equilibrium
from ipmclab.model.environment.hydration import FILM, LIQUID
from ipmclab.model.environment.sorption import slope
from ipmclab.run import Run
from ipmclab.strip_state.dose import recorded
from ipmclab.strip_state.run_state import RunState

HUMIDITY_ERROR: Final = 2.0
"""Standard uncertainty of a relative humidity [percent] where a run states none: as good sensors have."""

_MASS_ERROR: Final = 1e-7
"""Standard uncertainty of a mass [kg] where a run states none: a blotted strip on a laboratory balance."""

_SITES_ERROR: Final = 0.05
"""Of the ionic groups by the thickness of the membrane before it was plated: relative standard uncertainty."""

_PLATED_ERROR: Final = 0.25
"""Likewise by the plated thickness, of which the metal takes a part."""

_FILM_ERROR: Final = 0.3  # of its logarithm, where the actuator states none: 3 to 10 mm/s in still air
_LIQUID_ERROR: Final = 0.1  # of the content in liquid water, where the actuator states none


def air_of(run: Run) -> tuple[float | None, float | None]:
    """Temperature [degC] and relative humidity [percent] of a run: as it states them, else the mean of what was read.

    Examples
    --------
    >>> air_of(Run.from_arrays(time=[0.0, 1.0], voltage=[1.0, 1.0], temperature=[20.0, 21.0]))
    (20.5, None)
    """
    stated, read = (run.metadata.temperature, run.metadata.relative_humidity), (run.temperature, run.relative_humidity)
    warm, wet = (
        float(np.nanmean(values)) if known is None and values is not None and np.isfinite(values).any() else known
        for known, values in zip(stated, read, strict=True)
    )
    return warm, wet


def says_environment(run: Run) -> bool:
    """Whether a run says its temperature and its humidity."""
    return None not in air_of(run)


def states_of(actuator: Actuator, runs: Sequence[Run], labels: Sequence[str]) -> list[RunState]:
    """The state of a strip in each of some runs, each from what it says and from the one before it.

    Parameters
    ----------
    actuator : Actuator
        With a table ``[hydration]``.
    runs : sequence of Run
    labels : sequence of str
        For messages.

    Raises
    ------
    InputError
        A run that does not say its temperature and humidity.
    """
    times = [recorded(run) for run in runs]
    known = not any(math.isnan(one) for one in times)
    order = sorted(range(len(runs)), key=times.__getitem__) if known else range(len(runs))
    found: dict[int, RunState] = {}
    before: tuple[Run, RunState] | None = None
    for place in order:
        found[place] = state_of(actuator, runs[place], label=labels[place], before=before if known else None)
        before = runs[place], found[place]
    return [found[place] for place in range(len(runs))]


def state_of(actuator: Actuator, run: Run, *, label: str, before: tuple[Run, RunState] | None = None) -> RunState:
    """The water content and the temperature of a strip in a run.

    A simulated run knows its water content. It is measured where the run states the mass of the strip and the sample
    its dry mass. It is computed where it is known where the strip came from: from liquid water
    (``minutes_out_of_water``), or from the run before (``minutes_in_environment``), whichever was later. Else it is
    assumed to be that of equilibrium.

    Parameters
    ----------
    actuator : Actuator
        With a table ``[hydration]``.
    run : Run
    label : str
        For messages.
    before : pair of Run and RunState, optional
        The run before it, of the same strip.

    Raises
    ------
    InputError
        The run does not say its temperature and humidity, or its strip weighs less than when dry.

    Examples
    --------
    >>> from ipmclab import RunMetadata, load_actuator
    >>> about = RunMetadata(temperature=20.0, relative_humidity=50.0, minutes_out_of_water=5.0)
    >>> run = Run.from_arrays(time=[0.0, 1.0], voltage=[1.0, 1.0], metadata=about)
    >>> state = state_of(load_actuator("friend-2+environment.coupling_gain"), run, label="run")
    >>> state.how, round(state.water_content, 1)
    ('computed', 18.7)
    """
    about = run.metadata
    temperature, humidity = air_of(run)
    if temperature is None or humidity is None:
        raise InputError(
            "parameters follow the environment, and this run does not say its temperature and humidity",
            code="no-environment",
            where=label,
            repair="give the run its temperature and relative_humidity, or leave the laws out of the actuator",
        )
    humidity = min(humidity, 100.0)  # a wet sensor reads a little more
    values, air = actuator.parameter_values, Environment(temperature, humidity)
    # A simulated strip is asked in an environment that is known.
    usual = 0.0 if about.origin == "simulated" else HUMIDITY_ERROR
    error = about.uncertainties.get("relative_humidity", usual)
    how = about.water_content_origin or "assumed"
    if about.water_content is not None and (about.origin == "simulated" or how != "assumed"):
        uncertainty = about.uncertainties.get("water_content", 0.0)
        return RunState(about.water_content, uncertainty, how, temperature, humidity)
    weighed = _weighed(actuator, run, label)
    if weighed is not None:
        return RunState(*weighed[:2], "measured", temperature, humidity, shared_uncertainty=weighed[2])
    start = _start(actuator, run, before, temperature)
    if start is not None:
        water, uncertainty = _computed(actuator, start, air, error)
        return RunState(water, uncertainty, "computed", temperature, humidity)
    uncertainty = float(slope(values, humidity / 100.0)) * error / 100.0
    return RunState(equilibrium(values, air).water_content, uncertainty, "assumed", temperature, humidity, error)


def _weighed(actuator: Actuator, run: Run, label: str) -> tuple[float, float, float] | None:
    """The water content by mass, its standard uncertainty, and the part of that which all weighed runs share.

    None where nothing was weighed.
    """
    from ipmclab.model.environment.transport import content_by_mass

    sample = run.metadata.sample or actuator.sample
    wet, dry = run.metadata.mass, None if sample is None else sample.dry_mass
    if wet is None or dry is None:
        return None
    if not wet > dry:
        raise InputError(
            f"the strip weighs {1e6 * wet:g} mg in this run, and {1e6 * dry:g} mg when dry",
            code="bad-mass",
            where=label,
            repair="correct the mass of the run or the dry_mass of its sample, or leave one of them out",
        )
    values = actuator.parameter_values
    area = values["geometry.width"] * (values["geometry.free_length"] + values["geometry.clamped_length"])
    stated = [one.nominal_membrane_thickness for one in (sample, actuator.sample) if one is not None]
    thickness = next((one for one in stated if one is not None), None)  # metal has no ionic groups
    water = content_by_mass(values, wet, dry, area, thickness).water_content
    of_mass = run.metadata.uncertainties.get("mass", _MASS_ERROR) / (wet - dry)
    of_sites = _PLATED_ERROR if thickness is None else _SITES_ERROR
    return water, water * math.hypot(of_mass, of_sites), water * of_sites


def _start(
    actuator: Actuator, run: Run, before: tuple[Run, RunState] | None, temperature: float
) -> tuple[WaterState, float, float] | None:
    """A state that is known, its standard uncertainty, and for how long [s] the strip was in this air since.

    Of liquid water and the run before, the later one is the start.
    """
    about, values = run.metadata, actuator.parameter_values
    minutes, out = about.minutes_in_environment, about.minutes_out_of_water
    if before is not None and minutes is not None and _strip(before[0]) == _strip(run):
        then, since = before[1], recorded(run) - recorded(before[0])
        if since < float(before[0].time[-1] - before[0].time[0]):  # a simulated bench that does not wait for the clock
            since = 60.0 * minutes
        dry = out is None or 60.0 * out >= since
        if dry and then.water_content is not None and then.temperature is not None:
            state = WaterState(then.water_content, then.temperature)
            return state, then.standard_uncertainty, min(60.0 * minutes, since)
    if out is not None:
        error = actuator.standard_uncertainties.get(LIQUID, _LIQUID_ERROR * values[LIQUID])
        return WaterState(values[LIQUID], temperature), error, 60.0 * out
    return None


def _strip(run: Run) -> str | None:
    return None if run.metadata.sample is None else run.metadata.sample.id


def _computed(
    actuator: Actuator, start: tuple[WaterState, float, float], air: Environment, error: float
) -> tuple[float, float]:
    """The water content after a while in some air, with what the start, the humidity and the film leave open."""
    state, of_start, seconds = start
    values = dict(actuator.parameter_values)
    relative = actuator.standard_uncertainties.get(FILM, _FILM_ERROR * values[FILM]) / values[FILM]
    wetter = Environment(air.temperature, min(air.relative_humidity + error, 100.0))
    drier = Environment(air.temperature, max(air.relative_humidity - error, 0.0))
    more = WaterState(state.water_content + of_start, state.temperature)
    middle = water_after(values, state, air, seconds)
    parts = (
        water_after(values, more, air, seconds) - middle,
        0.5 * (water_after(values, state, wetter, seconds) - water_after(values, state, drier, seconds)),
        water_after({**values, FILM: values[FILM] * (1.0 + relative)}, state, air, seconds) - middle,
    )
    return middle, math.hypot(*parts)


def water_after(
    values: Mapping[str, float], state: WaterState, air: Environment | EnvironmentHistory, seconds: float
) -> float:
    """The water content of a strip after a while [s] in some air."""
    from ipmclab.model.environment.transport import water_course

    if seconds <= 0.0:
        return state.water_content
    history = EnvironmentHistory.of(air) if isinstance(air, Environment) else air
    return float(water_course(values, history, seconds, start=state).water_content[-1])
