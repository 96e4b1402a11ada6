"""Derivatives of outputs by modes: the fast way where the poles of a system lie apart.

With the eigenvectors V of a, their inverse W, and s_j what the pole p_j alone answers to the voltage, the state is the
sum of V_j (W b)_j s_j. A change da moves it by the sum over j and k of V_j (W da V)_jk (W b)_k times the divided
difference of the answers, (s_j - s_k)/(p_j - p_k), or for j = k the slope of s_j by its pole (the derivative of a
function of a matrix: Higham, Functions of Matrices, 2008, theorem 3.11). So every derivative is a sum of the same
answers and slopes, however many parameters there are. An initial state does as the voltage, and answers exponentials.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.timeline import Timeline

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

LOST: Final = 1e-10
"""Part of a derivative that rounding may take, as poles lie close together, before another way must answer."""

_SERIES: Final = 0.5
_TERMS: Final = 16  # 0.5^16/16! is below 1e-18
_WEIGHTS: Final = {order: [1 / math.factorial(k + order) for k in range(_TERMS, -1, -1)] for order in (1, 2)}
_SLOPE_WEIGHTS: Final = {order: [k / math.factorial(k + order) for k in range(_TERMS, 0, -1)] for order in (1, 2)}


class Slopes(NamedTuple):
    """A linear system with one input, and the derivatives of its matrices along a first axis of parameters.

    Parameters
    ----------
    a, b, c, d : float arrays, shapes (n, n), (n,), (n_outputs, n), (n_outputs,)
    d_a, d_b, d_c, d_d : float arrays, with (n_parameters,) in front
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray
    d_a: FloatArray
    d_b: FloatArray
    d_c: FloatArray
    d_d: FloatArray


class Modes(NamedTuple):
    """The modes of a system, and how they change.

    Parameters
    ----------
    slopes : Slopes
    poles : complex array, shape (n,) [1/s]
    left : complex array, shape (n, n)
        W: how a mode sees a state.
    read : complex array, shape (n_outputs, n)
        c V: how an output sees a mode.
    d_read : complex array, shape (n_parameters, n_outputs, n)
        d_c V.
    mixed : complex array, shape (n_parameters, n, n)
        W d_a V over the differences of the poles; 0 on the diagonal.
    moved : complex array, shape (n_parameters, n) [1/s]
        The diagonal of W d_a V: the derivatives of the poles.
    """

    slopes: Slopes
    poles: ComplexArray
    left: ComplexArray
    read: ComplexArray
    d_read: ComplexArray
    mixed: ComplexArray
    moved: ComplexArray

    @classmethod
    def of(cls, slopes: Slopes) -> Modes | None:
        """The modes; None where the poles lie too close together for digits to be left."""
        from scipy.linalg import matrix_balance

        if not slopes.a.size or not np.all(np.isfinite(slopes.a)):
            return None
        balanced, (scales, _) = matrix_balance(slopes.a, permute=False, separate=True)
        try:
            poles, right = np.linalg.eig(balanced)
        except np.linalg.LinAlgError:
            return None
        apart = poles[:, None] - poles
        np.fill_diagonal(apart, np.inf)
        # Poles and eigenvectors are as sure as rounding of the whole matrix leaves them.
        nearest = np.minimum(np.abs(apart).min(axis=0), np.abs(poles))
        unsure = np.finfo(float).eps * np.linalg.norm(balanced) / np.maximum(nearest, np.finfo(float).tiny)
        if not np.linalg.cond(right) * unsure.max() < LOST:
            return None
        left = np.linalg.inv(right)
        # These must be the modes of this very matrix, entry by entry: a small one may be all that drives a force.
        size = np.minimum(np.linalg.norm(balanced, axis=1)[:, None], np.linalg.norm(balanced, axis=0))
        wrong = np.abs((right * poles) @ left - balanced)
        if np.any(wrong > LOST * np.where(balanced != 0.0, np.abs(balanced), size)):
            return None
        right, left = scales[:, None] * right, left / scales
        change = left @ slopes.d_a @ right
        moved = np.diagonal(change, axis1=-2, axis2=-1).copy()
        mixed = change / apart
        return cls(slopes, poles, left, slopes.c @ right, slopes.d_c @ right, mixed, moved)

    def weights(self, driven: ComplexArray, d_driven: ComplexArray) -> ComplexArray:
        """What makes the derivatives of outputs of the poles' answers and slopes.

        Parameters
        ----------
        driven : complex array, shape (n,)
            How the modes are driven: W b, or W times an initial state.
        d_driven : complex array, shape (n_parameters, n)
            The derivatives of that, as W d_b.

        Returns
        -------
        weights : complex array, shape (n_outputs, 2 n, n_parameters)
        """
        own = self.read * driven
        by = self.d_read * driven + self.read * (self.mixed @ driven + d_driven)[:, None, :]
        by -= (self.read @ self.mixed) * driven
        return np.concatenate([by, own * self.moved[:, None, :]], axis=2).transpose(1, 2, 0)


