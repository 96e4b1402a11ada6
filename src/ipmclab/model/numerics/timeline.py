"""What the strip saw between the rows: intervals of straight-line voltage, and where rows are read.

A record's rows and the edges of its voltage need not coincide (a delay of less than a sample, an
irregular clock). Both are put on one time line; between two neighbours the voltage is a straight line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ipmclab.model.numerics.course import Course, voltage_course
from ipmclab.run import Hold

FloatArray = npt.NDArray[np.float64]
IndexArray = npt.NDArray[np.int64]

_SAME_TIME = 1e-9
"""An edge within this part of a period of a row is on the row (rounding of the clock)."""

_SAME_DURATION = 1e-7
"""Intervals that differ by less than this part of a period share one transition, of their mean duration."""


@dataclass(frozen=True, eq=False)
class Timeline:
    """Intervals in order; the arguments of ``kernels.dense_delay`` of the same names.

    ``durations`` [s] has one entry for each kind of interval. Where a delay grows, an edge moves and a row does not:
    ``arrives`` and ``leaves`` (shape (n_intervals + 1,)) tell by how much the end of the interval before and the begin
    of the interval after it move there for a second of delay. They differ where an edge lies on a row. A delay that
    changes within ``room`` [s] moves no edge to a row; each second of it adds ``lengthens`` to ``durations``.
    """

    durations: FloatArray
    interval: IndexArray
    start: FloatArray
    end: FloatArray
    row: IndexArray
    reading: FloatArray
    rate: FloatArray
    jump: FloatArray
    reading_rate: FloatArray
    read_before_jump: bool
    arrives: FloatArray
    leaves: FloatArray
    lengthens: FloatArray
    room: tuple[float, float]

    def delayed(self, by: float) -> Timeline | None:
        """The same with edges that come so much later [s]; None where one of them would come to a row."""
        if not self.room[0] < by < self.room[1]:
            return None
        return replace(
            self, durations=self.durations + by * self.lengthens, room=(self.room[0] - by, self.room[1] - by)
        )

    @property
    def course(self) -> Course:
        """What the compiled loops go along, with the voltage as the only input."""
        return voltage_course(self.interval, self.start, self.end, self.row, self.reading)


def period_of(time: FloatArray) -> float:
    """The usual time between two rows [s]."""
    return float(np.median(np.diff(time)))


def timeline(
    time: FloatArray,
    voltage: FloatArray,
    hold: Hold,
    *,
    delay: float,
    from_rest: bool,
    period: float | None = None,
) -> Timeline:
    """Lay rows and voltage edges on one time line.

    Parameters
    ----------
    time : float array, shape (n_time,) [s]
    voltage : float array, shape (n_time,) [V]
    hold : "zero", "zero-before" or "first"
    delay : float [s]
        By how much the voltage reaches the strip later than its rows say; negative for earlier.
    from_rest : bool
        True: before its first edge the strip was at rest, and at 0 V. False: a state is given for
        row 0, and before its first edge the strip saw the first voltage.
    period : float [s], optional
        ``period_of`` the time, where it is known already.

    Returns
    -------
    timeline : Timeline
    """
    if period is None:
        period = period_of(time)
    # A row that is read before its edge (zero-before) shows the voltage of the edge one row earlier;
    # row 0 shows a voltage that came with row 0.
    read_before = hold == "zero-before"
    levels = voltage[1:] if read_before else voltage
    edges = time[:-1] if read_before else time
    if hold != "first":
        changes = np.append(True, levels[1:] != levels[:-1])  # where the voltage stays there is no edge
        edges, levels = edges[changes], levels[changes]
    edges = _snap(edges + delay, time, _SAME_TIME * period)
    before = 0.0 if from_rest and (delay < 0 or not read_before) else voltage[0]
    place = np.searchsorted(time, edges)
    between = (edges > time[0]) | from_rest
    between &= (edges < time[-1]) & (time[np.minimum(place, len(time) - 1)] != edges)
    events = np.insert(time, place[between], edges[between])
    row = np.insert(np.arange(len(time)), place[between], -1)
    at_event = np.searchsorted(edges, events, side="right") - 1
    edge_events, inside = np.searchsorted(events, edges), (edges >= events[0]) & (edges <= events[-1])
    levels = np.append(before, levels)  # levels[k + 1] since edge k
    lengths = np.diff(events)
    jump = np.zeros(len(events))
    if hold == "first":
        at_times = np.interp(events, edges, voltage, left=before)
        start = at_times[:-1]
        end = np.where(events[1:] <= edges[0], before, at_times[1:])
        reading = np.interp(time, edges, voltage, left=before)
        slopes = np.concatenate([[0.0], np.diff(voltage) / np.diff(edges), [0.0]])
        rate = -slopes[at_event[:-1] + 1]
        # A row on a corner of the voltage takes the mean of both slopes, as a central difference would.
        sides = [np.searchsorted(edges, time, side="left"), np.searchsorted(edges, time, side="right")]
        reading_rate = -0.5 * (slopes[sides[0]] + slopes[sides[1]])
        jump[events == edges[0]] = before - voltage[0]
    else:
        start = end = levels[at_event[:-1] + 1]
        reading = levels[np.searchsorted(edges, time, side="left" if read_before else "right")]
        rate, reading_rate = np.zeros(len(lengths)), np.zeros(len(time))
        jump[edge_events[inside]] = -np.diff(levels)[inside]
    moves = np.zeros(len(events), dtype=bool)
    moves[edge_events[inside]] = True
    durations, interval, lengthens = _kinds(
        lengths, _SAME_DURATION * period, np.diff((moves & (row < 0)).astype(float))
    )
    room = (0.0, 0.0) if hold == "first" else _room(edges, time, place, _SAME_TIME * period)
    if not (from_rest or read_before):
        moves[0] = False  # the state is given behind this edge, and for its own time
    both = moves & (row >= 0)
    arrives, leaves = moves.astype(float), moves.astype(float)
    (arrives if read_before else leaves)[both] = 0.0
    return Timeline(
        *(durations, interval, start, end, row, reading, rate, jump, reading_rate, read_before, arrives, leaves),
        lengthens,
        room,
    )


def is_regular(times: FloatArray) -> bool:
    """Whether all rows are one period apart, but for the rounding of a clock."""
    steps = times[1:] - times[:-1]
    return bool(steps.max() - steps.min() <= 1e-6 * steps.mean())


def side_by_side(lines: Sequence[Timeline]) -> Course:
    """The course of several inputs, each of which has its own values on the same time line."""
    first = lines[0]
    start, end, reading = (
        np.column_stack([getattr(line, name) for line in lines]) for name in ("start", "end", "reading")
    )
    return Course(first.interval, start, end, first.row, reading)


def divided(line: Timeline, parts: IndexArray) -> Timeline:
    """The same time line with each interval divided into equal parts.

    Parameters
    ----------
    line : Timeline
    parts : int array, shape (n_kinds,)
        Into how many, for each kind of interval.
    """
    if np.all(parts == 1):
        return line
    count = parts[line.interval]
    whole = np.repeat(np.arange(len(count)), count)
    first = np.concatenate([[0], np.cumsum(count)])
    begun = (np.arange(first[-1]) - first[whole]) / count[whole]  # part of the interval that has passed
    done = begun + 1.0 / count[whole]
    moved = line.arrives[1:] - line.leaves[:-1]
    rise = line.end - line.start
    row, jump = np.full(first[-1] + 1, -1, dtype=np.int64), np.zeros(first[-1] + 1)
    row[first], jump[first] = line.row, line.jump
    leaves = np.append(line.leaves[whole] + moved[whole] * begun, line.leaves[-1])
    arrives = np.append(line.arrives[0], line.leaves[whole] + moved[whole] * done)
    arrives[first] = line.arrives
    end = line.start[whole] + rise[whole] * done
    end[first[1:] - 1] = line.end  # to the last digit: a voltage that does not jump must not seem to
    start = line.start[whole] + rise[whole] * begun
    return replace(
        line,
        durations=line.durations / parts,
        lengthens=line.lengthens / parts,
        interval=line.interval[whole],
        start=start,
        end=end,
        row=row,
        rate=line.rate[whole],
        jump=jump,
        arrives=arrives,
        leaves=leaves,
    )


def _snap(edges: FloatArray, time: FloatArray, tolerance: float) -> FloatArray:
    """Edges that fall on a row but for rounding are put exactly on it."""
    after = np.searchsorted(time, edges).clip(1, len(time) - 1)
    nearest = np.where(edges - time[after - 1] < time[after] - edges, time[after - 1], time[after])
    return np.where(np.abs(edges - nearest) <= tolerance, nearest, edges)


def _kinds(lengths: FloatArray, quantum: float, lengthens: FloatArray) -> tuple[FloatArray, IndexArray, FloatArray]:
    """The distinct lengths that change alike for a second of delay, by -1, 0 or 1; which is whose; by how much."""
    _, first, kind, counts = np.unique(
        3.0 * np.round(lengths / quantum) + lengthens, return_index=True, return_inverse=True, return_counts=True
    )
    return np.bincount(kind, weights=lengths) / counts, kind.astype(np.int64), lengthens[first]


def _room(edges: FloatArray, time: FloatArray, place: IndexArray, tolerance: float) -> tuple[float, float]:
    """By how much edges can come earlier and later until one of them is on a row, which ``place`` says is the next."""
    before, after = edges[place > 0] - time[place[place > 0] - 1], (time[place % len(time)] - edges)[place < len(time)]
    back, ahead = (float(np.min(one, initial=np.inf)) - tolerance for one in (before, after))
    return (-back, ahead) if min(back, ahead) > 0.0 else (0.0, 0.0)
