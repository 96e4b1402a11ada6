"""The guard: looks at every block of readings, and says when a limit is passed.

It is pure: it has no clock and touches no hardware. Time is counted in rows and sums are whole numbers, so that the
row at which a limit acts does not depend on how the rows were cut into blocks.

What is not there is taken for what it was: a reading that is NaN, or a row that was lost, neither begins nor ends the
time for which a quantity is beyond its limit. In sums and means a lost row counts as the larger of its neighbours.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from ipmclab.errors import IpmclabError
from ipmclab.rig.channels import Rig
from ipmclab.rig.safety.limit import AIR, ELECTROLYSIS, MEAN_TIME, Action, Limit, shown, words
from ipmclab.rig.safety.limits import Limits

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

VOLTAGE_TOLERANCE: Final = 0.02
"""What the reading of the voltage may exceed its limit by, relative to it: the command is exact, a reading not."""

LEAST_TOLERANCE: Final = 0.02
"""So much [V] the reading of the voltage may exceed any limit by."""

BLIND_TIME: Final = 1.0
"""A reading that is missing for so long [s] is reported: its limit is not watched."""

RESIDUAL_VOLTAGE: Final = 0.1
"""After zeroing the output may still read so much [V]."""

ZEROING_TIME: Final = 0.2
"""How long after zeroing [s] the output may take to get there."""

_PER_UNIT: Final = 1e9
"""Sums are whole nanoamperes and nanowatts, far below what any converter resolves."""

_LARGEST: Final = 1e5
"""Readings beyond this [A, W] are no readings; it keeps the sums within 64 bits."""

_LARGEST_SUM: Final = 2**62
"""Where a sum of such readings stays, rather than come round to the other sign."""


@dataclass(frozen=True)
class Alarm:
    """A limit that was passed.

    Parameters
    ----------
    limit : str
        Its name.
    kind : "limit", "blind" or "stuck"
        ``blind``: the readings that it is watched with are missing. ``stuck``: the output does not go to 0 V.
    row : int
        Where it acted.
    time : float [s]
    value, most : float [SI unit of the quantity]
        What was read, and what is allowed.
    duration : float [s]
        How long it had been so.
    action : "zero" or "warn"
    """

    limit: str
    kind: Literal["limit", "blind", "stuck"]
    row: int
    time: float
    value: float
    most: float
    duration: float
    action: Action

    def __str__(self) -> str:
        """The alarm in words."""
        if self.kind == "stuck":
            return f"the output should be at 0 V and {self.value:.3g} V are read: take the strip off its leads"
        if self.kind == "blind":
            return f"the {self.limit} has had no reading for {self.duration:g} s: its limit is not watched"
        lasts = f" for {self.duration:g} s" if self.duration else ""
        side = "below" if self.limit in AIR and self.value < self.most else "beyond"
        return (
            f"the {words(self.limit)} is {shown(self.limit, self.value)}, "
            f"{side} its limit of {shown(self.limit, self.most)}{lasts}"
        )


class Guard:
    """Holds readings against limits, block after block.

    Parameters
    ----------
    limits : Limits
    rate : float [Hz]
    rig : Rig
        Where its voltage is sensed, and what is in series with the strip.

    Examples
    --------
    >>> from ipmclab.rig.channels import THESIS_RIG
    >>> from ipmclab.rig.safety.limit import Limit
    >>> guard = Guard(Limits(current=Limit(0.1, duration=0.04)), 50.0, THESIS_RIG)
    >>> guard.look(0, {"voltage": np.ones(3), "current": np.array([0.0, 0.2, 0.2])})
    ()
    >>> alarms = guard.look(3, {"voltage": np.ones(2), "current": np.array([0.3, 0.3])})
    >>> [(alarm.row, alarm.action, str(alarm)) for alarm in alarms]
    [(3, 'zero', 'the current is 300 mA, beyond its limit of 100 mA for 0.04 s')]
    """

    def __init__(self, limits: Limits, rate: float, rig: Rig) -> None:
        self._limits = limits.watched
        self._blind = {name: Limit(limit.most, BLIND_TIME, "warn") for name, limit in self._limits.items()}
        self._rate = rate
        self._upstream = rig.voltage_sensed == "upstream of shunt"
        self._shunt = rig.shunt_resistance
        self._source = rig.source_resistance
        self._next = 0
        self._watches: dict[tuple[str, str, bool], _Watch] = {}
        self._means = {name: _Mean(max(1, round(MEAN_TIME * rate))) for name in ("mean_current", "power")}
        self._sums = {name: _Sum() for name in ("charge", "energy")}
        self._held: dict[str, float] = {}
        self._zeroed: int | None = None

    @property
    def is_zeroed(self) -> bool:
        """Whether the output was brought to 0 V: what the strip discharges does not count."""
        return self._zeroed is not None

    def zeroed(self, row: int) -> None:
        """The output was brought to 0 V at a row: from now on only that it gets there is watched."""
        if self._zeroed is None:
            self._zeroed = row

    def look(
        self,
        first_row: int,
        readings: Mapping[str, FloatArray],
        air: Mapping[str, FloatArray] | None = None,
        given: FloatArray | None = None,
    ) -> tuple[Alarm, ...]:
        """Look at a block.

        Parameters
        ----------
        first_row : int
            Row of its first reading.
        readings : mapping of channel to float array, shape (n_block,) [SI]
            ``voltage`` always, and what else is measured; NaN for a reading that is none.
        air : mapping of ``"temperature"`` or ``"relative_humidity"`` to float array, shape (n_slow,), optional
            [degC], [percent] Read by slow instruments some time during the block; those of the readings where one is
            left out or empty.
        given : float array, shape (n_block,) [V], optional
            What the output was commanded to give: a busy computer reads rows late that were sampled before the output
            was brought to 0 V, and those do not show that it is stuck.

        Returns
        -------
        alarms : tuple of Alarm
            In the order of their rows. After ``zeroed`` only that of an output that does not go to 0 V.

        Raises
        ------
        IpmclabError
            A block that begins before the end of the one before it.
        """
        count = len(readings["voltage"])
        if first_row < self._next:
            raise rows_out_of_order(first_row, self._next)
        if not count:
            return ()
        lost, self._next = first_row - self._next, first_row + count
        rows = np.arange(first_row, first_row + count)
        voltage = self._hold("voltage", readings["voltage"])
        current = self._hold("current", readings["current"]) if "current" in readings else None
        alarms: list[Alarm] = []
        alarms += self._plain(rows, readings, air or {})
        if current is not None:
            electrodes = voltage - self._shunt * current if self._upstream else voltage
            alarms += self._sums_and_means(rows, lost, electrodes, current)
        if self._zeroed is None:
            return tuple(sorted(alarms, key=lambda alarm: alarm.row))
        flowing = np.zeros(count) if current is None else current
        output = voltage + flowing * (self._source + (0.0 if self._upstream else self._shunt))
        return self._stuck(
            rows, output, rows > self._zeroed if given is None else (rows > self._zeroed) & (given == 0.0)
        )

    def _plain(self, rows: IntArray, readings: Mapping[str, FloatArray], air: Mapping[str, FloatArray]) -> list[Alarm]:
        """Limits of what is read."""
        alarms: list[Alarm] = []
        for name in ("voltage", "current", "displacement", "force", *AIR):
            limit = self._limits.get(name)
            if limit is None:
                continue
            if len(air.get(name, ())):
                values, at = air[name], np.full(len(air[name]), rows[-1])
            elif name in readings:
                values, at = readings[name], rows
            else:
                continue
            size = values if name in AIR else np.abs(values)
            most = limit.most
            if name == "voltage":
                most += max(VOLTAGE_TOLERANCE * most, LEAST_TOLERANCE)
            missing = np.isnan(values)
            blind = self._alarms(name, self._blind[name], at, values, missing, kind="blind")
            if missing.any():
                at, values, size = at[~missing], values[~missing], size[~missing]
            alarms += self._alarms(name, limit, at, values, size > most)
            if limit.least is not None:
                alarms += self._alarms(name, limit, at, values, values < limit.least, end=limit.least)
            alarms += blind
        return alarms

    def _sums_and_means(self, rows: IntArray, lost: int, voltage: FloatArray, current: FloatArray) -> list[Alarm]:
        """Limits of what is computed from voltage and current."""
        size = _whole(np.abs(current))
        into = _whole(voltage * current)
        added = {
            "mean_current": size,
            "power": into,
            "charge": np.where(np.abs(voltage) > ELECTROLYSIS, size, 0),
            "energy": into,
        }
        alarms: list[Alarm] = []
        for name, values in added.items():
            limit = self._limits.get(name)
            if limit is None:
                continue
            if name in self._means:
                total, per_unit = self._means[name].add(lost, values), _PER_UNIT * self._means[name].rows
            else:
                total, per_unit = self._sums[name].add(lost, values), _PER_UNIT * self._rate
            alarms += self._alarms(name, limit, rows, total / per_unit, total > round(limit.most * per_unit))
        return alarms

    def _stuck(self, rows: IntArray, output: FloatArray, late: BoolArray) -> tuple[Alarm, ...]:
        limit = Limit(RESIDUAL_VOLTAGE, ZEROING_TIME, "zero")
        beyond = np.abs(output[late]) > RESIDUAL_VOLTAGE
        return tuple(self._alarms("voltage", limit, rows[late], output[late], beyond, kind="stuck"))

    def _alarms(
        self,
        name: str,
        limit: Limit,
        rows: IntArray,
        values: FloatArray,
        beyond: BoolArray,
        kind: Literal["limit", "blind", "stuck"] = "limit",
        end: float | None = None,
    ) -> list[Alarm]:
        """What passes a limit, at its lower ``end`` where one is given."""
        watched = name, kind, end is None
        watch = self._watches.get(watched)
        if watch is None:
            if not beyond.any():
                return []
            wait = math.ceil(limit.duration * self._rate - 1e-9)
            between = math.ceil(self._rate) if limit.action == "warn" else 0
            watch = self._watches[watched] = _Watch(wait, between)
        return [
            Alarm(
                name,
                kind,
                int(rows[place]),
                int(rows[place]) / self._rate,
                float(values[place]),
                limit.most if end is None else end,
                limit.duration,
                limit.action,
            )
            for place in watch.acts(rows, beyond)
        ]

    def _hold(self, name: str, values: FloatArray) -> FloatArray:
        """Each reading, and in the place of one that is none the one before it."""
        if not np.isnan(values).any():
            self._held[name] = float(values[-1])
            return values
        extended = np.concatenate([[self._held.get(name, 0.0)], values])
        held = extended[np.maximum.accumulate(np.where(np.isnan(extended), 0, np.arange(len(extended))))]
        self._held[name] = float(held[-1])
        return held[1:]


class _Watch:
    """Reports when something has been so for a number of rows without a break.

    Parameters
    ----------
    rows : int
        From the first row at which it is found to the row at which the watch acts.
    between : int
        Rows from one time that it acts to the next, at least: noise about a limit passes it thousands of times.
    """

    def __init__(self, rows: int, between: int) -> None:
        self._rows = rows
        self._between = between
        self._last: int | None = None
        self._since: int | None = None
        self._acted = False

    def acts(self, rows: IntArray, beyond: BoolArray) -> list[int]:
        """The places in ``rows`` at which it acts: once each time that it has been so for long enough."""
        if not len(rows) or (self._since is None and not beyond.any()):
            return []
        was = np.concatenate([[self._since is not None], beyond[:-1]])
        begins = np.where(beyond & ~was, rows, 0)
        if self._since is not None and beyond[0]:
            begins[0] = self._since
        reached = beyond & (rows - np.maximum.accumulate(begins) >= self._rows)
        before = np.concatenate([[self._acted], reached[:-1]])
        found = np.flatnonzero(reached & ~before)
        self._since = int(np.maximum.accumulate(begins)[-1]) if beyond[-1] else None
        self._acted = bool(reached[-1])
        places = []
        for place in found:
            if self._last is None or rows[place] - self._last >= self._between:
                self._last = int(rows[place])
                places.append(int(place))
        return places


class _Mean:
    """The sum over the last rows: of so many values from before the first one, which are 0.

    Parameters
    ----------
    rows : int
    """

    def __init__(self, rows: int) -> None:
        self.rows = rows
        self._last = np.zeros(rows, dtype=np.int64)

    def add(self, lost: int, values: IntArray) -> IntArray:
        """The sum that ends with each of the values; ``lost`` rows before them were not read."""
        fill = np.full(min(lost, self.rows), max(int(self._last[-1]), int(values[0])), dtype=np.int64)
        joined = np.concatenate([self._last, fill, values])
        sums = np.cumsum(joined)
        self._last = joined[-self.rows :]
        found: IntArray = sums[-len(values) :] - sums[-len(values) - self.rows : -self.rows]
        return found


class _Sum:
    """The sum of all values so far."""

    def __init__(self) -> None:
        self._total = self._last = 0

    def add(self, lost: int, values: IntArray) -> IntArray:
        """The sum that ends with each of the values; ``lost`` rows before them were not read."""
        start = self._total + lost * max(self._last, int(values[0]))
        sums: IntArray = np.cumsum(values) + max(-_LARGEST_SUM, min(start, _LARGEST_SUM))
        self._total, self._last = int(sums[-1]), int(values[-1])
        return sums


def rows_out_of_order(first_row: int, expected: int) -> IpmclabError:
    """The error of a block that begins before the end of the one before it."""
    return IpmclabError(
        f"a block begins at row {first_row}, row {expected} was expected",
        code="rows-out-of-order",
        where="bench",
        repair="the clock of the bench went back: reset it, and record again",
    )


def _whole(values: FloatArray) -> IntArray:
    return np.rint(values.clip(-_LARGEST, _LARGEST) * _PER_UNIT).astype(np.int64)
