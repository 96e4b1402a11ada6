"""A system that is carried exactly over intervals of any length, as the clock of a chassis makes them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.course import voltage_course

if TYPE_CHECKING:
    from ipmclab.model.assemble import System
    from ipmclab.model.numerics.dense import Dense

FloatArray = npt.NDArray[np.float64]
TickArray = npt.NDArray[np.int64]

_TICKS_PER_SECOND: Final = 64 * 80_000_000

TICK: Final = 1.0 / _TICKS_PER_SECOND
"""The unit of time [s], 0.2 ns: a 64th of that of a chassis (80 MHz), whose intervals are therefore whole numbers."""

_RUNGS: Final = 56  # of the ladder: intervals up to 2^56 ticks, five months
_KEPT: Final = 512  # transitions that are kept: a few of each rate
_LONGEST: Final = _TICKS_PER_SECOND // 50  # the longest interval for laws, as ``model.dense.LONGEST``
_EQUAL: Final = 500  # pieces up to which they are equal


def to_ticks(times: npt.ArrayLike) -> TickArray:
    """Times [s] in ticks; what is rounded off one interval is part of the next, so that nothing adds up."""
    return np.rint(np.asarray(times, dtype=np.float64) * _TICKS_PER_SECOND).astype(np.int64)


class ExactSystem:
    """A system with its state, whose input is constant within each interval.

    A matrix exponential for each interval would cost milliseconds where a program sets and reads once. Those of
    1, 2, 4, 8... ticks are computed once instead, and the transition over any interval is a product of some of them.
    Where there are laws, such as a leak's, long intervals are divided as ``simulate`` divides them.

    Parameters
    ----------
    system : System
    state : float array, shape (n_states,), optional
        Rest where it is left out.
    """

    def __init__(self, system: System, state: FloatArray | None = None) -> None:
        from ipmclab.model.numerics.discretise import transitions

        n = len(system.states)
        self._system = system
        self.state = np.zeros(n) if state is None else np.array(state, dtype=np.float64)
        lengths = 2.0 ** np.arange(_RUNGS) / _TICKS_PER_SECOND
        steps = transitions([system], lengths)
        m = steps.law_end.shape[-1]
        # The state with what drives it as more components: the input and what the laws give, which stay as they are,
        # and the rates of the laws, by which those grow.
        self._ladder = np.tile(np.eye(n + 1 + 2 * m), (_RUNGS, 1, 1))
        laws, rates = slice(n + 1, n + 1 + m), slice(n + 1 + m, None)
        self._ladder[:, :n, :n] = steps.state[0]
        self._ladder[:, :n, n : n + 1] = steps.constant[0]
        self._ladder[:, :n, laws] = steps.law_begin[0] + steps.law_end[0]
        self._ladder[:, :n, rates] = steps.law_end[0] * lengths[:, None, None]
        self._ladder[:, laws, rates] = lengths[:, None, None] * np.eye(m)
        self._kept: dict[int, FloatArray] = {}
        self._dense: dict[tuple[int, ...], Dense] = {}

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
        rows = len(intervals)
        outputs = np.empty((len(self._system.outputs), rows))
        if not rows:
            return outputs
        levels, row = inputs, np.arange(-1, rows)
        if self._system.law_ports is not None and int(intervals.max()) > _LONGEST:
            pieces = [_pieces(int(length)) for length in intervals]
            counts = np.array([len(piece) for piece in pieces])
            levels, intervals = np.repeat(inputs, counts), np.concatenate(pieces)
            row = np.full(len(intervals) + 1, -1, dtype=np.int64)
            row[np.cumsum(counts)] = np.arange(rows)
        lengths, kind = _kinds(intervals)
        course = voltage_course(kind, levels, levels, row, inputs)
        self._over(lengths).run(course, self.state, outputs)
        return outputs

    def _over(self, lengths: tuple[int, ...]) -> Dense:
        """The system over intervals of these lengths [ticks]."""
        if lengths not in self._dense:
            from ipmclab.model.numerics.dense import Dense

            if len(self._dense) >= _KEPT:
                self._dense.clear()
            n, ports = len(self.state), self._system.law_ports
            laws = 0 if ports is None else len(ports.laws)
            moves = np.array([self._transition(length) for length in lengths])
            held, grown = moves[:, :n, n + 1 : n + 1 + laws], moves[:, :n, n + 1 + laws :]
            ramped = grown / np.maximum(np.array(lengths) * TICK, TICK)[:, None, None]
            constant = moves[:, :n, n : n + 1]
            # Within an interval the input has no slope.
            step = [constant, np.zeros_like(constant), moves[:, :n, :n], held - ramped, ramped]
            self._dense[lengths] = Dense(self._system, np.concatenate(step, axis=-1))
        return self._dense[lengths]

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


def _kinds(intervals: TickArray) -> tuple[tuple[int, ...], TickArray]:
    """The lengths that occur, and which of them each interval has."""
    if len(intervals) == 1:
        return (int(intervals[0]),), np.zeros(1, dtype=np.int64)
    shortest, longest = int(intervals.min()), int(intervals.max())
    if longest - shortest <= 4:  # a steady clock, in which rounding moves an edge by a tick
        return tuple(range(shortest, longest + 1)), intervals - shortest
    distinct, kind = np.unique(intervals, return_inverse=True)
    return tuple(distinct.tolist()), kind.astype(np.int64)


def _pieces(length: int) -> TickArray:
    """An interval [ticks] in pieces short enough for laws: of 20 ms, and longer ones once the voltage stood long."""
    count = max(1, -(-(length - 4) // _LONGEST))
    if count > _EQUAL:
        early = np.arange(_EQUAL // 2 + 1) * _LONGEST
        late = np.geomspace(early[-1], length, _EQUAL // 2 + 1)[1:]
        edges = np.concatenate([early, np.rint(late).astype(np.int64)])
        edges[-1] = length
    else:
        edges = np.arange(count + 1) * length // count
    return np.diff(edges)
