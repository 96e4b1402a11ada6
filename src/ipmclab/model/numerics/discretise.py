"""Exact discretisation of the assembled system: no approximation but rounding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ipmclab.model.assemble import System
from ipmclab.model.blocks import Matrix

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Transition:
    """What an interval does: ``x+ = state x + constant u0 + slope (u1 - u0) + law_begin w0 + law_end w1``.

    Within the interval the inputs go in straight lines from u0 to u1, and what the laws give from w0 to w1;
    they are constant where both ends are equal. Leading axes count intervals, and systems before them.

    Parameters
    ----------
    state : matrix, shape (..., n_states, n_states)
    constant, slope : matrix, shape (..., n_states, n_inputs)
    law_begin, law_end : matrix, shape (..., n_states, n_laws)
    """

    state: FloatArray
    constant: FloatArray
    slope: FloatArray
    law_begin: FloatArray
    law_end: FloatArray


def transitions(systems: Sequence[System], durations: npt.ArrayLike) -> Transition:
    """The exact transitions over some durations, by the matrix exponential.

    It does not know what a pole is, so that equal and nearly equal poles are as good as any.

    Parameters
    ----------
    systems : sequence of System
        Systems with the same states.
    durations : float array, shape (n_durations,) [s]
        Beyond floating point they give NaN, which ``simulate`` refuses.

    Returns
    -------
    transition : Transition, leading axes (n_systems, n_durations)
    """
    n, given = len(systems[0].states), len(systems[0].inputs)
    steps = np.array([step_of(system, durations) for system in systems])
    laws = (steps.shape[-1] - 2 * given - n) // 2
    ends = np.cumsum([given, given, n, laws, laws])[:-1]
    constant, slope, state, law_begin, law_end = np.split(steps, ends, axis=-1)
    return Transition(state, constant, slope, law_begin, law_end)


def step_of(system: System, durations: npt.ArrayLike) -> FloatArray:
    """What intervals of some durations do to a system: the step of ``step_and_slopes``."""
    ports = system.law_ports
    drive = system.b if ports is None else np.hstack([system.b, ports.drive])
    return step_and_slopes(system.a, drive, len(system.inputs), np.asarray(durations, dtype=np.float64))[0]


def step_and_slopes(
    a: FloatArray,
    drive: FloatArray,
    inputs: int,
    durations: FloatArray,
    moved: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """What intervals do to a system, and the derivatives of that.

    Parameters
    ----------
    a, drive : float arrays, shapes (n, n), (n, n_inputs + n_laws)
    inputs : int
        How many inputs there are before the laws.
    durations : float array, shape (n_durations,) [s]
    moved : pair of float arrays, optional
        Derivatives of ``a`` and ``drive``, with an axis of columns behind, of a multiple of ``vectors_loop.WIDTH``.

    Returns
    -------
    step : float array, shape (n_durations, n, 2 n_inputs + n + 2 n_laws)
        The matrices of ``Transition`` side by side: constant, slope, state, law_begin and law_end.
    by_step : float array
        Its derivatives, with an axis of columns behind; without columns where none are given.
    """
    from ipmclab.model.numerics.transitions_loop import room, transition_slopes, transitions

    n, driven = drive.shape
    step = np.empty((len(durations), n, n + 2 * driven))
    # Displacement and velocity differ by the natural frequency: scaled alike, fewer doubles are needed.
    _, scales = balanced(a)
    a, drive = np.ascontiguousarray(a, dtype=np.float64), np.ascontiguousarray(drive, dtype=np.float64)
    written = room(n, driven, moved=moved is not None)
    transitions(a, drive, inputs, scales, durations, written, step)
    by_step = np.empty((*step.shape, 0 if moved is None else moved[0].shape[-1]))
    if moved is not None:
        transition_slopes(a, drive, inputs, *moved, scales, durations, written, by_step)
    return step, by_step


def balanced(matrix: Matrix) -> tuple[Any, Any]:
    """A real matrix whose rows and columns have been scaled alike by powers of two, and these (LAPACK's dgebal)."""
    from scipy.linalg.lapack import dgebal

    if not matrix.size:
        return matrix, np.ones(len(matrix))
    found, _, _, scales, _ = dgebal(matrix, scale=1, permute=0)
    return found, scales
