"""What an actuator answers to a voltage."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, suggest
from ipmclab.model.actuator import OUTPUT_PORTS, OUTPUTS, Actuator
from ipmclab.model.given import need_actuator
from ipmclab.model.numerics.modal import coefficients, modes
from ipmclab.model.stages.laser import blank_lost, read_far
from ipmclab.model.validity import validity
from ipmclab.run import Hold, Run, RunMetadata

if TYPE_CHECKING:
    from ipmclab.signals import Signal

FloatArray = npt.NDArray[np.float64]

KNOWN_HOLDS: Final = ("zero", "zero-before", "first")

MOST_ROWS: Final = 20_000_000
"""Rows of one simulated run: about 1 GB of outputs."""

_TOO_LARGE: Final = 1e300
"""No output reaches this; sums of numbers below it are finite."""

_SHORT_RECORD: Final = 5000
_has_simulated = False


def check_hold(hold: str) -> None:
    """Refuse a hold that does not say what the voltage did between rows.

    Raises
    ------
    InputError
    """
    if hold in KNOWN_HOLDS:
        return
    if hold == "unknown":
        raise InputError(
            "this record does not say what its voltage did between rows",
            code="unknown-hold",
            where="hold",
            repair=f"choose one of {', '.join(KNOWN_HOLDS)}; identify estimates the delay of its edges instead",
        )
    raise InputError(f"unknown hold {hold!r}", code="unknown-hold", where="hold", repair=suggest(hold, KNOWN_HOLDS))


def checked_voltage(voltage: npt.ArrayLike, rows: int) -> FloatArray:
    """The voltage as a contiguous array of that many finite values.

    Raises
    ------
    InputError
    """
    try:
        volts = np.ascontiguousarray(voltage, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            "not an array of numbers", code="bad-array", where="voltage", repair="give one voltage [V] for each row"
        ) from error
    if volts.shape != (rows,):
        raise InputError(
            f"the array has shape {volts.shape}, there are {rows} rows",
            code="unequal-lengths",
            where="voltage",
            repair="give one voltage [V] for each of round(duration x rate) rows",
        )
    with np.errstate(over="ignore", invalid="ignore"):
        total = volts.sum()
    if not math.isfinite(total):  # one NaN or infinity makes the sum one; overflow is looked at below
        bad = np.flatnonzero(~np.isfinite(volts))
        if len(bad):
            raise InputError(
                f"row {bad[0]} is {volts[bad[0]]}",
                code="bad-voltage",
                where="voltage",
                repair="every row needs the voltage that was applied",
            )
    return volts


def modal_coefficients(actuator: Actuator, period: float, hold: Hold) -> FloatArray | None:
    """The numbers of the modal recursion, kept with the actuator; None where the dense path must answer."""
    kept: dict[tuple[float, str], FloatArray | None] = actuator.__dict__.setdefault("_modal_coefficients", {})
    key = (period, hold)
    if key not in kept:
        found = modes(actuator.blocks(), external="voltage", outputs=OUTPUT_PORTS)
        kept[key] = None if found is None else coefficients(found, period, hold)
    return kept[key]


def simulate(
    actuator: Actuator,
    signal: Run | Signal | str | npt.ArrayLike,
    *,
    duration: float | None = None,
    rate: float | None = None,
    hold: Hold = "zero",
    initial_state: Mapping[str, float] | npt.ArrayLike | None = None,
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
    duration : float [s]
    rate : float [Hz]
        There are round(duration x rate) rows, at k/rate. Both are left out for a run.
    hold : "zero", "zero-before" or "first"
        What the voltage does between rows (see ``ipmclab.run.Hold``).
    initial_state : mapping of state name to float, or float array of shape (n_states,), optional
        The state at row 0; rest where it is left out. The names are ``actuator.state_names``.

    Returns
    -------
    run : Run
        With current [A], applied voltage [V], displacement [m] and force [N]; NaN is a displacement where a laser
        has lost the strip. ``metadata.findings`` says where the model was asked beyond what it holds for.

    Raises
    ------
    InputError
        No actuator; a duration, rate, hold, signal, array or state that cannot be used; a signal longer than the
        record; an output that is not finite.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> run = simulate(load_actuator("friend-2"), [1.0] * 2000, duration=40, rate=50)
    >>> len(run), round(1e3 * float(run.current[0]), 3)
    (2000, 60.348)
    """
    need_actuator(actuator)
    if isinstance(signal, Run):
        return _simulate_run(actuator, signal, duration, rate, initial_state)
    check_hold(hold)
    rows, frequency = count_rows(duration, rate)
    time = np.arange(rows) / frequency
    volts, given = _voltage(signal, time, duration, frequency)
    numbers = None if initial_state is not None else modal_coefficients(actuator, 1.0 / frequency, hold)
    if numbers is not None:
        values = np.empty((len(OUTPUTS), rows))
        with np.errstate(over="ignore", invalid="ignore"):  # the result is looked at below
            _modal_loop(rows)(volts, numbers, values)
            read_far(values, OUTPUTS, actuator.parameter_values)
    else:
        from ipmclab.model.sensitivity import simulate_outputs

        values = simulate_outputs(actuator, time, volts, hold, initial_state=initial_state)
    return _as_run(actuator, time, volts, values, hold, given, from_rest=initial_state is None)


