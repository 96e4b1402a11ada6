"""What several checks need of a run, computed once: edges of the voltage, readings, noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from ipmclab.quality.kept import kept
from ipmclab.quality.noise import noise_of_readings, quantum_of, stale_fraction
from ipmclab.quality.sentinel import beside_missing, may_hold_sentinel, raw_sentinels
from ipmclab.run import QUALITY_FLAGS, FloatArray, Run
from ipmclab.units import CHANNELS, significant

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.intp]
Ranges = tuple[tuple[int, int], ...]

RESPONSES: Final = ("current", "displacement", "force")
"""The measured channels that answer to the voltage."""

GUARD_ROWS: Final = 3
"""Rows before and after a voltage edge in which a jump or a peak is the edge's own (convention)."""

NO_VOLTAGE: Final = 0.01
"""A voltage [V] that never leaves this band is no excitation (convention)."""

_INRUSH: Final = 10.0
"""Standard deviations of the noise by which an inrush stands out (convention)."""
_STANDS: Final = 0.25  # part of the record that the first stretch has to last to be judged (convention)


@dataclass(frozen=True, eq=False)
class Channel:
    """One measured channel: its readings, where it has none, and how noisy it is.

    Parameters
    ----------
    name : str
    readings : float array, shape (n_time,)
        NaN where there is no reading, also where a raw sentinel stood.
    missing : bool array, shape (n_time,), or None
        Rows without a reading; None when every row has one.
    sentinels : int
        How many of the missing rows held a sentinel.
    beyond : float array
        The values of missing rows that were no sentinel but lay far out next to one.
    edges : int array, optional
        Rows at which the voltage jumps.
    """

    name: str
    readings: FloatArray
    missing: BoolArray | None = None
    sentinels: int = 0
    beyond: tuple[float, ...] = ()
    edges: IntArray | None = None

    @cached_property
    def rows(self) -> IntArray:
        """Rows that have a reading."""
        return np.arange(len(self.readings)) if self.missing is None else np.flatnonzero(~self.missing)

    @cached_property
    def values(self) -> FloatArray:
        """The readings without the missing ones."""
        return self.readings if self.missing is None else self.readings[self.rows]

    @cached_property
    def steps(self) -> FloatArray:
        """First differences of ``values``."""
        return self.values[1:] - self.values[:-1]

    @cached_property
    def changes_with_voltage_alone(self) -> bool:
        """Whether every change of the readings is at a jump of the voltage, as of a resistor read in coarse steps."""
        changes = self.rows[1:][self.steps != 0.0]
        if self.edges is None or not len(changes) or len(changes) > (2 * GUARD_ROWS + 1) * len(self.edges):
            return False
        return bool(np.all(np.abs(changes[:, None] - self.edges[None, :]).min(axis=1) <= GUARD_ROWS))

    @cached_property
    def noise(self) -> float:
        """Standard deviation of the noise."""
        return 0.0 if self.changes_with_voltage_alone else noise_of_readings(self.values)

    @cached_property
    def quantum(self) -> float:
        """The smallest change from row to row that is no answer to a jump of the voltage."""
        return 0.0 if self.changes_with_voltage_alone else quantum_of(self.steps)

    @cached_property
    def stale(self) -> float:
        """Fraction of the rows that repeat the reading before for no reason of rounding."""
        return stale_fraction(self.steps, self.quantum) if len(self.values) >= 5 else 0.0

    @cached_property
    def low(self) -> float:
        return float(self.values.min())

    @cached_property
    def high(self) -> float:
        return float(self.values.max())

    @property
    def span(self) -> float:
        return self.high - self.low

    def show(self, value: float) -> str:
        """A value with its unit, as people read it."""
        quantity = CHANNELS[self.name]
        return f"{significant(quantity.to_display(value), 4)} {quantity.display_unit}"


