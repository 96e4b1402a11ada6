"""What an actuator answers to a voltage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.kinds import tell_kinds
from ipmclab.model.actuator import Actuator
from ipmclab.model.changing import changing_outputs
from ipmclab.model.environment import Environment, EnvironmentHistory
from ipmclab.model.environment.in_run import AnyEnvironment, Surroundings, surroundings
from ipmclab.model.outputs import regular_outputs, simulate_outputs
from ipmclab.model.ports import OUTPUTS
from ipmclab.model.request import check_hold, count_rows, sum_of_squares, voltage_of
from ipmclab.model.stages.circuit import CONTACT
from ipmclab.model.stages.laser import blank_lost
from ipmclab.model.validity import beyond_model
from ipmclab.run import Finding, Hold, Run, RunMetadata

if TYPE_CHECKING:
    from ipmclab.signals import Signal

FloatArray = npt.NDArray[np.float64]

_TOO_LARGE: Final = 1e300
"""No output reaches this; sums of numbers below it are finite."""


@tell_kinds
def simulate(
    actuator: Actuator,
    signal: Run | Signal | str | npt.ArrayLike,
    *,
    duration: float | str | None = None,
    rate: float | str | None = None,
    hold: Hold = "zero",
    initial_state: Mapping[str, float] | npt.ArrayLike | None = None,
    external_force: npt.ArrayLike | None = None,
    environment: AnyEnvironment | None = None,
) -> Run:
    """Simulate what an actuator answers to a voltage, exactly for the chosen hold.

    With a leak what leaks goes in straight lines between rows, or between parts of 20 ms where rows are further apart.

    Parameters
    ----------
    actuator : Actuator
    signal : Signal, str, float array of shape (n_time,) [V], or Run
        A signal or its text (``"sine 1 V 0.1 Hz"``), an array with one voltage for each row, or
        a run: then its own voltage, times and hold are used, and a shunt that its voltage was sensed
        upstream of is put in series.
    duration : float [s], or a text such as "40 s"
    rate : float [Hz]
        There are round(duration x rate) rows, at k/rate. Both are left out for a run.
    hold : "zero", "zero-before" or "first"
        What the voltage does between rows (see ``ipmclab.run.Hold``).
    initial_state : mapping of state name to float, or float array of shape (n_states,), optional
        The state at row 0; rest where it is left out. The names are ``actuator.state_names``.
    external_force : float array, shape (n_time,) [N], optional
        A force on the strip at its sensing point, one value for each row, positive as the displacement; between rows
        it does as the voltage does. A run does not keep it: a finding says that it acted.
    environment : Environment, WaterState, EnvironmentHistory, or a text such as "20 degC, 80 %RH", optional
        Of an actuator with laws (``environment.laws``). In one environment the strip has been for long. Through a
        history, which begins at row 0, its parameters drift: they are renewed long before any has moved by 0.2 %, and
        charge continues. The actuator's state of reference where it is left out.

    Returns
    -------
    run : Run
        With current [A], applied voltage [V], displacement [m] and force [N]; NaN is a displacement where a laser
        has lost the strip. ``metadata.findings`` says where the model was asked beyond what it holds for.

    Raises
    ------
    InputError
        No actuator; a duration, rate, hold, signal, array, state or environment that cannot be used; a signal longer
        than the record; an output that is not finite.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> run = simulate(load_actuator("friend-2"), [1.0] * 2000, duration=40, rate=50)
    >>> len(run), round(1e3 * float(run.current[0]), 3)
    (2000, 60.348)
    """
    if isinstance(signal, Run):
        return _simulate_run(actuator, signal, duration, rate, initial_state, external_force, environment)
    check_hold(hold)
    rows, frequency = count_rows(duration, rate)
    time = np.arange(rows, dtype=np.float64)
    time /= frequency
    volts, given = voltage_of(signal, time, duration, frequency)
    asked = _Asked(time, volts, hold, given, initial_state, external_force, 1.0 / frequency)
    if environment is not None:
        return _in_environment(actuator, asked, environment)
    return _answered(actuator, asked, _outputs(actuator, asked))


def _outputs(actuator: Actuator, asked: _Asked) -> FloatArray:
    """What is read at the rows."""
    if asked.period is not None and asked.initial_state is None and asked.external_force is None:
        values = regular_outputs(actuator, asked.voltage, asked.period, asked.hold)
        if values is not None:
            return values
    return simulate_outputs(
        *(actuator, asked.time, asked.voltage, asked.hold),
        initial_state=asked.initial_state,
        external_force=asked.external_force,
    )


class _Asked(NamedTuple):
    """What is asked of a strip, whatever the environment; with a period [s] where the rows were made by one."""

    time: FloatArray
    voltage: FloatArray
    hold: Hold
    signal: Signal | str | None
    initial_state: Mapping[str, float] | npt.ArrayLike | None
    external_force: npt.ArrayLike | None
    period: float | None


def _in_environment(actuator: Actuator, asked: _Asked, environment: AnyEnvironment) -> Run:
    """The run in an environment, which is in it, with what is to be said of it."""
    given = Environment.parse(environment) if isinstance(environment, str) else environment
    there, water = actuator, None
    if isinstance(given, EnvironmentHistory) and actuator.structure.hydration:
        values, water = changing_outputs(
            *(actuator, asked.time, asked.voltage, asked.hold, given),
            initial_state=asked.initial_state,
            external_force=asked.external_force,
            regular=asked.period is not None,
        )
    else:
        stands = given.at(float(asked.time[0])) if isinstance(given, EnvironmentHistory) else given
        there = actuator.keep(("at", stands), lambda: actuator.at(stands))
        values = _outputs(there, asked)
    around = surroundings(actuator, given, float(asked.time[0]), float(asked.time[-1]), water)
    return _answered(there, asked, values, around)


def _answered(actuator: Actuator, asked: _Asked, values: FloatArray, around: Surroundings | None = None) -> Run:
    """The run, with what is to be said of it."""
    rest = asked.initial_state is None
    run = _as_run(actuator, asked.time, asked.voltage, values, asked.hold, asked.signal, from_rest=rest, around=around)
    return run if asked.external_force is None else _pushed(run)


def _pushed(run: Run) -> Run:
    """The run, saying that a force acted which it does not keep."""
    said = Finding(
        code="external-force",
        severity="warning",
        message="an external force acted on this strip, and a run does not keep it: "
        "a fit or a validation would take its effect for the strip's own",
        repair="compare it only with a simulation under the same force",
    )
    return _saying(run, said)


def _saying(run: Run, *said: Finding) -> Run:
    return replace(run, metadata=replace(run.metadata, findings=(*run.metadata.findings, *said))) if said else run


def _simulate_run(
    actuator: Actuator,
    run: Run,
    duration: Any,
    rate: Any,
    initial_state: Any,
    external_force: Any,
    environment: AnyEnvironment | None,
) -> Run:
    for name, value in (("duration", duration), ("rate", rate)):
        if value is not None:
            raise InputError(
                f"a run has its own times, the {name} {value!r} cannot be used",
                code="needless-argument",
                where=name,
                repair="leave it out, or give run.voltage with a duration and a rate",
            )
    strip = with_shunt(actuator, run)
    about = run.metadata
    asked = _Asked(run.time, run.voltage, run.hold, about.signal, initial_state, external_force, None)
    if environment is not None:
        found = _in_environment(strip, asked, environment)
    else:
        found = _answered(strip, asked, _outputs(strip, asked))
    sensed = replace(found.metadata, voltage_sensed=about.voltage_sensed, shunt_resistance=about.shunt_resistance)
    return replace(found, metadata=sensed)


def with_shunt(actuator: Actuator, run: Run) -> Actuator:
    """The actuator as the voltage of a run sees it: in series with the shunt, where that was sensed with it.

    Raises
    ------
    InputError
        The voltage was sensed upstream of a shunt of unknown resistance.

    Examples
    --------
    >>> from ipmclab import Run, RunMetadata, load_actuator
    >>> sensed = RunMetadata(voltage_sensed="upstream of shunt", shunt_resistance=1.0)
    >>> run = Run.from_arrays(time=[0.0, 1.0], voltage=[1.0, 1.0], metadata=sensed)
    >>> with_shunt(load_actuator("friend-2"), run)["circuit.contact_resistance"]
    1.0
    """
    shunt = series_shunt(run, where="metadata.shunt_resistance")
    return actuator.replace(**{CONTACT: actuator[CONTACT] + shunt}) if shunt else actuator


def series_shunt(run: Run, *, where: str) -> float:
    """The shunt [ohm] between the place where a run's voltage was sensed and the strip; 0 where there is none.

    Raises
    ------
    InputError
        The voltage was sensed upstream of a shunt of unknown resistance.
    """
    about = run.metadata
    if about.voltage_sensed != "upstream of shunt":
        return 0.0
    if about.shunt_resistance is None:
        raise InputError(
            "the voltage was sensed upstream of a shunt whose resistance is not given",
            code="unknown-shunt",
            where=where,
            repair="give metadata.shunt_resistance: in the thesis's sample, 1 ohm left out makes the peak current "
            "6 % too high and moves rho_1 by 186 %",
        )
    return float(about.shunt_resistance)


def _as_run(
    actuator: Actuator,
    time: FloatArray,
    voltage: FloatArray,
    values: FloatArray,
    hold: Hold,
    signal: Signal | str | None,
    *,
    from_rest: bool,
    around: Surroundings | None = None,
) -> Run:
    if not sum_of_squares(values) < _TOO_LARGE and len(bad := np.argwhere(~(np.abs(values) < _TOO_LARGE))):
        output, row = bad[0].tolist()
        raise InputError(
            f"row {row} of the simulated {OUTPUTS[output]} is {values[output, row]:g}",
            code="bad-output",
            where="simulate",
            repair="these numbers are beyond floating point: correct the voltage, the rate or the initial state",
        )
    blank_lost(values, OUTPUTS, actuator.parameter_values)
    values.setflags(write=False)  # once for all four
    current, applied_voltage, displacement, force = values
    about = _about(actuator, None if signal is None else str(signal), from_rest=from_rest, around=around)
    run = Run(
        time=time,
        voltage=voltage,
        current=current,
        applied_voltage=applied_voltage,
        displacement=displacement,
        force=force,
        hold=hold,
        **(around.readings if around else {}),
        metadata=about,
    )
    found = (*beyond_model(actuator, run, signal), *(around.findings if around else ()))
    if found:  # nobody has the run yet, and a copy takes as long as 2,000 rows
        object.__setattr__(run, "metadata", _metadata(vars(about), findings=found))
    return run


@cache
def _of_any_strip() -> Mapping[str, Any]:
    from ipmclab.version import __version__

    return vars(RunMetadata(origin="simulated", software_version=__version__))


def _metadata(like: Mapping[str, Any], **others: Any) -> RunMetadata:
    """With these fields, and all the rest like others: made by its name it takes ten times as long."""
    found = object.__new__(RunMetadata)
    found.__dict__.update(like, **others)
    return found


def _about(actuator: Actuator, signal: str | None, *, from_rest: bool, around: Surroundings | None) -> RunMetadata:
    """What is known of every run of an actuator under a signal: kept, it takes as long to make as 2,000 rows."""
    there = around.about if around else {}

    def made() -> RunMetadata:
        return _metadata(
            _of_any_strip(),
            sample=actuator.sample,
            signal=signal,
            starts_from_rest=from_rest,
            parameters=actuator.parameter_values,
            **there,
        )

    return actuator.keep(("metadata", signal, from_rest, *there.values()), made)
