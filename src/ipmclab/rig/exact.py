"""A linear system that is carried exactly over intervals of any length, as the clock of a chassis makes them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from ipmclab.model.assemble import System

FloatArray = npt.NDArray[np.float64]
TickArray = npt.NDArray[np.int64]

_TICKS_PER_SECOND: Final = 64 * 80_000_000

TICK: Final = 1.0 / _TICKS_PER_SECOND
"""The unit of time [s], 0.2 ns: a 64th of that of a chassis (80 MHz), whose intervals are therefore whole numbers."""

_RUNGS: Final = 56  # of the ladder: intervals up to 2^56 ticks, five months
_KEPT: Final = 256  # transitions that are kept: a few of each rate


def to_ticks(times: npt.ArrayLike) -> TickArray:
    """Times [s] in ticks; what is rounded off one interval is part of the next, so that nothing adds up."""
    return np.rint(np.asarray(times, dtype=np.float64) * _TICKS_PER_SECOND).astype(np.int64)


class ExactSystem:
    """A system with its state, whose input is constant within each interval.

    A matrix exponential for each interval would cost milliseconds where a program sets and reads once. Those of
    1, 2, 4, 8... ticks are computed once instead, and the transition over any interval is a product of some of them.

    Parameters
    ----------
    system : System
    state : float array, shape (n_states,), optional
        Rest where it is left out.
    """

    def __init__(self, system: System, state: FloatArray | None = None) -> None:
        from ipmclab.model.discretise import transitions

        n = len(system.states)
        self.state = np.zeros(n) if state is None else np.array(state, dtype=np.float64)
        steps = transitions([system], 2.0 ** np.arange(_RUNGS) / _TICKS_PER_SECOND)
        # The state with the input as one more component, which stays as it is.
        self._ladder = np.zeros((_RUNGS, n + 1, n + 1))
        self._ladder[:, :n, :n] = steps.state[0]
        self._ladder[:, :n, n] = steps.constant[0]
        self._ladder[:, n, n] = 1.0
        self._reading = np.ascontiguousarray(system.c), np.ascontiguousarray(system.d[:, 0])
        self._kept: dict[int, FloatArray] = {}

    def advance(self, intervals: TickArray, inputs: FloatArray) -> FloatArray:
        """The outputs at the end of each interval, just before the input changes.

        Parameters
        ----------
        intervals : int array, shape (n_time,) [ticks]
            0 or more.
        inputs : float array, shape (n_time,)
            Constant over each interval.

        Returns
        -------
        outputs : float array, shape (n_outputs, n_time)
        """
        from ipmclab.model import kernels

        rows = len(intervals)
        outputs = np.empty((self._reading[0].shape[0], rows))
        if not rows:
            return outputs
        state, constant, level, kind = self._kinds(intervals)
        row = np.arange(-1, rows)
        c, d = self._reading
        kernels.dense(state, constant, level, kind, inputs, inputs, row, inputs, c, d, self.state, outputs)
        return outputs

    def _kinds(self, intervals: TickArray) -> tuple[FloatArray, FloatArray, FloatArray, TickArray]:
        """The transitions over the lengths that occur, and which of them each interval has."""
        if len(intervals) == 1:
            lengths, kind = [int(intervals[0])], np.zeros(1, dtype=np.int64)
        else:
            shortest, longest = int(intervals.min()), int(intervals.max())
            if longest - shortest <= 4:  # a steady clock, in which rounding moves an edge by a tick
                lengths, kind = list(range(shortest, longest + 1)), intervals - shortest
            else:
                distinct, kind = np.unique(intervals, return_inverse=True)
                lengths = distinct.tolist()
        n = len(self.state)
        moves = np.array([self._transition(length) for length in lengths])
        state, constant = np.ascontiguousarray(moves[:, :n, :n]), np.ascontiguousarray(moves[:, :n, n])
        return state, constant, np.zeros_like(constant), kind  # within an interval the input has no slope

    def _transition(self, ticks: int) -> FloatArray:
        """What an interval does to state and input together."""
        if ticks not in self._kept:
            if len(self._kept) >= _KEPT:
                self._kept.clear()
            length = min(ticks, 2**_RUNGS - 1)  # after months at one voltage nothing moves any more
            move = np.eye(self._ladder.shape[1])
            for rung in range(length.bit_length()):
                if length >> rung & 1:
                    move = self._ladder[rung] @ move
            self._kept[ticks] = move
        return self._kept[ticks]
