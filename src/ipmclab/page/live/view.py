"""What one browser looks at: a sliding window, or the whole run; and the frames that bring it up to date."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterable, Mapping
from typing import Any, Final

from ipmclab.page.live.columns import Columns
from ipmclab.page.thin import envelope, thin, within
from ipmclab.page.wire import FloatArray, pack
from ipmclab.run import SLOW_CHANNELS
from ipmclab.units import CHANNELS

MOST_IN_WINDOW: Final = 6000
"""Rows of a window; at higher rates each bunch of rows is sent as its lowest and its highest."""

WHOLE_EVERY: Final = 0.5
"""How often [s] the whole run is sent again."""

_LONGEST_WINDOW: Final = 600.0


class View:
    """What one browser looks at."""

    def __init__(self) -> None:
        self._wanted: dict[str, Any] = {"view": "none"}
        self._generation = -1
        self._thinned = -1
        self._sent = 0
        self._count = -1
        self._last = 0.0

    def choose(self, wanted: Mapping[str, Any]) -> None:
        """What the browser wants from now on.

        Raises
        ------
        ValueError, TypeError, KeyError
            Nothing that can be looked at.
        """
        kind = wanted["view"]
        if kind == "window":
            seconds = float(wanted["seconds"])
            if not 0.0 < seconds <= _LONGEST_WINDOW:
                raise ValueError(seconds)
            self._wanted = {"view": "window", "seconds": seconds}
        elif kind == "whole":
            ends = [None if wanted.get(name) is None else float(wanted[name]) for name in ("begin", "end")]
            if any(end is not None and not math.isfinite(end) for end in ends):
                raise ValueError(ends)
            points = min(max(int(wanted.get("points", 2000)), 16), 8000)
            self._wanted = {"view": "whole", "begin": ends[0], "end": ends[1], "points": points}
        else:
            self._wanted = {"view": "none"}
        self._generation, self._last = -1, 0.0

    async def frames(self, columns: Columns, generation: int, now: float) -> list[bytes]:
        """What is to be sent, perhaps nothing."""
        kind = self._wanted["view"]
        if kind == "none":
            return []
        fresh = generation != self._generation
        if kind == "whole":
            if not fresh and (now - self._last < WHOLE_EVERY or columns.rows_received == self._count):
                return []
            self._generation, self._last, self._count = generation, now, columns.rows_received
            return [await asyncio.to_thread(self._whole, columns, generation)]
        return self._rows(columns, generation, fresh)

    def _whole(self, columns: Columns, generation: int) -> bytes:
        time, values = columns.snapshot()
        shown = within(time, self._wanted["begin"], self._wanted["end"])
        arrays: dict[str, FloatArray] = {}
        for name, column in values.items():
            arrays[f"{name}.time"], arrays[f"{name}.value"] = thin(time[shown], column[shown], self._wanted["points"])
        end = float(time[-1]) if len(time) else 0.0
        return pack({**_head("whole", values, generation, end), "end": end}, arrays)

    def _rows(self, columns: Columns, generation: int, fresh: bool) -> list[bytes]:
        window = round(self._wanted["seconds"] * columns.rate)
        bunch = 1 if window <= MOST_IN_WINDOW else 2 * math.ceil(window / MOST_IN_WINDOW)
        fresh = fresh or columns.thinned != self._thinned
        if fresh:
            self._generation, self._thinned = generation, columns.thinned
            self._sent = max(0, len(columns) - window - 1)
        time, values = columns.snapshot(self._sent)
        count = len(time) - len(time) % bunch
        if not count:
            self._generation = -1 if fresh else self._generation
            return []
        first, now = self._sent, float(time[-1])
        self._sent += count
        if bunch > 1:
            time, bunched = envelope(time, list(values.values()), bunch)
            values = dict(zip(values, bunched, strict=True))
        head = {**_head("rows", values, generation, now), "fresh": fresh, "first": first, "count": count}
        return [pack(head, {"time": time, **values})]


def _head(kind: str, channels: Iterable[str], generation: int, now: float) -> dict[str, Any]:
    there = list(channels)
    panels = [
        {
            "key": name,
            "label": quantity.name,
            "unit": quantity.display_unit,
            "factor": quantity.to_display(1.0),
            "least": _LEAST.get(name, 0.0),
            "small": name in SLOW_CHANNELS,
            "series": [{"key": name, "label": quantity.name, "colour": _COLOURS[name], "style": "line"}],
        }
        for name, quantity in CHANNELS.items()
        if name in there
    ]
    return {"kind": kind, "generation": generation, "channels": there, "panels": panels, "now": now}


_COLOURS: Final = {
    "voltage": 0,
    "current": 1,
    "displacement": 2,
    "force": 3,
    "applied_voltage": 6,
    "temperature": 4,
    "relative_humidity": 5,
    "chamber_temperature": 4,
    "chamber_relative_humidity": 5,
}

_LEAST: Final = {
    "voltage": 0.02,
    "current": 0.05,
    "temperature": 0.5,
    "relative_humidity": 1.0,
    "chamber_temperature": 0.5,
    "chamber_relative_humidity": 1.0,
}
"""The least span of an axis, in display units: noise must not fill it."""