def _modal_loop(rows: int) -> Callable[[FloatArray, FloatArray, FloatArray], None]:
    """The compiled loop, or the same loop as plain Python for the first short record of a process.

    Loading the compiler takes most of a second, the plain loop some 10 ms for a short record; the digits
    are the same. Whoever simulates again gets the compiled one.
    """
    global _has_simulated  # a process has one first time
    first_time, _has_simulated = not _has_simulated, True
    if first_time and rows <= _SHORT_RECORD and "ipmclab.model.numerics.kernels" not in sys.modules:
        from ipmclab.model.numerics.modal_loop import modal

        return modal
    from ipmclab.model.numerics import kernels

    return kernels.modal


def _simulate_run(actuator: Actuator, run: Run, duration: Any, rate: Any, initial_state: Any) -> Run:
    from ipmclab.model.sensitivity import simulate_outputs

    for name, value in (("duration", duration), ("rate", rate)):
        if value is not None:
            raise InputError(
                f"a run has its own times, the {name} {value!r} cannot be used",
                code="needless-argument",
                where=name,
                repair="leave it out, or give run.voltage with a duration and a rate",
            )
    strip = with_shunt(actuator, run)
    values = simulate_outputs(strip, run.time, run.voltage, run.hold, initial_state=initial_state)
    rest, about = initial_state is None, run.metadata
    simulated = _as_run(strip, run.time, run.voltage, values, run.hold, about.signal, from_rest=rest)
    sensed = replace(simulated.metadata, voltage_sensed=about.voltage_sensed, shunt_resistance=about.shunt_resistance)
    return replace(simulated, metadata=sensed)


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
    name = "circuit.contact_resistance"
    return actuator.replace(**{name: actuator[name] + shunt}) if shunt else actuator


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
) -> Run:
    from ipmclab.version import __version__

    with np.errstate(over="ignore", invalid="ignore"):
        total = values.sum()  # one NaN or infinity makes the sum one
    if not math.isfinite(total):
        output, row = np.argwhere(~(np.abs(values) < _TOO_LARGE))[0].tolist()
        raise InputError(
            f"row {row} of the simulated {OUTPUTS[output]} is {values[output, row]:g}",
            code="bad-output",
            where="simulate",
            repair="these numbers are beyond floating point: correct the voltage, the rate or the initial state",
        )
    blank_lost(values, OUTPUTS, actuator.parameter_values)
    current, applied_voltage, displacement, force = values
    run = Run(
        time=time,
        voltage=voltage,
        current=current,
        applied_voltage=applied_voltage,
        displacement=displacement,
        force=force,
        hold=hold,
        metadata=RunMetadata(
            origin="simulated",
            sample=actuator.sample,
            signal=None if signal is None else str(signal),
            starts_from_rest=from_rest,
            software_version=__version__,
            parameters=actuator.parameter_values,
        ),
    )
    found = validity(actuator, run, signal)
    return replace(run, metadata=replace(run.metadata, findings=found)) if found else run


def above_zero(name: str, value: Any, unit: str) -> float:
    """The value as a float.

    Raises
    ------
    InputError
        Not a number, not finite, or not above 0.
    """
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not 0.0 < number < math.inf:
        raise InputError(
            f"the {name} is {value!r}, it must be a number above 0",
            code=f"bad-{name}",
            where=name,
            repair=f"give it in {unit}, such as {'40' if unit == 's' else '50'}",
        )
    return number


def count_rows(duration: Any, rate: Any, *, most: int = MOST_ROWS) -> tuple[int, float]:
    """The rows of a record, and its rate [Hz] as a float.

    Raises
    ------
    InputError
        A duration or rate that is not a number above 0, fewer than 2 or more than ``most`` rows.
    """
    seconds, hertz = above_zero("duration", duration, "s"), above_zero("rate", rate, "Hz")
    wanted = seconds * hertz
    if not 1.5 < wanted < most + 0.5:
        raise InputError(
            f"{seconds:g} s at {hertz:g} Hz are {wanted:.0f} rows, allowed are 2 to {most}",
            code="bad-duration",
            where="duration",
            repair="change the duration or the rate",
        )
    return round(wanted), hertz


def _voltage(signal: Any, time: FloatArray, duration: Any, rate: float) -> tuple[FloatArray, Signal | None]:
    if isinstance(signal, str):
        from ipmclab.signals import parse

        signal = parse(signal)
    if not hasattr(signal, "voltage"):
        return checked_voltage(signal, len(time)), None
    signal.check_fits(float(duration), rate)
    return checked_voltage(signal.voltage(time), len(time)), signal
