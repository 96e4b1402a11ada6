"""The life of a sample on one time line: clamped, driven, out of the water, and how its fingerprint changed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Final

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ipmclab.errors import InputError
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.figures.panels import legend_above, name_panel
from ipmclab.reporting.style import COLOURS, label_text, style
from ipmclab.store.catalogue.life import Event, Life
from ipmclab.store.catalogue.query import CatalogueRow
from ipmclab.units import CAPACITANCE, RELATIVE_HUMIDITY, RESISTANCE, VOLTAGE, Quantity

FloatArray = npt.NDArray[np.float64]

_PAUSES: Final = tuple(hours * 3600.0 for hours in (2, 12, 48, 14 * 24, 90 * 24, math.inf))
"""Without a run for so long [s], the time line is cut: nights and weeks would leave no room for the work. The longer
the life, the longer the pauses that are kept."""

_MOST_STRETCHES: Final = 12
"""Between cuts; more would be too narrow to read."""

_CUT: Final = 0.035
"""Width of a cut, as a part of the time line."""

_LEAST: Final = 0.05
"""Least width of the time between two cuts, as a part of the time line."""

_NARROW: Final = 0.09
"""Two times nearer than this, as a part of the time line, are not both written."""

_NUMBER: Final = 0.025
"""Room that the number of a mounting needs, as a part of the time line."""

_PURPOSES: Final = {"signal": "blue", "baseline": "orange", "fingerprint": "green", "reference": "purple"}


@dataclass(frozen=True)
class _Stretch:
    """A time without a pause, and where it lies on the paper from 0 to 1."""

    start: float
    stop: float
    left: float
    right: float


def life_figure(life: Life) -> Figure:
    """Draw the life of a sample.

    Parameters
    ----------
    life : Life
        With at least one run that has a date.

    Raises
    ------
    InputError
        When no run has a date.

    Notes
    -----
    From top to bottom: every run at its time, as high as its amplitude, over the mountings; series resistance and
    capacitance of the fingerprints, joined within a mounting; the time out of the water; the humidity. Panels without
    anything to show are left out. The time line is cut where nothing was recorded for two hours, or for longer where
    there are many such pauses.
    """
    if not life.runs:
        raise InputError(
            "no run of it says when it was recorded",
            code="no-dates",
            where=f"sample {life.sample}",
            repair="state recorded_at when importing, or record with ipmclab",
        )
    stretches = _stretches(life)
    place = _places(stretches)
    numbers: list[tuple[str, Quantity, Callable[[CatalogueRow], float | None]]] = [
        ("series resistance", RESISTANCE, lambda row: row.series_resistance),
        ("capacitance", CAPACITANCE, lambda row: row.capacitance),
        ("out of the water", _MINUTES, lambda row: row.minutes_out_of_water),
        ("relative humidity", RELATIVE_HUMIDITY, lambda row: row.relative_humidity),
    ]
    shown = [(name, quantity, of) for name, quantity, of in numbers if any(of(row) is not None for row in life.runs)]
    with style():
        figure, grid = panel_grid([1.1, *(0.9 for _ in shown)], margins=Margins(bottom=0.6), sharex="all")
        panels: list[Axes] = list(grid[:, 0])
        for panel in panels[:-1]:
            panel.tick_params(axis="x", bottom=False)
        _draw_runs(panels[0], life, place)
        for panel, (name, quantity, of) in zip(panels[1:], shown, strict=True):
            _draw_number(panel, life, place, quantity, of)
            name_panel(panel, name, quantity)
        for panel in panels:
            for one, other in itertools.pairwise(stretches):
                cut = (one.right + 0.004, other.left - 0.004)
                panel.axvspan(*cut, facecolor="none", edgecolor=COLOURS["rule"], hatch="/////", linewidth=0)
            panel.set_xlim(-0.01, 1.01)
        _draw_times(panels[-1], stretches)
        panels[-1].set_xlabel(f"life of {label_text(life.sample)}")
    return figure


_MINUTES: Final = Quantity("time out of the water", "", "min")


def _spans(life: Life, pause: float) -> list[list[float]]:
    """Start and end [s] of each time without so long a pause."""
    spans: list[list[float]] = []
    for event in life.events:
        end = event.time + (event.row.duration or 0.0 if event.kind == "run" else 0.0)
        if spans and event.time - spans[-1][1] <= pause:
            spans[-1][1] = max(end, spans[-1][1])
        else:
            spans.append([event.time, end])
    return spans


def _stretches(life: Life) -> list[_Stretch]:
    spans = next(found for pause in _PAUSES if len(found := _spans(life, pause)) <= _MOST_STRETCHES)
    lengths = np.array([max(stop - start, 1.0) for start, stop in spans])
    shares = np.maximum(lengths / lengths.sum(), _LEAST)
    shares *= (1.0 - _CUT * (len(spans) - 1)) / shares.sum()
    lefts = np.concatenate([[0.0], np.cumsum(shares + _CUT)[:-1]])
    return [
        _Stretch(start, max(stop, start + 1.0), float(left), float(left + share))
        for (start, stop), left, share in zip(spans, lefts, shares, strict=True)
    ]


def _places(stretches: Sequence[_Stretch]) -> Callable[[float], float]:
    times = [time for one in stretches for time in (one.start, one.stop)]
    places = [place for one in stretches for place in (one.left, one.right)]
    return lambda time: float(np.interp(time, times, places))


def _draw_runs(panel: Axes, life: Life, place: Callable[[float], float]) -> None:
    """Each run as a bar from zero to its amplitude; mountings behind it, and the water below."""
    _draw_mountings(panel, life, place)
    named: set[str] = set()
    for row in life.runs:
        assert row.recorded is not None
        purpose = row.purpose or "signal"
        spoilt = row.state in ("aborted", "recovered", "damaged")
        label = "ended early" if spoilt else purpose
        colour = COLOURS["vermillion" if spoilt else _PURPOSES.get(purpose, "blue")]
        begin, end = place(row.recorded), place(row.recorded + (row.duration or 0.0))
        height = row.amplitude or 0.0
        panel.bar(
            begin,
            height,
            width=max(end - begin, 0.004),
            align="edge",
            color=colour,
            linewidth=0,
            label="" if label in named else label,
        )
        if height == 0.0:  # a baseline, or a signal whose size is not known
            panel.plot([begin], [0.0], marker="o", markersize=3.5, color=colour, linestyle="none")
        named.add(label)
    water = [event.time for event in life.events if event.kind == "out of water"]
    panel.plot(
        [place(time) for time in water],
        [0.0] * len(water),
        marker=7,  # a caret that points down to the line
        markersize=6,
        color=COLOURS["sky"],
        linestyle="none",
        label="out of the water" if water else "_none",
        clip_on=False,
        zorder=5,
    )
    panel.axhline(0.0, color=COLOURS["muted"], linewidth=0.6)
    panel.margins(y=0.18)
    name_panel(panel, "voltage", VOLTAGE)
    legend_above(panel, columns=5)


def _draw_mountings(panel: Axes, life: Life, place: Callable[[float], float]) -> None:
    numbers = {name: number for number, name in enumerate(life.mountings, start=1)}
    clamped: list[Event] = [event for event in life.events if event.kind == "clamped"]
    wrote = -1.0
    for event, following in itertools.zip_longest(clamped, clamped[1:]):
        until = following.time if following is not None else math.inf
        inside = [row for row in life.runs if row.recorded is not None and event.time <= row.recorded < until]
        last = max(((row.recorded or 0.0) + (row.duration or 0.0) for row in inside), default=event.time)
        left, right = place(event.time) - 0.004, place(last) + 0.004
        panel.axvspan(left, right, color=COLOURS["measured"], alpha=0.22, linewidth=0)
        number = numbers[str(event.row.mounting)]
        if left - wrote < _NUMBER:
            continue
        text = f"mounting {number}" if right - left > _NARROW else str(number)
        above = panel.get_xaxis_transform()
        panel.text(left + 0.004, 0.98, text, transform=above, fontsize=6.5, va="top", clip_on=True)
        wrote = left


def _draw_number(
    panel: Axes,
    life: Life,
    place: Callable[[float], float],
    quantity: Quantity,
    of: Callable[[CatalogueRow], float | None],
) -> None:
    """Points at the runs that give a number, joined within a mounting."""
    for _, rows in itertools.groupby(life.runs, key=lambda row: row.mounting):
        known = [(place(row.recorded or 0.0), value) for row in rows if (value := of(row)) is not None]
        if known:
            times, values = zip(*known, strict=True)
            shown = quantity.to_display(np.array(values))
            panel.plot(times, shown, marker="o", markersize=3.5, color=COLOURS["blue"], linewidth=0.9)
    panel.margins(y=0.2)


def _draw_times(panel: Axes, stretches: Sequence[_Stretch]) -> None:
    """The time of day at which each stretch starts and, where there is room, at which it ends; the day below."""
    chosen: dict[float, float] = {}
    ends = [(one.left, one.start) for one in stretches] + [(one.right, one.stop) for one in stretches]
    for place, time in ends:
        if all(abs(place - other) >= _NARROW for other in chosen):
            chosen[place] = time
    labels: list[str] = []
    day = ""
    for _, time in sorted(chosen.items()):
        moment = datetime.fromtimestamp(time)
        today = f"{moment.day} {moment:%b %Y}"
        labels.append(f"{moment:%H:%M}" + ("" if today == day else f"\n{today}"))
        day = today
    panel.set_xticks(sorted(chosen), labels)
    panel.tick_params(axis="x", labelsize=7.0)
    for place, label in zip(sorted(chosen), panel.get_xticklabels(), strict=True):
        label.set_horizontalalignment("right" if place > 1.0 - _NARROW / 2 else "center")
