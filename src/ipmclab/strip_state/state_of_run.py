"""In which state a strip was in each run, and how its water content is known."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
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
_TANGENT: Final = 0.1  # of what is uncertain in a run alone: water so near along another tangent is the same
_OF_FILM: Final = "observation.film"
_OF_LIQUID: Final = "observation.liquid_water"
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


def states_of(
    actuator: Actuator, runs: Sequence[Run], labels: Sequence[str], off: Mapping[str, float] = MappingProxyType({})
) -> list[RunState]:
    """The state of a strip in each of some runs, each from what it says and from the one before it.

    Parameters
    ----------
    actuator : Actuator
        With a table ``[hydration]``.
    runs : sequence of Run
    labels : sequence of str
        For messages.
    off : mapping of name to float
        By how many standard uncertainties that is off on which several runs rest (``RunState.shared``): the tangent
        is taken there.

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
        state = state_of(actuator, runs[place], label=labels[place], before=before if known else None, off=off)
        found[place] = replace(state, shared={**state.shared, f"observation.before.{place}": state.own_uncertainty})
        before = runs[place], found[place]
    shared = Counter(name for state in found.values() for name in state.shared)
    return [
        replace(state, shared={name: part for name, part in state.shared.items() if shared[name] > 1})
        for _, state in sorted(found.items())
    ]


def restated(
    actuator: Actuator, runs: Sequence[tuple[Run, RunState | None]], off: Mapping[str, float]
) -> list[RunState] | None:
    """States whose water is known along the tangent at what readings say; None where the old tangent ends there too.

    Parameters
    ----------
    actuator : Actuator
    runs : sequence of pair of Run and RunState
        As their states were.
    off : mapping of name to float
        What the readings say, in standard uncertainties.
    """
    states = [state for _, state in runs if state is not None]
    if not any(state.shared for state in states):
        return None
    found = states_of(actuator, [run for run, _ in runs], [""] * len(runs), off)
    both = list(zip(states, found, strict=True))
    if all(abs(new.content_at(off) - old.content_at(off)) <= _TANGENT * new.own_uncertainty for old, new in both):
        return None
    return [replace(old, shared=new.shared, tangent=new.tangent) for old, new in both]


def state_of(
    actuator: Actuator,
    run: Run,
    *,
    label: str,
    before: tuple[Run, RunState] | None = None,
    off: Mapping[str, float] = MappingProxyType({}),
) -> RunState:
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
        The run before it, of the same strip; all that makes its state uncertain stands in ``shared``.
    off : mapping of name to float
        By how many standard uncertainties that is off on which several runs rest.

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
        return RunState(
            *weighed[:2], "measured", temperature, humidity, shared={"observation.ionic_groups": weighed[2]}
        )
    start = _start(actuator, run, before, temperature, off)
    if start is not None:
        water, uncertainty, shared = _computed(actuator, start, air, error, off.get(_OF_FILM, 0.0))
        state = RunState(water, uncertainty, "computed", temperature, humidity, shared=shared)
        return replace(state, tangent=(2.0 * water - state.content_at(off), uncertainty)) if off else state
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
    actuator: Actuator, run: Run, before: tuple[Run, RunState] | None, temperature: float, off: Mapping[str, float]
) -> tuple[WaterState, Mapping[str, float], float] | None:
    """A state that is known, what makes it uncertain, and for how long [s] the strip was in this air since.

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
            state = WaterState(max(then.content_at(off), 0.0), then.temperature)
            return state, then.shared, min(60.0 * minutes, since)
    if out is not None:
        error = actuator.standard_uncertainties.get(LIQUID, _LIQUID_ERROR * values[LIQUID])
        content = max(values[LIQUID] + off.get(_OF_LIQUID, 0.0) * error, 0.0)
        return WaterState(content, temperature), {_OF_LIQUID: error}, 60.0 * out
    return None


def _strip(run: Run) -> str | None:
    return None if run.metadata.sample is None else run.metadata.sample.id


def _computed(
    actuator: Actuator,
    start: tuple[WaterState, Mapping[str, float], float],
    air: Environment,
    error: float,
    of_film: float,
) -> tuple[float, float, dict[str, float]]:
    """The water content after a while in some air, what the start, the humidity and the film leave open, and of that
    what other runs rest on too.

    Each part is half of what the content differs by between one standard uncertainty more and less: a strip that is
    nearly in equilibrium would be farther from it behind a slower film, and hardly nearer behind a faster one.
    """
    state, of_start, seconds = start
    values = dict(actuator.parameter_values)
    relative = actuator.standard_uncertainties.get(FILM, _FILM_ERROR * values[FILM]) / values[FILM]
    values[FILM] *= math.exp(of_film * relative)
    whole = math.hypot(*of_start.values())

    def after(more: float = 0.0, wetter: float = 0.0, faster: float = 0.0) -> float:
        begin = WaterState(max(state.water_content + more, 0.0), state.temperature)
        humidity = min(max(air.relative_humidity + wetter, 0.0), 100.0)
        there = {**values, FILM: values[FILM] * math.exp(faster)}
        return water_after(there, begin, Environment(air.temperature, humidity), seconds)

    kept = 0.5 * (after(more=whole) - after(more=-whole)) / (whole or 1.0)
    shared = {name: kept * part for name, part in of_start.items()}
    shared[_OF_FILM] = shared.get(_OF_FILM, 0.0) + 0.5 * (after(faster=relative) - after(faster=-relative))
    of_air = 0.5 * (after(wetter=error) - after(wetter=-error))
    return after(), math.hypot(of_air, *shared.values()), shared


def water_after(
    values: Mapping[str, float], state: WaterState, air: Environment | EnvironmentHistory, seconds: float
) -> float:
    """The water content of a strip after a while [s] in some air."""
    from ipmclab.model.environment.transport import water_course

    if seconds <= 0.0:
        return state.water_content
    history = EnvironmentHistory.of(air) if isinstance(air, Environment) else air
    return float(water_course(values, history, seconds, start=state).water_content[-1])
