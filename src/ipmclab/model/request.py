"""What a simulation is asked: rows, hold, voltage and initial state, each refused by name where it cannot be used."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, unknown_name
from ipmclab.run import Run, check_time
from ipmclab.units import FREQUENCY, TIME, parse_quantity

if TYPE_CHECKING:
    from ipmclab.signals import Signal

FloatArray = npt.NDArray[np.float64]

KNOWN_HOLDS: Final = ("zero", "zero-before", "first")

MOST_ROWS: Final = 20_000_000
"""Rows of one simulated run: about 1 GB of outputs."""

MOST_VOLTS: Final = 1e5
"""Only a slip of a number or its unit is above: a strip of 0.2 mm breaks down long before."""


def sum_of_squares(values: FloatArray) -> float:
    """In half the time of a largest magnitude, of which its root is a bound; infinite or NaN where a value is.

    Examples
    --------
    >>> sum_of_squares(np.array([3.0, -4.0])), sum_of_squares(np.array([1e200]))
    (25.0, inf)
    """
    return float(np.vdot(values, values))  # which says nothing of an overflow


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
    raise unknown_name("hold", hold, KNOWN_HOLDS, where="hold")


def checked_voltage(voltage: npt.ArrayLike, rows: int) -> FloatArray:
    """The voltage as a contiguous array of that many finite values.

    Raises
    ------
    InputError
        Not so many numbers, or a voltage that no strip can be under.
    """
    found, squares = _checked_rows("voltage", "V", voltage, rows)
    if squares > MOST_VOLTS**2:
        row = int(np.abs(found).argmax())
        if abs(found[row]) > MOST_VOLTS:
            raise InputError(
                f"row {row} is {found[row]:g} V, a strip can be under {MOST_VOLTS:g} V at most",
                code="out-of-range",
                where="voltage",
                repair="correct the number or its unit: strips are driven by 1 to 3 V",
            )
    return found


def checked_force(force: npt.ArrayLike, rows: int) -> FloatArray:
    """The external force as a contiguous array of that many finite values.

    Raises
    ------
    InputError
    """
    return _checked_rows("external_force", "N", force, rows)[0]


def _checked_rows(name: str, unit: str, values: npt.ArrayLike, rows: int) -> tuple[FloatArray, float]:
    """The values, and the sum of their squares: no magnitude is above its root."""
    try:
        given: Any = values
        if isinstance(given, np.ma.MaskedArray):  # NumPy would show what the mask hides
            given = np.ma.asarray(given, dtype=np.float64).filled(np.nan)
        found = np.ascontiguousarray(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            "not an array of numbers",
            code="bad-array",
            where=name,
            repair=f"give one {_words(name)} [{unit}] for each row",
        ) from error
    if found.shape != (rows,):
        raise InputError(
            f"the array has shape {found.shape}, there are {rows} rows",
            code="unequal-lengths",
            where=name,
            repair=f"give one {_words(name)} [{unit}] for each of round(duration x rate) rows",
        )
    squares = sum_of_squares(found)
    if not math.isfinite(squares):
        bad = np.flatnonzero(~np.isfinite(found))
        if len(bad):
            raise InputError(
                f"row {bad[0]} is {found[bad[0]]}",
                code=f"bad-{name.replace('_', '-')}",
                where=name,
                repair=f"every row needs the {_words(name)} that was applied",
            )
    return found, squares


def _words(name: str) -> str:
    return name.replace("_", " ")


def checked_record(time: npt.ArrayLike, voltage: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """The times of a record and its voltage, as contiguous arrays.

    Raises
    ------
    InputError
        Time that does not increase, unequal lengths, a voltage that is not finite.
    """
    times = np.ascontiguousarray(time, dtype=np.float64)
    check_time("time", times)
    return times, checked_voltage(voltage, len(times))


def state_vector(names: Sequence[str], state: Mapping[str, float] | npt.ArrayLike | None) -> FloatArray:
    """A state as an array in the order of these names; rest for None, and for names left out.

    Raises
    ------
    InputError
        An unknown state name, a wrong number of values, or a value that is not finite.
    """
    if state is None:
        return np.zeros(len(names))
    if isinstance(state, Mapping):
        for name in state:
            if name not in names:
                raise unknown_name("state", name, names, where="initial_state")
    given: Any = [state.get(name, 0.0) for name in names] if isinstance(state, Mapping) else state
    try:
        vector = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (len(names),) or not np.all(np.isfinite(vector)):
        raise InputError(
            f"{given!r:.200} is not one finite value for each of {', '.join(names)}",
            code="bad-state",
            where="initial_state",
            repair=f"give {len(names)} numbers, or a mapping from these names",
        )
    return vector


def above_zero(name: str, value: Any, unit: str) -> float:
    """The value as a float; a text is read with its unit, as files are: ``"40 s"``, ``"2 min"``, ``"50 Hz"``.

    Raises
    ------
    InputError
        Not a number, not finite, not above 0, or a text without its unit.
    """
    if isinstance(value, str):
        value = parse_quantity(value, TIME if unit == "s" else FREQUENCY, where=name)
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


def voltage_of(signal: Any, time: FloatArray, duration: Any, rate: float) -> tuple[FloatArray, Signal | None]:
    """The voltage at the rows of a record, and the signal that it is of, where it is of one.

    Parameters
    ----------
    signal : Signal, str, or float array of shape (n_time,) [V]
    time : float array, shape (n_time,) [s]
    duration : float [s], or its text
    rate : float [Hz]

    Raises
    ------
    InputError
        What cannot be a voltage at these rows, a signal longer than the record.
    """
    if isinstance(signal, str):
        from ipmclab.signals.text import parse

        signal = parse(signal)
    if isinstance(signal, Run):
        raise InputError(
            "this is a Run, not a signal",
            code="not-a-signal",
            where="signal",
            repair="give its voltage, run.voltage, or simulate(actuator, run)",
        )
    if not hasattr(signal, "voltage"):
        return checked_voltage(signal, len(time)), None
    signal.check_fits(above_zero("duration", duration, "s"), rate)
    return checked_voltage(signal.voltage(time), len(time)), signal