@dataclass(frozen=True, eq=False)
class Record:
    """A run with what its checks share.

    Parameters
    ----------
    run : Run
    channels : mapping of name to Channel
        The measured responses that have at least one reading.
    empty : tuple of str
        Responses that are there but have no reading at all.
    edges : int array
        Rows at which the voltage has jumped (row k: between the rows k-1 and k). Row 0 is
        one when the record starts with a voltage.
    heights : float array [V]
        The jump at each edge.
    """

    run: Run
    channels: dict[str, Channel]
    empty: tuple[str, ...]
    edges: IntArray
    heights: FloatArray

    @classmethod
    def of(cls, run: Run) -> Record:
        """Of a run, as it was found the last time."""
        return kept(run, "record", lambda: cls._made_of(run))

    @classmethod
    def _made_of(cls, run: Run) -> Record:
        edges, heights = voltage_edges(run.voltage)
        channels: dict[str, Channel] = {}
        empty: list[str] = []
        for name in RESPONSES:
            readings = getattr(run, name)
            if readings is None:
                continue
            channel = _channel(run, name, readings, edges)
            if channel.missing is not None and channel.missing.all():
                empty.append(name)
            else:
                channels[name] = channel
        return cls(run=run, channels=channels, empty=tuple(empty), edges=edges, heights=heights)

    def __len__(self) -> int:
        return len(self.run.time)

    @cached_property
    def period(self) -> float:
        """Median time between rows [s]."""
        steps = self.run.time[1:] - self.run.time[:-1]
        middle = len(steps) // 2
        # The place is named twice: for a single one NumPy takes a way that is slow where values are nearly all equal.
        return float(np.partition(steps, (middle, middle))[middle])

    @cached_property
    def voltage(self) -> Channel:
        """The voltage as a channel."""
        return Channel("voltage", self.run.voltage, edges=self.edges)

    @cached_property
    def excited(self) -> bool:
        """Whether there is any voltage."""
        return bool(np.abs(self.run.voltage).max() > NO_VOLTAGE)

    @property
    def first_edge(self) -> int:
        """The row of the first edge; 0 where there is none."""
        return int(self.edges[0]) if len(self.edges) else 0

    @cached_property
    def ends(self) -> IntArray:
        """The row at which the stretch after each edge ends: the next edge, or the end of the record."""
        return np.append(self.edges[1:], len(self)) if len(self.edges) else self.edges

    @cached_property
    def begins_under_voltage(self) -> bool:
        """Whether the voltage is constant from row 0 on, for a quarter of the record, and nothing says that it began
        there.

        A run that states its rest says so, and a current of which one of the first rows differs from the median of the
        stretch by ten standard deviations of its noise and by that median itself. Without a current, a known hold
        counts as such a statement.
        """
        if not len(self.edges) or self.edges[0] != 0 or self.run.metadata.starts_from_rest:
            return False
        if not self.constant_after[0] or self.ends[0] < _STANDS * len(self):
            return False  # a wave, of whose beginning a strip soon forgets
        current = self.channels.get("current")
        if current is None or np.isnan(first := current.readings[: min(GUARD_ROWS + 1, self.ends[0])]).all():
            return self.run.hold == "unknown"
        usual = float(np.nanmedian(current.readings[: self.ends[0]]))
        return not bool(np.nanmax(np.abs(first - usual)) > max(_INRUSH * current.noise, abs(usual)))

    @cached_property
    def resting(self) -> int:
        """How many rows there are at 0 V before the voltage first moves; all where it does not.

        Without the last ones: channels of a foreign record may lead its voltage by a few rows.
        """
        driven = np.flatnonzero(np.abs(self.run.voltage) > NO_VOLTAGE)
        return max(int(driven[0]) - GUARD_ROWS, 0) if len(driven) else len(self)

    @property
    def shows_no_edge(self) -> bool:
        """Whether the record begins under a constant voltage and stays there to its end."""
        return self.begins_under_voltage and len(self.edges) == 1

    @cached_property
    def steps_from_rest(self) -> bool:
        """Whether there is no voltage before the first edge."""
        if not len(self.edges) or self.begins_under_voltage:
            return False
        before = self.run.voltage[: self.edges[0]]
        return not len(before) or bool(np.abs(before).max() <= max(NO_VOLTAGE, 0.02 * abs(float(self.heights[0]))))

    @cached_property
    def near_edge(self) -> BoolArray:
        """Rows within ``GUARD_ROWS`` of an edge."""
        near = np.zeros(len(self), dtype=bool)
        if len(self.edges):
            rows = self.edges[:, None] + np.arange(-GUARD_ROWS, GUARD_ROWS + 1)
            near[rows.clip(0, len(self) - 1)] = True
        return near

    @cached_property
    def constant_after(self) -> BoolArray:
        """For each edge, whether the voltage then stays where it is (no sine that merely starts with a jump)."""
        voltage = self.run.voltage
        tolerance = 0.1 * np.abs(self.heights)
        if not len(self.edges):
            return np.zeros(0, dtype=bool)
        highest = np.maximum.reduceat(voltage, self.edges)
        lowest = np.minimum.reduceat(voltage, self.edges)
        return np.asarray(highest - lowest <= tolerance)

    @cached_property
    def held_last(self) -> tuple[int, int] | None:
        """The last stretch of constant voltage, from its edge to the row after it; None where the voltage moves.

        A rest at 0 V at the end of the record is not it: the stretch before is. Nor is a single row, which lies within
        a jump over several.
        """
        held = np.flatnonzero((self.ends - self.edges)[: -1 if self._rests_from_last_edge else None] > 1)
        if not len(held) or not self.constant_after[held[-1]]:
            return None
        return int(self.edges[held[-1]]), int(self.ends[held[-1]])

    @cached_property
    def driven_until(self) -> int:
        """The row with which a rest at 0 V begins that ends the record; without one, how many rows there are."""
        if self._rests_from_last_edge:
            return int(self.edges[-1])
        driven = np.flatnonzero(np.abs(self.run.voltage) > self._rest)
        return int(driven[-1]) + 1 if len(driven) else len(self)

    @property
    def _rest(self) -> float:
        """Up to which voltage [V] the strip is at rest."""
        return max(NO_VOLTAGE, 0.01 * float(np.abs(self.run.voltage).max()))

    @cached_property
    def _rests_from_last_edge(self) -> bool:
        """Whether the voltage stays at 0 V after its last edge, be it read with more noise than ``_rest`` allows."""
        if not len(self.edges):
            return False
        level = abs(float(np.median(self.run.voltage[self.edges[-1] :])))
        return bool(self.constant_after[-1]) and level <= self._rest

    def at(self, row: int) -> str:
        """A row with its time, for messages."""
        return f"row {row} ({self.run.time[row]:.6g} s)"


