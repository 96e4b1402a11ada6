"""The sensitivity of an actuator over its closed form, without data: what outputs show of parameters, and what not."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from ipmclab.identification.problem.unknowns import actuator_unknown
from ipmclab.model import Actuator
from ipmclab.model.numerics.reduce import small_signal
from ipmclab.model.ports import choose_outputs
from ipmclab.model.sensitivity import sensitivities
from ipmclab.run import FloatArray
from ipmclab.ties import largest_first, upright

NOTHING: Final = 1e-9
"""A singular value below this part of the largest (columns of length 1) is rounding."""

NOTHING_OF_LAWS: Final = 1e-5
"""The same where static laws are solved from row to row, which is no closed form."""

_SHOWN: Final = 1e-6  # part of what its parameters change one by one that a combination must change, to be shown
_SHOWN_BY_LAWS: Final = 1e-4  # likewise, where laws are solved from row to row

_COMPLEX_STEP: Final = 1e-100  # of a parameter: its square vanishes compared with 1
_EACH_SIDE: Final = 20.0  # times the fastest pole, and a part of the slowest: how far frequencies reach
_A_DECADE: Final = 12  # frequencies in each
_LEVELS: Final = (0.3, -0.6, 1.0, -0.8, 0.5, -1.0, 0.7)  # of the largest voltage: a staircase for what is not linear
_ROWS: Final = 40  # of each step of it


def sensitivity(actuator: Actuator, names: Sequence[str], outputs: Sequence[str], *, voltage: float) -> FloatArray:
    """Relative change of the outputs for a relative change of each parameter, shape (n_rows, n_names).

    A parameter that may be zero counts against its usual size where that is larger.
    """
    known = actuator.parameters()
    unknowns = [actuator_unknown(known[name], None) for name in names]
    sizes: FloatArray = np.array(
        [max(abs(actuator[one.base]), one.lower if one.log else one.scale) for one in unknowns]
    )
    if actuator.system.law_ports is None and not (actuator.structure.laser and "displacement" in outputs):
        return _over_frequencies(actuator, names, outputs) * sizes
    return _over_staircase(actuator, names, outputs, voltage) * sizes


def null_space(matrix: FloatArray, nothing: float = NOTHING) -> tuple[FloatArray, FloatArray]:
    """Singular values (columns of length 1), and unit vectors that the matrix maps to nothing, one a row.

    Where there are several they are combined so that each has as few parameters as possible.

    Examples
    --------
    >>> null_space(np.array([[1.0, 2.0], [3.0, 6.0]]))[1].round(4)
    array([[ 0.8944, -0.4472]])
    """
    count = matrix.shape[1]
    size = np.linalg.norm(matrix, axis=0)
    # A parameter that changes nothing keeps its column of zeros.
    size[size <= NOTHING * size.max(initial=0.0)] = np.inf
    scaled = matrix / size
    singular, directions = np.linalg.svd(scaled, full_matrices=True)[1:]
    singular = np.concatenate([singular, np.zeros(count - len(singular))])
    null = directions[singular <= nothing * max(float(singular[0]), 1e-300)]
    size[np.isinf(size)] = 1.0
    return singular, sparse(null / size)


def sparse(null: FloatArray) -> FloatArray:
    """A basis of the same directions in which each has a parameter that no other has; unit vectors, one a row.

    Those parameters are the ones that move most along the directions, whatever basis of them is given: first the one
    that moves most of all, then the one that moves most where those before it stand still.
    """
    if not null.size:
        return null
    basis = np.linalg.qr(null.T)[0].T
    left, chosen = basis.copy(), list[int]()
    for _ in basis:
        chosen.append(largest_first((left * left).sum(axis=0))[0])
        along = left[:, chosen[-1]] / max(float(np.linalg.norm(left[:, chosen[-1]])), 1e-300)
        left -= np.outer(along, along @ left)
    rows = np.linalg.solve(basis[:, chosen], basis)
    return np.array([upright(row / np.linalg.norm(row)) for row in rows])


def others(
    actuator: Actuator, names: Sequence[str], outputs: Iterable[str], row: FloatArray, *, voltage: float
) -> tuple[str, ...]:
    """Outputs in addition to these that would show a combination, in the order in which they are easy to read."""
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


def _over_frequencies(actuator: Actuator, names: Sequence[str], outputs: Sequence[str]) -> FloatArray:
    """Of the transfer function along the imaginary axis, by each parameter [1/SI]; exact, by a complex step."""
    system = actuator.system
    poles = np.abs(np.linalg.eigvals(system.a))
    # Compared with the fastest a pole that rounding hides is none: it does not move for as long as floating point can
    # show.
    poles = poles[poles > np.finfo(np.float64).eps * poles.max(initial=0.0)]
    slowest, fastest = (float(poles.min()), float(poles.max())) if len(poles) else (1.0, 1.0)
    first, last = slowest / _EACH_SIDE, fastest * _EACH_SIDE
    omega = np.geomspace(first, last, math.ceil(_A_DECADE * math.log10(last / first)))
    chosen = choose_outputs(outputs)
    c, d = system.c[chosen], system.d[chosen, 0]
    matrix = 1j * omega[:, None, None] * np.eye(len(system.states)) - system.a
    state = np.linalg.solve(matrix, system.b[:, :1])
    # c (s - a)^-1 of all outputs, as a row each.
    reach = np.swapaxes(np.linalg.solve(np.swapaxes(matrix, 1, 2), c.T), 1, 2)
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
