"""Derivatives of outputs by modes: the fast way where the poles of a system lie apart.

With the eigenvectors V of a, their inverse W, and s_j what the pole p_j alone answers to the voltage, the state is the
sum of V_j (W b)_j s_j. A change da moves it by the sum over j and k of V_j (W da V)_jk (W b)_k times the divided
difference of the answers, (s_j - s_k)/(p_j - p_k), or for j = k the slope of s_j by its pole (the derivative of a
function of a matrix: Higham, Functions of Matrices, 2008, theorem 3.11). So every derivative is a sum of the same
answers and slopes, however many parameters there are. An initial state does as the voltage, and answers exponentials.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.discretise import balanced
from ipmclab.model.numerics.eigenvectors import eigenvectors
from ipmclab.model.numerics.timeline import Timeline

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

LOST: Final = 1e-10
"""Part of a derivative that rounding may take, as poles lie close together, before another way must answer."""


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


@dataclass(frozen=True, eq=False)
class Modes:
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
        if not slopes.a.size or not np.all(np.isfinite(slopes.a)):
            return None
        balance, scales = balanced(slopes.a)
        found = eigenvectors(balance)
        if found is None:
            return None
        poles, right, left, rounding = found
        own, seen = scales[:, None] * right, left / scales  # those of the matrix itself
        change = seen @ slopes.d_a @ own
        apart = poles[:, None] - poles
        # Modes that no parameter mixes, as of stages side by side, may lie as close together as they like.
        is_mixed = np.any(change != 0.0, axis=0)
        apart[~(is_mixed | is_mixed.T)] = np.inf
        np.fill_diagonal(apart, np.inf)
        nearest = np.minimum(np.abs(apart).min(axis=0), np.abs(poles))
        condition = np.linalg.norm(right) * np.linalg.norm(left)
        if not np.all(condition * rounding < LOST * nearest):
            return None
        moved = np.diagonal(change, axis1=-2, axis2=-1).copy()
        mixed = change / apart
        return cls(slopes, poles, seen, slopes.c @ own, slopes.d_c @ own, mixed, moved)

    @cached_property
    def by_voltage(self) -> ComplexArray:
        """The weights of what the voltage drives: all runs of a strip share them."""
        return self.weights(self.left @ self.slopes.b, self.slopes.d_b @ self.left.T)

    def weights(self, driven: ComplexArray, d_driven: ComplexArray | FloatArray) -> ComplexArray:
        """What makes the derivatives of outputs of the poles' answers and slopes.

        Parameters
        ----------
        driven : complex array, shape (n,)
            How the modes are driven: W b, or W times an initial state.
        d_driven : complex array, shape (n_parameters, n)
            The derivatives of that, as W d_b.

        Returns
        -------
        weights : complex array, shape (n_outputs, n_parameters, 2 n)
        """
        own = self.read * driven
        by = self.d_read * driven + self.read * (self.mixed @ driven + d_driven)[:, None, :]
        by -= (self.read @ self.mixed) * driven
        return np.concatenate([by, own * self.moved[:, None, :]], axis=2).transpose(1, 0, 2)


def modal_tangents(
    modes: Modes, line: Timeline, state: FloatArray, *, by_states: bool
) -> tuple[tuple[FloatArray, FloatArray], FloatArray, FloatArray, FloatArray]:
    """The outputs over a time line and their derivatives, as sums of what the poles answer.

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
    values, sizes : float array, shapes (n_outputs, n_time) and (n_outputs,)
        The outputs, and of each the sum of the largest sizes of what its poles answer, which may cancel.
    courses : float array, shape (n_courses, n_time)
        The voltage as it is read, what the poles answer, and the slopes of that.
    by_parameters : float array, shape (n_outputs, n_parameters, n_first)
        How much of the first of them, or of all, is in the derivative by each parameter.
    by_initial : float array, shape (n_outputs, n, n_first)
        In that by each initial state.
    """
    given = modes.slopes
    kept = np.flatnonzero(modes.poles.imag >= 0.0)  # the other of a pair answers the conjugate
    n, outputs = len(modes.poles), len(given.c)
    is_pair = np.tile(modes.poles[kept].imag > 0.0, 2)
    times = np.where(is_pair, 2.0, 1.0)

    def of_kept(weights: ComplexArray) -> list[FloatArray]:
        """By real and imaginary parts of the answers; without those that are 0."""
        return [weights.real, -weights.imag[..., is_pair]]

    def of_each(weights: ComplexArray) -> list[FloatArray]:
        return of_kept(weights[..., np.concatenate([kept, n + kept])] * times)

    def answered(drive: FloatArray, answers: ComplexArray) -> tuple[FloatArray, FloatArray]:
        """The outputs, of what the poles answer to a drive, and the sum of the sizes of that, by its larger parts."""
        own = modes.read[:, kept] * (modes.left[kept] @ drive) * times[: len(kept)]
        each = answers[: len(kept)]
        return (own @ each).real, np.abs(own) @ np.abs(each.view(np.float64)).max(axis=1, initial=0.0)

    voltage = _answers(modes.poles[kept], line, 0.0)
    values, sizes = answered(given.b, voltage)
    values += given.d[:, None] * line.reading
    courses = [line.reading[None], voltage.real, voltage.imag[is_pair]]
    by_parameters = [given.d_d.T[:, :, None], *of_each(modes.by_voltage)]
    by_initial = [np.zeros((outputs, n, 0))]
    moves = bool(np.any(state))
    if moves or by_states:
        free = _answers(modes.poles[kept], line, 1.0)
        courses += [free.real, free.imag[is_pair]]
    if moves:  # at rest it stays out of the sum: with more terms, though they are 0, that rounds otherwise
        from_state, more = answered(state, free)
        values, sizes = values + from_state, sizes + more
        by_parameters += of_each(modes.weights(modes.left @ state, np.zeros((len(given.d_b), n))))
    if by_states:
        sees = np.zeros((outputs, n, 2 * len(kept)), dtype=np.complex128)
        seen = modes.read[:, kept, None] * modes.left[kept] * times[: len(kept), None]
        sees[..., : len(kept)] = seen.transpose(0, 2, 1)
        by_initial = [np.zeros((outputs, n, sum(len(one) for one in courses[:3]))), *of_kept(sees)]
    return (
        (values, sizes),
        np.concatenate(courses),
        np.concatenate(by_parameters, axis=2),
        np.concatenate(by_initial, axis=2),
    )


def _answers(poles: ComplexArray, line: Timeline, first: float) -> ComplexArray:
    """What each pole answers at each row, and its slope by the pole, shape (2 n_poles, n_time).

    Parameters
    ----------
    first : float
        0: from rest to the voltage; 1: from 1, without a voltage.
    """
    from ipmclab.model.numerics.tangents_modal_loop import pole_answers, pole_moves

    moves = np.empty((6, len(line.durations), len(poles)), dtype=np.complex128)
    pole_moves(poles, line.durations, 1.0 - first, moves)
    answers = np.empty((2 * len(poles), len(line.reading)), dtype=np.complex128)
    pole_answers(moves, line.interval, line.start, line.end, line.row, first, answers)
    return answers
