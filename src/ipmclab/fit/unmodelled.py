"""What a strip may do that the model of a fit lacks: relaxations of any time constant, as far as its readings allow."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.tabled import Tabled

FloatArray = npt.NDArray[np.float64]

APART: Final = 10.0**0.5  # between neighbouring time constants: two to a decade imitate any between them (convention)
LEVEL: Final = 0.1  # of the largest voltage, within which two voltages ask the same of a strip (convention)
_LONGEST: Final = 10.0  # times as long as the record: slower ones are straight lines in it, and look alike (a limit)


@dataclass(frozen=True)
class Unmodelled(Tabled):
    """Relaxations that may be missing to the model of one output, and how the parameters moved to make up for them.

    Independent errors of the model, each of standard deviation one: the j-th adds ``amplitudes[j][k]`` of the voltage
    behind a lag of ``time_constants[k]`` to the output, and parameter ``name`` is ``moved[name][j]`` away from where it
    would be without it.

    Parameters
    ----------
    time_constants : tuple of float [s]
    amplitudes : tuple of tuple of float [SI/V]
    moved : mapping of name to tuple of float [SI]
    seen : float [s]
        How long the longest run of the fit is from where its voltage first moves.
    levels : tuple of float [V]
        The voltages that the runs of the fit were at since then, by ``voltage_levels``; empty in a file of an earlier
        version.
    """

    time_constants: tuple[float, ...]
    amplitudes: tuple[tuple[float, ...], ...]
    moved: Mapping[str, tuple[float, ...]]
    seen: float
    levels: tuple[float, ...] = ()

    def answers(self, time: FloatArray, voltage: FloatArray) -> FloatArray:
        """What each error of the model adds to the output by itself, shape (n_errors, n_time) [SI]."""
        lags = lagged(time, voltage, np.array(self.time_constants))
        return np.asarray(np.array(self.amplitudes).reshape(len(self.amplitudes), len(lags)) @ lags)

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Unmodelled:
        """From what ``to_table`` gave.

        Raises
        ------
        ValueError
            A time constant that is none, a number that is not finite, rows of unequal lengths.
        """
        constants = _numbers(table["time_constants"])
        amplitudes = tuple(_numbers(row) for row in table["amplitudes"])
        moved = {str(name): _numbers(row) for name, row in table["moved"].items()}
        (seen,) = _numbers([table["seen"]])
        levels = _numbers(table.get("levels", ()))
        if not all(one > 0.0 for one in constants):
            raise ValueError("a time constant of fit.unmodelled is not above 0")
        if any(len(row) != len(constants) for row in amplitudes) or any(
            len(row) != len(amplitudes) for row in moved.values()
        ):
            raise ValueError("rows of fit.unmodelled have unequal lengths")
        return cls(constants, amplitudes, moved, seen, levels)


def voltage_levels(voltages: Sequence[FloatArray]) -> tuple[float, ...]:
    """At which voltages some rows were, to within ``LEVEL`` of the largest [V], in ascending order."""
    asked = np.concatenate(voltages)
    width = LEVEL * float(np.abs(asked).max(initial=0.0))
    # Zero has no sign.
    return tuple((width * np.unique(np.rint(asked / width)) + 0.0).tolist()) if width > 0.0 else ()


def lag_times(step: float, seen: float) -> FloatArray:
    """Time constants [s] of lags that imitate any other: from a step between rows [s] to many times what is seen [s].

    Examples
    --------
    >>> lag_times(0.1, 1.0).round(2).tolist()
    [0.1, 0.32, 1.0, 3.16, 10.0]
    """
    count = int(np.ceil(np.log(_LONGEST * seen / step) / np.log(APART))) + 1
    constants: FloatArray = step * np.power(APART, np.arange(count))
    return constants


def lagged(time: FloatArray, voltage: FloatArray, time_constants: FloatArray) -> FloatArray:
    """The voltage behind lags of the first order, from rest, shape (n_time_constants, n_time) [V].

    Each value of the voltage lasts until the next row.

    Parameters
    ----------
    time : float array, shape (n_time,) [s]
    voltage : float array, shape (n_time,) [V]
    time_constants : float array, shape (n_time_constants,) [s]

    Examples
    --------
    >>> lagged(np.array([0.0, 1.0, 2.0]), np.ones(3), np.array([1.0 / np.log(2.0)])).round(6).tolist()
    [[0.0, 0.5, 0.75]]
    """
    from ipmclab.model.numerics.poles_loop import pole_values  # compiled: who only reads a fit needs none of it

    held = np.asarray(voltage[:-1], dtype=np.float64)
    steps, kind = np.unique(np.diff(time), return_inverse=True)
    found = np.empty((len(time_constants), len(time)))
    pole_values(steps, kind.astype(np.int64), held, held, -1.0 / time_constants, found)
    return found / time_constants[:, None]


def _numbers(values: Any) -> tuple[float, ...]:
    found = tuple(float(one) for one in values)
    if not all(map(math.isfinite, found)):
        raise ValueError("fit.unmodelled holds a number that is not finite")
    return found
