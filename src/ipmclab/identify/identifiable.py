"""What could be identified at all: the rank of the sensitivity over the closed form, without any data."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.errors import InputError, suggest
from ipmclab.identify.cures import Cure, cures_of, said_of
from ipmclab.identify.fit import Direction
from ipmclab.identify.free import parse_free
from ipmclab.identify.observation import READ_OUTPUTS
from ipmclab.identify.unknowns import actuator_unknown
from ipmclab.model import Actuator
from ipmclab.model.actuator import choose_outputs
from ipmclab.model.given import need_actuator

FloatArray = npt.NDArray[np.float64]

_NOTHING: Final = 1e-9
"""A singular value below this part of the largest (columns of length 1) is rounding."""

_NOTHING_OF_LAWS: Final = 1e-5  # the same where static laws are solved from row to row, which is no closed form

_SHOWN: Final = 1e-6  # part of what its parameters change one by one that a combination must change, to be shown
_SHOWN_BY_LAWS: Final = 1e-4

_COMPLEX_STEP: Final = 1e-100
_EACH_SIDE: Final = 20.0  # times the fastest pole, and a part of the slowest: how far frequencies reach
_A_DECADE: Final = 12
_LEVELS: Final = (0.3, -0.6, 1.0, -0.8, 0.5, -1.0, 0.7)  # of the largest voltage: a staircase for what is not linear
_ROWS: Final = 40  # of each step of it


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


def identifiability(
    actuator: Actuator,
    *,
    free: str | Iterable[str] = "electrical",
    outputs: str | Sequence[str] = ("current",),
    voltage: float = 3.0,
) -> Identifiability:
    """Tell which parameters runs could determine if they were perfect, before any is recorded.

    For a linear actuator that is the rank of the derivatives of the transfer function by every free parameter, exact
    at all frequencies that its poles reach; with a leak, or before a laser, of the response to a staircase of voltages.
    It holds at the actuator's values, and at almost all others.

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
    need_actuator(actuator)
    asked = _outputs(outputs)
    if not (math.isfinite(voltage) and voltage > 0.0):
        raise InputError(
            f"the largest voltage is {voltage:g} V, it must be above 0",
            code="out-of-range",
            where="voltage",
            repair="give the largest voltage that the runs apply",
        )
    names = parse_free(actuator.parameter_values, free).actuator
    matrix = sensitivity(actuator, names, asked, voltage=voltage)
    singular, null = null_space(matrix, _NOTHING if actuator.system.law_ports is None else _NOTHING_OF_LAWS)
    found = tuple(
        direction(names, row, asked, cures_of(names, row, others(actuator, names, asked, row, voltage=voltage)))
        for row in null
    )
    return Identifiability(names, asked, len(names) - len(null), tuple(map(float, singular)), found)


def direction(names: Sequence[str], row: FloatArray, outputs: Sequence[str], cures: Sequence[Cure]) -> Direction:
    """A combination that no reading of some outputs shows."""
    coefficients = dict(zip(names, map(float, row), strict=True))
    moved = sorted((name for name in names if abs(coefficients[name]) > 1e-3), key=lambda n: -abs(coefficients[n]))
    listed = " and ".join(outputs)
    what = (
        f"{listed} says nothing of {moved[0]}"
        if len(moved) == 1
        else f"{', '.join(moved)} can move together without changing the {listed}"
    )
    return Direction(coefficients, f"{what}: {said_of(cures, moved)}", math.inf, tuple(cure.name for cure in cures))


def sensitivity(
    actuator: Actuator, names: Sequence[str], outputs: Sequence[str], *, voltage: float = 3.0
) -> FloatArray:
    """Relative change of the outputs for a relative change of each parameter, shape (n_rows, n_names).

    A parameter that may be zero counts against its usual size where that is larger.
    """
    sizes = _sizes(actuator, names)
    if actuator.system.law_ports is None and not (actuator.structure.laser and "displacement" in outputs):
        return _over_frequencies(actuator, names, outputs) * sizes
    return _over_staircase(actuator, names, outputs, voltage) * sizes


def null_space(matrix: FloatArray, nothing: float = _NOTHING) -> tuple[FloatArray, FloatArray]:
    """Singular values (columns of length 1), and unit vectors that the matrix maps to nothing, one a row.

    Where there are several they are combined so that each has as few parameters as possible.

    Examples
    --------
    >>> null_space(np.array([[1.0, 1.0, 0.0], [2.0, 2.0, 0.0]]))[1].round(6) + 0.0
    array([[ 0.707107, -0.707107,  0.      ],
           [ 0.      ,  0.      ,  1.      ]])
    """
    count = matrix.shape[1]
    size = np.linalg.norm(matrix, axis=0)
    # A parameter that changes nothing keeps its column of zeros.
    size[size <= _NOTHING * size.max(initial=0.0)] = np.inf
    scaled = matrix / size
    singular, directions = np.linalg.svd(scaled, full_matrices=True)[1:]
    singular = np.concatenate([singular, np.zeros(count - len(singular))])
    null = directions[singular <= nothing * max(float(singular[0]), 1e-300)]
    size[np.isinf(size)] = 1.0
    return singular, sparse(null / size)


