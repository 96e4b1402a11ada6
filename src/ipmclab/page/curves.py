"""Curves of past runs, fits and simulations: kept whole on the server, sent thinned to what a plot can show."""

from __future__ import annotations

import secrets
import threading
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ipmclab.page.thin import POINTS, thin, within
from ipmclab.page.wire import MEDIA, FloatArray, pack
from ipmclab.run import SLOW_CHANNELS
from ipmclab.units import CHANNELS, Quantity

if TYPE_CHECKING:
    from fastapi import APIRouter

    from ipmclab.run import Run

MOST_BYTES: Final = 128 * 1024 * 1024
"""Of all curves together: those that were asked for longest ago go first."""

MOST_POINTS: Final = 20_000
"""Of one curve in one answer."""

_STYLES: Final = ("line", "dashed", "dotted")

_CSV_ROWS: Final = 5000  # of one piece on its way to the browser


@dataclass(frozen=True, eq=False)
class Series:
    """One curve.

    Parameters
    ----------
    key, label : str
    time : float array, shape (n,) [s]
    values : float array, shape (n,)
        In the unit of its panel, before ``factor``; NaN is a gap.
    colour : int
        Place in the palette.
    style : "line", "dashed", "dotted" or "points"
    """

    key: str
    label: str
    time: FloatArray
    values: FloatArray
    colour: int = 0
    style: str = "line"


@dataclass(frozen=True, eq=False)
class Panel:
    """One quantity with its curves.

    Parameters
    ----------
    key, label, unit : str
        The unit that is shown.
    series : sequence of Series
    factor : float
        From the unit of the values to the one that is shown.
    """

    key: str
    label: str
    unit: str
    series: Sequence[Series]
    factor: float = 1.0

    @classmethod
    def of(cls, key: str, quantity: Quantity, series: Sequence[Series], label: str | None = None) -> Panel:
        """The panel of a quantity whose values are in SI units."""
        return cls(key, label or quantity.name, quantity.display_unit, series, quantity.to_display(1.0))

    def as_dict(self) -> dict[str, Any]:
        """What the plot in the browser needs to know in addition to the data."""
        return {
            "key": self.key,
            "label": self.label,
            "unit": self.unit,
            "factor": self.factor,
            "series": [
                {"key": one.key, "label": one.label, "colour": one.colour, "style": one.style} for one in self.series
            ],
        }


def run_panels(runs: Mapping[str, Run]) -> list[Panel]:
    """The channels of one run, or of several over each other, one panel a channel.

    Parameters
    ----------
    runs : mapping of label to Run
        Their colours and styles follow their order.
    """
    panels = []
    for name in CHANNELS:
        series = [
            Series(f"{name}.{place}", label, _times(run, name), run.channels[name], place % 8, _STYLES[place % 3])
            for place, (label, run) in enumerate(runs.items())
            if name in run.channels
        ]
        if series:
            panels.append(Panel.of(name, CHANNELS[name], series))
    return panels


def compared_panels(arrays: Mapping[str, FloatArray], models: Mapping[str, str], *, residuals: bool) -> list[Panel]:
    """Measured against one or several models, each output with what is left over below it.

    Parameters
    ----------
    arrays : mapping of ``PREFIX.OUTPUT.measured`` (``.model``, ``.residual``, ``.time``) to float array [SI]
    models : mapping of prefix to label
        The measured curve is that of the first.
    residuals : bool
    """
    first = next(iter(models))
    panels = []
    for name, quantity in CHANNELS.items():
        if f"{first}.{name}.measured" not in arrays:
            continue
        series = [Series(f"{name}.measured", "measured", *_curve(arrays, first, name, "measured"), 7)]
        left = []
        for place, (prefix, label) in enumerate(models.items()):
            look: dict[str, Any] = {"colour": place % 6, "style": _STYLES[place % 3]}
            series.append(Series(f"{name}.{place}", label, *_curve(arrays, prefix, name, "model"), **look))
            left.append(Series(f"{name}.{place}.left", label, *_curve(arrays, prefix, name, "residual"), **look))
        panels.append(Panel.of(name, quantity, series))
        if residuals:
            panels.append(Panel.of(f"{name}.left", quantity, left, "measured − model"))
    return panels


def _curve(arrays: Mapping[str, FloatArray], prefix: str, output: str, what: str) -> tuple[FloatArray, FloatArray]:
    return arrays[f"{prefix}.{output}.time"], arrays[f"{prefix}.{output}.{what}"]


def _times(run: Run, channel: str) -> FloatArray:
    slow = run.time_environment
    return slow if slow is not None and channel in SLOW_CHANNELS else run.time