def voltage_edges(voltage: FloatArray) -> tuple[IntArray, FloatArray]:
    """Rows at which the voltage jumps, and by how much; a fast smooth signal has none.

    A jump is more than a twentieth of the largest voltage. Where the voltage has few levels
    (steps, squares, binary sequences) every such change is one; otherwise only a change that
    stands alone, four times the two before and the two after it.
    """
    largest = max(float(voltage.max()), -float(voltage.min()))
    none = np.zeros(0, dtype=np.intp), np.zeros(0)
    if largest <= NO_VOLTAGE:
        return none
    changes = np.empty_like(voltage)
    changes[0] = voltage[0]
    np.subtract(voltage[1:], voltage[:-1], out=changes[1:])
    size = np.abs(changes)
    threshold = 0.05 * largest
    big = size > threshold
    rows = np.flatnonzero(big)
    if not len(rows):
        return none
    calm = np.count_nonzero(size < 0.2 * threshold)
    if calm + len(rows) < 0.95 * len(voltage):
        padded = np.concatenate(([0.0, 0.0], size, [np.inf, np.inf]))
        others = np.maximum(np.maximum(padded[rows], padded[rows + 1]), np.maximum(padded[rows + 3], padded[rows + 4]))
        rows = rows[size[rows] > 4.0 * others]
    return rows, changes[rows]


def counted(count: int, thing: str) -> str:
    """A count with its thing, in the plural where there are several.

    Examples
    --------
    >>> counted(1, "spike"), counted(3, "spike")
    ('1 spike', '3 spikes')
    """
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"


def ranges_of(rows: IntArray) -> Ranges:
    """Half-open ranges of sorted rows.

    Examples
    --------
    >>> ranges_of(np.array([3, 4, 5, 9]))
    ((3, 6), (9, 10))
    """
    if not len(rows):
        return ()
    breaks = np.flatnonzero(np.diff(rows) > 1)
    starts = rows[np.concatenate(([0], breaks + 1))]
    stops = rows[np.concatenate((breaks, [len(rows) - 1]))] + 1
    return tuple((int(start), int(stop)) for start, stop in zip(starts, stops, strict=True))


def _channel(run: Run, name: str, readings: FloatArray, edges: IntArray) -> Channel:
    finite = np.isfinite(readings)
    flags = run.quality.get(name)
    if flags is not None and flags.any():
        finite &= (flags & (QUALITY_FLAGS["missing"] | QUALITY_FLAGS["sentinel"])) == 0
    elif finite.all() and not may_hold_sentinel(name, readings, edges):
        return Channel(name, readings, edges=edges)
    missing = ~finite
    if name == "displacement":
        missing |= raw_sentinels(readings, finite, edges)
    sentinels = int(np.count_nonzero(missing))
    looked_at = sentinels and not missing.all()
    beyond = beside_missing(readings, missing, GUARD_ROWS) if looked_at else np.zeros(0, dtype=np.intp)
    missing[beyond] = True
    if not missing.any():
        return Channel(name, readings, edges=edges)
    return Channel(
        name,
        np.where(missing, np.nan, readings),
        missing,
        sentinels=sentinels,
        beyond=tuple(float(value) for value in readings[beyond]),
        edges=edges,
    )
