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

_MOST: Final = 2.0**56  # ticks, five months: after them at one voltage nothing moves any more
_KEPT: Final = 512  # transitions that are kept: a few of each rate
_LONGEST: Final = _TICKS_PER_SECOND // 50  # the longest interval for laws, as ``model.dense.LONGEST``
_EQUAL: Final = 500  # pieces up to which they are equal


def to_ticks(times: npt.ArrayLike) -> TickArray:
    """Times [s] in ticks; what is rounded off one interval is part of the next, so that nothing adds up."""
    return np.rint(np.asarray(times, dtype=np.float64) * _TICKS_PER_SECOND).astype(np.int64)


class ExactSystem:
    """A system with its state, whose input is constant within each interval.

    Where there are laws, such as a leak's, long intervals are divided as ``simulate`` divides them.

    Parameters
    ----------
    system : System
    state : float array, shape (n_states,), optional
        Rest where it is left out.
    """

    def __init__(self, system: System, state: FloatArray | None = None) -> None:
        self._system = system
        self.state = np.zeros(len(system.states)) if state is None else np.array(state, dtype=np.float64)
        self._dense: dict[tuple[int, ...], Dense] = {}
        self._over((1,))  # what computes is loaded now, and not while a bench waits for its first row

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
            durations = np.minimum(np.array(lengths, dtype=np.float64), _MOST) / _TICKS_PER_SECOND
            self._dense[lengths] = Dense.of(self._system, durations)
        return self._dense[lengths]


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