class CurveStore:
    """Curves that browsers may ask for, by keys that nobody can guess."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most_bytes = most_bytes
        self._kept: OrderedDict[str, tuple[Panel, ...]] = OrderedDict()
        self._lock = threading.Lock()

    def add(self, panels: Sequence[Panel]) -> str:
        """Keep curves; the address at which they are asked for."""
        key = secrets.token_urlsafe(9)
        with self._lock:
            self._kept[key] = tuple(panels)
            while self._bytes() > self._most_bytes and len(self._kept) > 1:
                self._kept.popitem(last=False)
        return f"/curves/{key}"

    def forget(self, address: str | None) -> None:
        """Let curves go that are shown no more."""
        with self._lock:
            self._kept.pop((address or "").rpartition("/")[2], None)

    def get(self, key: str) -> tuple[Panel, ...] | None:
        """Curves by their key; those asked for are kept longest."""
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
            return self._kept.get(key)

    def _bytes(self) -> int:
        # Curves of a run share its times: each array counts once.
        arrays = {
            id(array): array.nbytes
            for panels in self._kept.values()
            for panel in panels
            for one in panel.series
            for array in (one.time, one.values)
        }
        return sum(arrays.values())


def answer(panels: Sequence[Panel], begin: float | None, end: float | None, points: int) -> bytes:
    """The curves from ``begin`` to ``end`` [s], each thinned to so many points; and from when to when they are."""
    times = [one.time for panel in panels for one in panel.series if len(one.time)]
    whole = [min(float(time[0]) for time in times), max(float(time[-1]) for time in times)] if times else None
    arrays: dict[str, FloatArray] = {}
    for panel in panels:
        for one in panel.series:
            part = within(one.time, begin, end)
            arrays[f"{one.key}.time"], arrays[f"{one.key}.value"] = thin(one.time[part], one.values[part], points)
    return pack({"kind": "curves", "panels": [panel.as_dict() for panel in panels], "whole": whole}, arrays)


def csv_lines(panels: Sequence[Panel]) -> Iterator[str]:
    """All rows of all curves as text, in the units that are shown: those read at the same times share a table.

    Examples
    --------
    >>> time, current = np.array([0.0, 0.5]), np.array([0.06, np.nan])
    >>> print("".join(csv_lines([Panel.of("current", CHANNELS["current"], [Series("c", "", time, current)])])), end="")
    time [s],current [mA]
    0,60
    0.5,
    """
    tables: dict[int, list[tuple[Panel, Series]]] = {}
    for panel in panels:
        for one in panel.series:
            tables.setdefault(id(one.time), []).append((panel, one))
    for place, those in enumerate(tables.values()):
        if place:
            yield "\n"
        headings = [
            f"{panel.label} {one.label} [{panel.unit}]" if len(panel.series) > 1 else f"{panel.label} [{panel.unit}]"
            for panel, one in those
        ]
        yield ",".join(["time [s]", *map(_quoted, headings)]) + "\n"
        time = those[0][1].time
        for start in range(0, len(time), _CSV_ROWS):
            rows = slice(start, start + _CSV_ROWS)
            table = np.column_stack([time[rows], *(one.values[rows] * panel.factor for panel, one in those)])
            yield "".join(",".join(map(_cell, row)) + "\n" for row in table.tolist())


def _cell(value: float) -> str:
    return "" if value != value else f"{value:.10g}"


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if any(mark in text for mark in ',"\n') else text


def routes(store: CurveStore) -> APIRouter:
    """Serve the curves of a store."""
    from fastapi import APIRouter, Response
    from fastapi.responses import PlainTextResponse, StreamingResponse

    router = APIRouter()

    @router.get("/curves/{key}", response_model=None)
    def curves(
        key: str, points: int = POINTS, begin: float | None = None, end: float | None = None, csv: str | None = None
    ) -> Response:
        panels = store.get(key)
        if panels is None:
            return PlainTextResponse("these curves are no longer kept: open them again", status_code=404)
        if csv is not None:
            headers = {"Content-Disposition": f'attachment; filename="{header_name(csv)}.csv"'}
            return StreamingResponse(csv_lines(panels), media_type="text/csv; charset=utf-8", headers=headers)
        most = min(max(points, 8), MOST_POINTS)
        return Response(answer(panels, begin, end, most), media_type=MEDIA, headers={"cache-control": "no-store"})

    return router


def header_name(name: str) -> str:
    """A file name from the page as a header can hold it.

    Examples
    --------
    >>> header_name('step 1 V"\\r\\nx: y')
    'step1Vxy'
    """
    kept = "".join(letter for letter in name if letter.isascii() and (letter.isalnum() or letter in "._+-"))
    return kept.strip(".")[:80] or "data"
