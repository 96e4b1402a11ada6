"""Exact discretisation of the assembled system: no approximation but rounding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.assemble import System
from ipmclab.model.blocks import Matrix

_SERIES_REACH: Final = 0.25
_SERIES_TERMS: Final = 14  # 0.5^15/15! is below 1e-16
_LONG_TERMS: Final = 19  # 1/20! is below 1e-18


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

    state: Matrix
    constant: Matrix
    slope: Matrix
    law_begin: Matrix
    law_end: Matrix


@np.errstate(over="ignore", invalid="ignore")  # durations beyond floating point give NaN, which ``simulate`` refuses
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
    n = len(systems[0].states)
    inputs = [
        system.b if (ports := system.law_ports) is None else np.hstack([system.b, ports.drive]) for system in systems
    ]
    m = inputs[0].shape[1]
    steps = np.asarray(durations, dtype=np.float64)
    # Displacement and velocity differ by the natural frequency: scaled alike, the exponential
    # needs fewer squarings. The scales are powers of two, which cost no digit.
    _, scales = balanced(systems[0].a.real)
    kind = np.result_type(*(system.a for system in systems), *inputs)
    # The exponential of [[A, B, 0], [0, 0, 1], [0, 0, 0]] t holds the state matrix, the response to a
    # constant 1 (V, N or A) and, times t, the response to a slope that reaches 1 at t.
    generator = np.zeros((len(systems), 1, n + 2 * m, n + 2 * m), kind)
    for index, system in enumerate(systems):
        generator[index, 0, :n, :n] = system.a * scales / scales[:, None]
        generator[index, 0, :n, n : n + m] = inputs[index] / scales[:, None]
    generator[..., range(n, n + m), range(n + m, n + 2 * m)] = 1.0
    # An input is brought to about 1 by a power of two as well: its size costs neither squarings nor digits.
    size = np.abs(generator[0, 0, :n, n : n + m]).max(axis=0, initial=0.0)
    levels = np.exp2(np.round(np.log2(np.where(size > 0.0, size, 1.0))))
    generator[..., :n, n : n + m] /= levels
    # A jittering clock has as many durations as rows: one exponential serves all that lie close
    # together, and a short series the small rest of each.
    width = 2.0 * _SERIES_REACH / np.max(np.sum(np.abs(generator[0, 0]), axis=1))
    _, group, counts = np.unique(np.round(steps / width), return_inverse=True, return_counts=True)
    centres = np.bincount(group, weights=steps) / counts
    exponential = _exponentials(generator * centres[:, None, None])[:, group]
    rest = steps - centres[group]
    if np.any(rest):
        exponential = exponential @ _short_exponential(generator * rest[:, None, None])
    held = exponential[..., :n, n : n + m] * scales[:, None] * levels
    ramped = exponential[..., :n, n + m :] * scales[:, None] * levels / steps[:, None, None]
    given = len(systems[0].inputs)
    return Transition(
        state=exponential[..., :n, :n] * scales[:, None] / scales,
        constant=held[..., :given],
        slope=ramped[..., :given],
        law_begin=held[..., given:] - ramped[..., given:],
        law_end=ramped[..., given:],
    )


def balanced(matrix: Matrix) -> tuple[Any, Any]:
    """A real matrix whose rows and columns have been scaled alike by powers of two, and these (LAPACK's dgebal)."""
    from scipy.linalg.lapack import dgebal

    if not matrix.size:
        return matrix, np.ones(len(matrix))
    found, _, _, scales, _ = dgebal(matrix, scale=1, permute=0)
    return found, scales


def _exponentials(matrices: Matrix) -> Matrix:
    """Exponentials of matrices of any norm, shape (n_systems, n_durations, n, n): scaled, by their series, squared.

    What is squared is the exponential less 1, so that what moves slowly keeps its digits. Products of small matrices
    are all it takes: scipy's expm hands them to threads, which on a busy machine costs a thousand times as much.
    """
    norms = np.max(np.sum(np.abs(matrices[0]), axis=-2), axis=-1)
    within = np.clip(norms, 1.0, np.finfo(float).max)  # of one beyond floating point NaN comes out, and is refused
    squarings = np.ceil(np.log2(within)).astype(np.int64)
    scaled = matrices * np.exp2(-squarings)[:, None, None]
    less_1: Matrix = scaled @ _short_exponential(scaled, terms=_LONG_TERMS, least=2)
    for done in range(int(squarings.max(initial=0))):
        some = np.flatnonzero(squarings > done)
        part = less_1[:, some]
        less_1[:, some] = 2.0 * part + part @ part
    whole: Matrix = less_1 + np.eye(matrices.shape[-1])
    return whole


def _short_exponential(matrices: Matrix, *, terms: int = _SERIES_TERMS, least: int = 1) -> Matrix:
    """Exponentials of matrices of a norm up to 2 ``_SERIES_REACH``, to rounding, by their series.

    With ``least`` = 2 it is (exp(M) - 1)/M; with ``_LONG_TERMS`` terms the norm may be 1.
    """
    one = np.eye(matrices.shape[-1])
    total = one + matrices / terms
    for k in range(terms - 1, least - 1, -1):
        total = one + matrices @ total / k
    return total