def modal_tangents(
    modes: Modes, line: Timeline, state: FloatArray, *, by_states: bool
) -> tuple[FloatArray, FloatArray]:
    """Derivatives of the outputs over a time line.

    Parameters
    ----------
    modes : Modes
    line : Timeline
    state : float array, shape (n,)
        The initial state.
    by_states : bool
        Whether derivatives by it are wanted; they are 0 otherwise.

    Returns
    -------
    parameters : float array, shape (n_outputs, n_time, n_parameters)
    states : float array, shape (n_outputs, n_time, n)
    """
    given = modes.slopes
    kept = np.flatnonzero(modes.poles.imag >= 0.0)  # the other of a pair answers the conjugate
    rows, n = len(line.reading), len(modes.poles)
    is_pair = modes.poles[kept].imag > 0.0
    times = np.where(is_pair, 2.0, 1.0)
    voltage = _answers(modes.poles[kept], line, 0.0)
    drives = [(voltage, given.b, given.d_b)]
    moves = bool(np.any(state))
    if moves or by_states:
        free = _answers(modes.poles[kept], line, 1.0)
    if moves:  # at rest it stays out of the sum below: with more terms, though they are 0, that rounds otherwise
        drives.append((free, state, np.zeros((len(given.d_b), n))))
    columns: list[FloatArray] = [line.reading[:, None]]
    weights: list[FloatArray] = [given.d_d.T[:, None, :]]
    for answers, drive, d_drive in drives:
        of_all = modes.weights(modes.left @ drive, d_drive @ modes.left.T)
        of_kept = of_all[:, np.concatenate([kept, n + kept])] * np.tile(times, 2)[:, None]
        columns += [answers.real, answers.imag[:, np.tile(is_pair, 2)]]
        weights += [of_kept.real, -of_kept.imag[:, np.tile(is_pair, 2)]]
    parameters = np.hstack(columns) @ np.concatenate(weights, axis=1)
    states = np.zeros((len(given.c), rows, n))
    if by_states:
        sees = modes.read[:, kept, None] * modes.left[kept] * times[:, None]
        states = free.real[:, : len(kept)] @ sees.real - free.imag[:, : len(kept)] @ sees.imag
    return parameters, states


def _answers(poles: ComplexArray, line: Timeline, first: float) -> ComplexArray:
    """What each pole answers at each row, and its slope by the pole, shape (n_time, 2 n_poles).

    Parameters
    ----------
    first : float
        0: from rest to the voltage; 1: from 1, without a voltage.
    """
    from ipmclab.model.numerics.tangents_modal_loop import pole_answers

    answers = np.empty((len(line.reading), 2 * len(poles)), dtype=np.complex128)
    moves: list[Any] = [*_moves(poles, line.durations, driven=1.0 - first)]
    pole_answers(*moves, *[line.interval, line.start, line.end, line.row, first, answers])
    return answers


def _moves(poles: ComplexArray, durations: FloatArray, driven: float) -> tuple[npt.NDArray[Any], ...]:
    """What an interval of each kind does to an answer, each of shape (n_kinds, n_poles).

    ``s+ = decay s + held u0 + ramped (u1 - u0)``; then the derivatives of these three by the pole.
    """
    length = durations[:, None]
    x = poles * length
    small = np.abs(x) < _SERIES
    safe = np.where(small, 1.0, x)
    decay = np.exp(x)
    # (e^x - 1)/x and (e^x - 1 - x)/x^2, and their derivatives
    first = np.where(small, _series(x, 1), (decay - 1.0) / safe)
    second = np.where(small, _series(x, 2), (first - 1.0) / safe)
    d_first = np.where(small, _series(x, 1, slope=True), (decay - first) / safe)
    d_second = np.where(small, _series(x, 2, slope=True), (d_first - second) / safe)
    square = driven * length * length
    return (
        decay,
        driven * length * first,
        driven * length * second,
        length * decay,
        square * d_first,
        square * d_second,
    )


def _series(x: ComplexArray, order: int, *, slope: bool = False) -> ComplexArray:
    """The sum of x^k/(k + order)!, or its derivative."""
    found = np.zeros_like(x)
    for weight in _SLOPE_WEIGHTS[order] if slope else _WEIGHTS[order]:
        found = found * x + weight
    return found
