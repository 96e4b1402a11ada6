"""Exact discretisation of the assembled system: no approximation but rounding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.assemble import System
from ipmclab.model.blocks import Matrix

_SERIES_REACH: Final = 0.25
_SERIES_TERMS: Final = 14  # 0.5^15/15! is below 1e-16


@dataclass(frozen=True, eq=False)
class Transition:
    """What an interval does to the state: ``x+ = state x + constant v0 + slope (v1 - v0)``.

    Within the interval the voltage goes in a straight line from v0 to v1; it is constant where
    they are equal. Leading axes count intervals, and systems before them.

    Parameters
    ----------
    state : matrix, shape (..., n_states, n_states)
    constant, slope : matrix, shape (..., n_states)
    """

    state: Matrix
    constant: Matrix
    slope: Matrix


def transitions(systems: Sequence[System], durations: npt.ArrayLike) -> Transition:
    """The exact transitions over some durations, by the matrix exponential.

    It does not know what a pole is, so that equal and nearly equal poles are as good as any.

    Parameters
    ----------
    systems : sequence of System
        Systems with the same states: one, or one (complex) for each parameter of a derivative.
    durations : float array, shape (n_durations,) [s]

    Returns
    -------
    transition : Transition, leading axes (n_systems, n_durations)
    """
    from scipy.linalg import expm, matrix_balance

    n = len(systems[0].states)
    steps = np.asarray(durations, dtype=np.float64)
    # Displacement and velocity differ by the natural frequency: scaled alike, the exponential
    # needs fewer squarings. The scales are powers of two, which cost no digit.
    scales = matrix_balance(systems[0].a.real, permute=False, separate=True)[1][0]
    kind = np.result_type(*(system.a for system in systems))
    # The exponential of [[A, B, 0], [0, 0, 1], [0, 0, 0]] t holds the state matrix, the response to a
    # constant 1 V and, times t, the response to a slope that reaches 1 V at t.
    generator = np.zeros((len(systems), 1, n + 2, n + 2), kind)
    for index, system in enumerate(systems):
        generator[index, 0, :n, :n] = system.a * scales / scales[:, None]
        generator[index, 0, :n, n] = system.b[:, 0] / scales
    generator[..., n, n + 1] = 1.0
    # A jittering clock has as many durations as rows: one exponential serves all that lie close
    # together, and a short series the small rest of each.
    width = 2.0 * _SERIES_REACH / np.max(np.sum(np.abs(generator[0, 0]), axis=1))
    _, group, counts = np.unique(np.round(steps / width), return_inverse=True, return_counts=True)
    centres = np.bincount(group, weights=steps) / counts
    exponential = expm(generator * centres[:, None, None])[:, group]
    rest = steps - centres[group]
    if np.any(rest):
        exponential = exponential @ _short_exponential(generator * rest[:, None, None])
    return Transition(
        state=exponential[..., :n, :n] * scales[:, None] / scales,
        constant=exponential[..., :n, n] * scales,
        slope=exponential[..., :n, n + 1] * scales / steps[:, None],
    )


def _short_exponential(matrices: Matrix) -> Matrix:
    """Exponentials of matrices of a norm up to 2 ``_SERIES_REACH``, to rounding, by their series."""
    one = np.eye(matrices.shape[-1])
    total = one + matrices / _SERIES_TERMS
    for k in range(_SERIES_TERMS - 1, 0, -1):
        total = one + matrices @ total / k
    return total