def sparse(null: FloatArray) -> FloatArray:
    """A basis of the same directions in which each has a parameter that no other has; unit vectors, one a row."""
    if not null.size:
        return null
    left = null.copy()
    for row in range(len(left)):
        left[row:] /= np.maximum(np.linalg.norm(left[row:], axis=1), 1e-300)[:, None]
        place, column = divmod(int(np.abs(left[row:]).argmax()), left.shape[1])
        left[[row, row + place]] = left[[row + place, row]]
        left[row] /= left[row, column]
        others = np.arange(len(left)) != row
        left[others] -= np.outer(left[others, column], left[row])
    left /= np.linalg.norm(left, axis=1)[:, None]
    return np.asarray(left * np.sign(left[np.arange(len(left)), np.abs(left).argmax(axis=1)])[:, None])


def others(
    actuator: Actuator, names: Sequence[str], outputs: Iterable[str], row: FloatArray, *, voltage: float = 3.0
) -> tuple[str, ...]:
    """Outputs beside these that would show a combination, in the order in which they are easy to read."""
    have = set(outputs)
    rounding = _SHOWN if actuator.system.law_ports is None else _SHOWN_BY_LAWS
    found = []
    for output in ("current", "force", "displacement"):
        if output in have:
            continue
        matrix = sensitivity(actuator, names, [output], voltage=voltage)
        largest = float(np.linalg.norm(matrix * row, axis=1).max(initial=0.0))
        if largest > 0.0 and float(np.linalg.norm(matrix @ row)) > rounding * largest:
            found.append(output)
    return tuple(found)


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


def _sizes(actuator: Actuator, names: Sequence[str]) -> FloatArray:
    known = actuator.parameters()
    unknowns = [actuator_unknown(known[name], None) for name in names]
    return np.array([max(abs(actuator[one.base]), one.lower if one.log else one.scale) for one in unknowns])


def _over_frequencies(actuator: Actuator, names: Sequence[str], outputs: Sequence[str]) -> FloatArray:
    """Of the transfer function along the imaginary axis, by each parameter [1/SI]; exact, by a complex step."""
    system = actuator.system
    poles = np.abs(np.linalg.eigvals(system.a))
    slowest, fastest = float(poles.min(initial=np.inf)), float(poles.max(initial=0.0))
    if not np.isfinite(slowest):
        slowest = fastest = 1.0
    first, last = slowest / _EACH_SIDE, fastest * _EACH_SIDE
    omega = np.geomspace(first, last, math.ceil(_A_DECADE * math.log10(last / first)))
    chosen = choose_outputs(outputs)
    c, d = system.c[chosen], system.d[chosen, 0]
    matrix = 1j * omega[:, None, None] * np.eye(len(system.states)) - system.a
    state = np.linalg.solve(matrix, np.broadcast_to(system.b[:, :1].astype(complex), (len(omega), len(system.b), 1)))
    # c (s - a)^-1 of all outputs, as a row each.
    reach = np.swapaxes(
        np.linalg.solve(np.swapaxes(matrix, 1, 2), np.broadcast_to(c.T.astype(complex), (len(omega), *c.T.shape))), 1, 2
    )
    response = (c @ state)[:, :, 0] + d
    found = np.empty((len(omega), len(chosen), len(names)), dtype=complex)
    for column, name in enumerate(names):
        moved = actuator.assembled({**actuator.parameter_values, name: complex(actuator[name], _COMPLEX_STEP)})
        by_a, by_b, by_c, by_d = (
            np.imag(part) / _COMPLEX_STEP for part in (moved.a, moved.b, moved.c[chosen], moved.d[chosen, 0])
        )
        found[:, :, column] = (by_c @ state + reach @ (by_a @ state + by_b[:, :1]))[:, :, 0] + by_d
    relative = (found / np.maximum(np.abs(response), 1e-300)[:, :, None]).reshape(-1, len(names))
    return np.vstack([relative.real, relative.imag])


def _over_staircase(actuator: Actuator, names: Sequence[str], outputs: Sequence[str], voltage: float) -> FloatArray:
    """Of the response to steps of several heights, each from its first moment to its last, by each parameter [1/SI]."""
    from ipmclab.model.numerics.reduce import small_signal
    from ipmclab.model.sensitivity import sensitivities

    rates = np.abs(np.linalg.eigvals(small_signal(actuator.system).a))
    # What is faster than a row of any record is not looked for.
    fastest, slowest = min(float(rates.max(initial=1.0)), 1e5), max(float(rates.min(initial=1.0)), 1e-5)
    after = np.concatenate([[0.0], np.logspace(np.log10(0.05 / fastest), np.log10(5.0 / slowest), _ROWS)])
    length = 1.2 * float(after[-1])
    time = np.concatenate([place * length + after for place in range(len(_LEVELS))])
    volts = np.repeat(voltage * np.array(_LEVELS), len(after))
    found = sensitivities(actuator, tuple(names), time, volts, "zero", outputs=tuple(outputs), asked=())
    size = np.abs(found.values).max(axis=1, initial=0.0)
    return np.concatenate([by / one for by, one in zip(found.parameters, size, strict=True) if one > 0.0])
