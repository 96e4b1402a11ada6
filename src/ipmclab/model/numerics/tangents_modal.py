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


class ByModes(NamedTuple):
    """Outputs over a time line and their derivatives, as sums of what the poles answer.

    Parameters
    ----------
    values, sizes : float array, shapes (n_outputs, n_time) and (n_outputs,)
        The outputs, and of each the sum of the largest sizes of what its poles answer, which may cancel.
    courses : float array, shape (n_courses, n_time)
        The voltage as it is read, what the poles answer, and the slopes of that.
    by_parameters : float array, shape (n_outputs, n_parameters, n_first)
        How much of the first of them, or of all, is in the derivative by each parameter.
    by_initial : float array, shape (n_outputs, n, n_courses)
        In that by each initial state.
    by_delay : float array, shape (n_outputs, n_courses), or None
        In that by the delay; None where the courses do not hold it, or it was not wanted.
    """

    values: FloatArray
    sizes: FloatArray
    courses: FloatArray
    by_parameters: FloatArray
    by_initial: FloatArray
    by_delay: FloatArray | None


def modal_tangents(modes: Modes, line: Timeline, state: FloatArray, *, by_states: bool, by_delay: bool) -> ByModes:
    """The outputs over a time line and their derivatives, as sums of what the poles answer.

    Parameters
    ----------
    modes : Modes
    line : Timeline
    state : float array, shape (n,)
        The initial state.
    by_states, by_delay : bool
        Whether derivatives by it, and by the delay, are wanted; they are 0 otherwise.
    """
    given = modes.slopes
    kept = np.flatnonzero(modes.poles.imag >= 0.0)  # the other of a pair answers the conjugate
    poles = modes.poles[kept]
    n, outputs, count = len(modes.poles), len(given.c), len(kept)
    is_pair = poles.imag > 0.0
    times, pairs = np.where(is_pair, 2.0, 1.0), np.flatnonzero(np.append(is_pair, is_pair))
    both = np.append(kept, n + kept)

    def of_kept(weights: ComplexArray) -> list[FloatArray]:
        """By real and imaginary parts of the answers; without those that are 0."""
        return [weights.real, -weights.imag[..., pairs]]

    def of_each(weights: ComplexArray) -> list[FloatArray]:
        return of_kept(weights[..., both] * np.append(times, times))

    def own(drive: FloatArray) -> ComplexArray:
        """How much of what each pole answers to a drive is in the outputs."""
        return np.asarray(modes.read[:, kept] * (modes.left[kept] @ drive) * times)

    def answered(weights: ComplexArray, answers: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The outputs, of what the poles answer, and the sum of the sizes of that."""
        parts = np.hstack([weights.real, -weights.imag[:, is_pair]])
        each = np.concatenate([answers[:count], answers[2 * count : 2 * count + len(pairs) // 2]])
        return parts @ each, np.abs(parts) @ np.abs(each).max(axis=1, initial=0.0)

    moves = bool(np.any(state))
    free = 2 * count + len(pairs) if moves or by_states else 0
    width = 1 + 2 * count + len(pairs)
    courses = np.empty((width + free, len(line.reading)))
    courses[0] = line.reading
    _answers(poles, line, 0.0, courses[1:width])
    driven = own(given.b)
    values, sizes = answered(driven, courses[1:width])
    values += given.d[:, None] * line.reading
    by_parameters = [given.d_d.T[:, :, None], *of_each(modes.by_voltage)]
    if free:
        _answers(poles, line, 1.0, courses[width:])
    if moves:  # at rest it stays out of the sum: with more terms, though they are 0, that rounds otherwise
        from_state, more = answered(own(state), courses[width:])
        values, sizes = values + from_state, sizes + more
        by_parameters += of_each(modes.weights(modes.left @ state, np.zeros((len(given.d_b), n))))
    by_initial = np.zeros((outputs, n, len(courses)))
    if by_states:
        seen = np.zeros((outputs, n, 2 * count), dtype=np.complex128)
        seen[..., :count] = (modes.read[:, kept, None] * modes.left[kept] * times[:, None]).transpose(0, 2, 1)
        by_initial[..., width:] = np.concatenate(of_kept(seen), axis=2)
    before = float(line.start[0] + line.jump[0]) if len(line.start) else 0.0  # what the strip saw before the first row
    delayed = None
    if by_delay and not line.reading_rate.any() and (before == 0.0 or free):
        # What a drive answers shifts with its edges: from rest by -s' = -(p s + u), of which before is not an edge.
        delayed = np.zeros((outputs, len(courses)))
        delayed[:, 0] = -driven.real.sum(axis=1)
        later = np.zeros((2, outputs, 2 * count), dtype=np.complex128)
        later[0, :, :count], later[1, :, :count] = -driven * poles, before * driven
        delayed[:, 1:width] = np.concatenate(of_kept(later[0]), axis=1)
        if free:
            delayed[:, width:] = np.concatenate(of_kept(later[1]), axis=1)
    return ByModes(values, sizes, courses, np.concatenate(by_parameters, axis=2), by_initial, delayed)


def _answers(poles: ComplexArray, line: Timeline, first: float, courses: FloatArray) -> None:
    """Write what each pole answers at each row, and its slope by the pole.

    Parameters
    ----------
    first : float
        0: from rest to the voltage; 1: from 1, without a voltage.
    courses : float array, shape (2 n_poles + 2 n_pairs, n_time)
        The real parts of the answers, of the slopes, then the imaginary ones of those of pairs.
    """
    from ipmclab.model.numerics.tangents_modal_loop import pole_courses, pole_moves

    moves = np.empty((6, len(line.durations), len(poles)), dtype=np.complex128)
    pole_moves(poles, line.durations, 1.0 - first, moves)
    is_pair = poles.imag > 0.0
    real, pairs = np.flatnonzero(~is_pair), np.flatnonzero(is_pair)
    places = real, pairs, 2 * len(poles) + np.arange(len(pairs))
    own = np.ascontiguousarray(moves[..., real].real), np.ascontiguousarray(moves[..., pairs])
    pole_courses(*own, places, line.interval, line.start, line.end, line.row, first, courses)
