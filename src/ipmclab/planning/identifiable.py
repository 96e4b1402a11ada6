"""What could be identified at all: the rank of the sensitivity over the closed form, without any data."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ipmclab.errors import InputError, suggest
from ipmclab.fit.fit import Direction
from ipmclab.identification.problem.free import FreeParameters, parse_free
from ipmclab.identification.problem.record import READ_OUTPUTS
from ipmclab.identification.undetermined.closed_form import NOTHING, NOTHING_OF_LAWS, null_space, others, sensitivity
from ipmclab.identification.undetermined.cures import Cure, cures_of, said_of
from ipmclab.kinds import tell_kinds
from ipmclab.model import Actuator
from ipmclab.run import FloatArray
from ipmclab.ties import names_by_size

_MOVED: Final = 1e-3  # of a direction of unit length


@dataclass(frozen=True)
class Identifiability:
    """Which combinations of the free parameters perfect readings would show.

    Parameters
    ----------
    free : tuple of str
    outputs : tuple of str
        What is read.
    rank : int
        Number of combinations that the outputs show.
    singular_values : tuple of float
        Of the relative sensitivity, columns of length 1, largest first.
    directions : tuple of Direction
        Combinations that no reading of these outputs shows, each with what would cure it; empty where there are none.
    """

    free: tuple[str, ...]
    outputs: tuple[str, ...]
    rank: int
    singular_values: tuple[float, ...]
    directions: tuple[Direction, ...]

    @property
    def is_complete(self) -> bool:
        """Whether every free parameter could be identified."""
        return self.rank == len(self.free)

    def __str__(self) -> str:
        """The rank, and a line for each combination that stays open."""
        lines = [f"{', '.join(self.outputs)}: {self.rank} of {len(self.free)} combinations can be identified"]
        lines += [f"  {direction.sentence}" for direction in self.directions]
        return "\n".join(lines)

    __repr__ = __str__


@tell_kinds
def identifiability(
    actuator: Actuator,
    *,
    free: str | Iterable[str] = "electrical",
    outputs: str | Sequence[str] = ("current",),
    voltage: float = 3.0,
) -> Identifiability:
    """Compute which parameters runs could determine if they were perfect, before any is recorded.

    For a linear actuator that is the rank of the derivatives of the transfer function by every free parameter, exact
    at all frequencies that its poles reach; with a leak, or before a laser, of the response to a staircase of voltages.
    It holds at the actuator's values, and at almost all others. The zero and the slope of a sensor
    (``observation.offset.current``) show wherever its output is read, in runs that begin at 0 V.

    Parameters
    ----------
    actuator : Actuator
    free : str or iterable of str
        As in ``identify``.
    outputs : str or sequence of str
        What is read: ``current``, ``displacement``, ``force``.
    voltage : float [V]
        The largest that is applied, which matters where a leak has a threshold.

    Returns
    -------
    identifiability : Identifiability

    Raises
    ------
    InputError
        An unknown name or output, a voltage that is not above 0.

    Examples
    --------
    >>> from ipmclab import load_actuator
    >>> six = ["electrical", "circuit.sheet_resistance"]
    >>> found = identifiability(load_actuator("friend-2"), free=six, outputs="current")
    >>> found.rank, len(found.free)
    (5, 6)
    >>> found.directions[0].cures
    ('measure circuit.sheet_resistance', 'record force', 'record displacement')
    """
    asked = _outputs(outputs)
    if not (math.isfinite(voltage) and voltage > 0.0):
        raise InputError(
            f"the largest voltage is {voltage:g} V, it must be above 0",
            code="out-of-range",
            where="voltage",
            repair="give the largest voltage that the runs apply",
        )
    chosen = parse_free(actuator.parameter_values, free)
    of_strip, of_sensors = chosen.actuator, chosen.observation
    names = (*of_strip, *of_sensors)
    matrix = beside_sensors(
        sensitivity(actuator, of_strip, asked, voltage=voltage) if of_strip else np.zeros((0, 0)),
        [name.rsplit(".", 1)[1] in asked for name in of_sensors],
    )
    singular, null = null_space(matrix, nothing=NOTHING if actuator.system.law_ports is None else NOTHING_OF_LAWS)
    found = tuple(
        direction(names, row, asked, cures_of(names, row, _shown_by(actuator, chosen, asked, row, voltage)))
        for row in null
    )
    return Identifiability(names, asked, len(names) - len(null), tuple(map(float, singular)), found)


def beside_sensors(matrix: FloatArray, is_read: Sequence[bool]) -> FloatArray:
    """The sensitivity to parameters of the strip, and also to what sensors add to their readings.

    A zero and a slope show while no voltage is applied yet, where no parameter of the strip does: each has a row of its
    own, which is empty where its output is not read.
    """
    rows, columns = matrix.shape
    found = np.zeros((rows + len(is_read), columns + len(is_read)))
    found[:rows, :columns] = matrix
    found[rows:, columns:] = np.diag(np.asarray(is_read, dtype=np.float64))
    return found


def _shown_by(
    actuator: Actuator, chosen: FreeParameters, asked: Sequence[str], row: FloatArray, voltage: float
) -> tuple[str, ...]:
    """Outputs that are not read and would show a combination, which is one of the strip or of a sensor."""
    count = len(chosen.actuator)
    if np.any(np.abs(row[:count]) > _MOVED):
        return others(actuator, chosen.actuator, asked, row[:count], voltage=voltage)
    return tuple(
        name.rsplit(".", 1)[1] for name, part in zip(chosen.observation, row[count:], strict=True) if abs(part) > _MOVED
    )


def direction(names: Sequence[str], row: FloatArray, outputs: Sequence[str], cures: Sequence[Cure]) -> Direction:
    """A combination that no reading of some outputs shows."""
    coefficients = dict(zip(names, map(float, row), strict=True))
    moved = names_by_size({name: part for name, part in coefficients.items() if abs(part) > _MOVED})
    listed = " and ".join(outputs)
    what = (
        f"{listed} says nothing of {moved[0]}"
        if len(moved) == 1
        else f"{', '.join(moved)} can move together without changing the {listed}"
    )
    return Direction(coefficients, f"{what}: {said_of(cures, moved)}", math.inf, tuple(cure.name for cure in cures))


def _outputs(given: str | Sequence[str]) -> tuple[str, ...]:
    asked = [given] if isinstance(given, str) else list(given)
    for name in asked:
        if name not in READ_OUTPUTS:
            raise InputError(
                f"{name!r} is not an output that runs have",
                code="unknown-output",
                where="outputs",
                repair=suggest(str(name), READ_OUTPUTS),
            )
    if not asked:
        raise InputError("nothing is read", code="no-outputs", where="outputs", repair="give 'current'")
    return tuple(name for name in READ_OUTPUTS if name in asked)
