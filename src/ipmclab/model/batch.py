"""What is asked of many simulations of one actuator: its parameter sets and its voltages, checked before any is run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError
from ipmclab.model import geometry
from ipmclab.model.actuator import Actuator, unknown_parameter
from ipmclab.model.ports import OUTPUTS, choose_outputs
from ipmclab.model.request import check_hold, count_rows, voltage_of
from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]
Signals = Any
"""A signal, its text or an array, or one of them for each set: a type checker cannot distinguish these lists."""


@dataclass(frozen=True, eq=False)
class Record:
    """The rows of every simulation.

    Parameters
    ----------
    time : float array, shape (n_time,) [s]
    duration : float [s]
    rate : float [Hz]
    hold : "zero", "zero-before" or "first"
    """

    time: FloatArray
    duration: float | str
    rate: float
    hold: Hold

    @classmethod
    def of(cls, duration: float | str, rate: float | str, hold: Hold) -> Record:
        """The rows that ``simulate`` has for these.

        Raises
        ------
        InputError
        """
        check_hold(hold)
        rows, hertz = count_rows(duration, rate)
        return cls(np.arange(rows) / hertz, duration, hertz, hold)


@dataclass(frozen=True, eq=False)
class Batch:
    """Parameter sets and voltages.

    Parameters
    ----------
    actuator : Actuator
    sets : int
    changes : mapping of dotted name to float array, shape (n_sets,) [SI]
    record : Record
    voltage : float array, shape (1 or n_sets, n_time) [V]
    outputs : tuple of str
    """

    actuator: Actuator
    sets: int
    changes: Mapping[str, FloatArray]
    record: Record
    voltage: FloatArray
    outputs: tuple[str, ...]

    @classmethod
    def of(
        cls,
        actuator: Actuator,
        signals: Signals,
        parameters: Mapping[str, npt.ArrayLike] | None,
        record: Record,
        outputs: Sequence[str] | None,
    ) -> Batch:
        """The batch of these arguments of ``simulate_many``.

        Raises
        ------
        InputError
        """
        voltage = _voltages(signals, record)
        changes = checked_changes(actuator, parameters or {}, sets=len(voltage) if len(voltage) > 1 else None)
        sets = len(next(iter(changes.values()))) if changes else len(voltage)
        chosen = tuple(OUTPUTS[place] for place in choose_outputs(outputs))
        if not chosen:
            raise InputError(
                "no output is named",
                code="no-output",
                where="outputs",
                repair=f"name some of {', '.join(OUTPUTS)}, or leave it out for all of them",
            )
        return cls(actuator, sets, changes, record, voltage, chosen)

    def part(self, begin: int, end: int) -> Batch:
        """The sets from one place to another."""
        return self._some(slice(begin, end), end - begin)

    def of_sets(self, places: npt.NDArray[np.intp]) -> Batch:
        """The sets at some places."""
        return self._some(places, len(places))

    def _some(self, chosen: slice | npt.NDArray[np.intp], sets: int) -> Batch:
        changes = {name: values[chosen] for name, values in self.changes.items()}
        voltage = self.voltage if len(self.voltage) == 1 else self.voltage[chosen]
        return replace(self, sets=sets, changes=changes, voltage=voltage)

    def of_set(self, k: int) -> tuple[Actuator, FloatArray]:
        """The actuator of one set, and its voltage."""
        changes = {name: float(values[k]) for name, values in self.changes.items()}
        return self.actuator.replace(**changes), self.voltage[k if len(self.voltage) > 1 else 0]


def checked_changes(
    actuator: Actuator, parameters: Mapping[str, npt.ArrayLike], *, sets: int | None = None
) -> dict[str, FloatArray]:
    """Parameter sets as arrays of one length, each value within its allowed range.

    Parameters
    ----------
    actuator : Actuator
    parameters : mapping of dotted name to float array, shape (n_sets,), or float [SI]
    sets : int, optional
        How many there must be; left out, as many as the arrays have.

    Raises
    ------
    InputError
        An unknown name, not numbers, unequal lengths, a value outside its range, a sensing point beyond the end.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> checked_changes(load_actuator("friend-2"), {"beam.modulus": [1e9, 2e9], "coupling.p1": 16})
    {'beam.modulus': array([1.e+09, 2.e+09]), 'coupling.p1': array([16., 16.])}
    """
    columns: dict[str, FloatArray] = {}
    for name, values in parameters.items():
        if name not in actuator.parameter_values:
            raise unknown_parameter(name, actuator.parameter_values)
        columns[name] = _column(name, values)
        if columns[name].ndim and sets is None:
            sets = len(columns[name])
    sets = 1 if sets is None else sets
    for name, column in columns.items():
        if column.ndim and len(column) != sets:
            raise InputError(
                f"{len(column)} values, and there are {sets} sets",
                code="unequal-lengths",
                where=name,
                repair="give one value for each set, or a single number for all of them",
            )
        columns[name] = np.ascontiguousarray(np.broadcast_to(column, (sets,)))
        _check_range(actuator, name, columns[name])
    _check_sensing(actuator, columns)
    return columns


def _column(name: str, values: npt.ArrayLike) -> FloatArray:
    try:
        column = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            "not an array of numbers", code="bad-array", where=name, repair="give one number for each set"
        ) from error
    if column.ndim > 1 or not column.size:
        raise InputError(
            f"the array has shape {column.shape}",
            code="bad-array",
            where=name,
            repair="give one number for each set, at least one",
        )
    return column


def _check_range(actuator: Actuator, name: str, column: FloatArray) -> None:
    declaration = actuator.structure.declarations[name]
    fine = (column >= declaration.lower) & (column <= declaration.upper)
    if declaration.transform == "count":
        fine &= column == np.round(column)
    if not fine.all():
        k = int(np.argmin(fine))
        declaration.check(float(column[k]), where=f"{name}[{k}]")


def _check_sensing(actuator: Actuator, columns: Mapping[str, FloatArray]) -> None:
    free, sensing = (
        columns.get(name, np.array([actuator[name]])) for name in ("geometry.free_length", "geometry.sensing_length")
    )
    beyond = np.broadcast_to(sensing > free, np.broadcast_shapes(free.shape, sensing.shape))
    if beyond.any():
        k = int(np.argmax(beyond))
        lengths = {name: columns[name][k] if name in columns else actuator[name] for name in geometry.DIMENSIONS}
        geometry.check({name: float(value) for name, value in lengths.items()}, where=f"set {k}: ")


def _voltages(signals: Signals, record: Record) -> FloatArray:
    """The voltages, shape (1 or n_sets, n_time)."""
    several = isinstance(signals, list | tuple) and any(
        isinstance(one, str | list | tuple) or hasattr(one, "voltage") or getattr(one, "ndim", 0) for one in signals
    )
    if not several and np.ndim(signals) < 2:
        return voltage_of(signals, record.time, record.duration, record.rate)[0][None]
    found = np.empty((len(signals), len(record.time)))
    if not len(found):
        raise InputError(
            "there is no signal", code="no-signal", where="signals", repair="give one, or one for each set"
        )
    for k, one in enumerate(signals):
        try:
            found[k] = voltage_of(one, record.time, record.duration, record.rate)[0]
        except InputError as error:
            where = f"signals[{k}]" + (f".{error.where}" if error.where else "")
            raise error.at(where) from None
    return found
