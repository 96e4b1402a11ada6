"""What every figure shares: panels over a common time axis, curves, and shaded rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ipmclab.reporting.decimate import decimate
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.style import COLOURS, LINES, SERIES, label_text
from ipmclab.reporting.wording import spelled_unit
from ipmclab.units import CHANNELS, Quantity

_BAND_POINTS: Final = 400
"""Stretches of rows that a band is drawn in: as fine as a pixel."""

_COLUMNS: Final = 4  # entries of a legend side by side
_ROW: Final = 0.19  # height of a row of them [inch]
_MANY: Final = 4  # entries of a legend from which its longest word gives way to the panel's name
_ROOM: Final = 45  # letters that such a row of them has (measured: a figure of a report, "displacement (mm)")
_SHORTEST: Final = 12  # letters that a name keeps

FloatArray = npt.NDArray[np.float64]

MEASURED: Final[dict[str, Any]] = {"color": COLOURS["measured"], "linewidth": 2.0}
"""How a measured curve is drawn under the curves of models."""


def series(index: int) -> dict[str, Any]:
    """Colour and line pattern of the index-th of several runs."""
    return {"color": COLOURS[SERIES[index % len(SERIES)]], "linestyle": LINES[index // len(SERIES) % len(LINES)]}


def model_series(index: int) -> dict[str, Any]:
    """Colour and line pattern of the index-th of several models: where they agree, both stay visible."""
    return {"color": COLOURS[SERIES[index % len(SERIES)]], "linestyle": LINES[index % len(LINES)]}


def stacked(heights: Sequence[float], *, named_above: int = 1, named_in_each: int = 1) -> tuple[Figure, list[Axes]]:
    """Panels of these heights [inch], one above the other, over one time axis.

    Parameters
    ----------
    heights : sequence of float [inch]
    named_above, named_in_each : int
        How many entries the legend of the first panel has, and that of any other one: they have room above it.
    """
    usual = Margins()
    above, between = (_ROW * (math.ceil(count / _COLUMNS) - 1) for count in (named_above, named_in_each))
    margins = replace(usual, top=usual.top + max(above, 0.0), row_gap=usual.row_gap + max(between, 0.0))
    figure, grid = panel_grid(heights, margins=margins, sharex="all")
    panels: list[Axes] = list(grid[:, 0])
    for panel in panels:
        panel.margins(x=0.01)
    for panel in panels[:-1]:
        panel.tick_params(axis="x", bottom=False)
    panels[-1].set_xlabel("time (s)")
    return figure, panels


def name_panel(panel: Axes, text: str, quantity: Quantity, *, ticks: int = 4, bold: bool = True) -> None:
    """Write what a panel shows, and its unit, above its left end."""
    panel.set_title(f"{text} ({spelled_unit(quantity.display_unit)})", fontweight="bold" if bold else "normal")
    panel.yaxis.set_major_locator(MaxNLocator(nbins=ticks, steps=[1, 2, 2.5, 5, 10]))
    # The power of ten of very small numbers would stand in the title.
    panel.yaxis.set_offset_position("right")


def name_rows(panel: Axes, names: Sequence[str], *, beyond: float = 0.5, **looks: Any) -> None:
    """A panel with a name at each place of its vertical axis, from 0 at the top on, and a grid across.

    Parameters
    ----------
    beyond : float
        How far it goes beyond the first and the last place.
    **looks
        Of the names.
    """
    panel.set_yticks(range(len(names)), list(names), **looks)
    panel.set_ylim(len(names) - 1.0 + beyond, -beyond)
    panel.grid(visible=True, axis="x")
    panel.grid(visible=False, axis="y")
    panel.tick_params(axis="y", length=0)


def curve(panel: Axes, channel: str, time: FloatArray, values: FloatArray, **look: Any) -> None:
    """Draw one channel in its display unit, decimated, with gaps where it is NaN."""
    panel.plot(*decimate(time, CHANNELS[channel].to_display(values)), **look)


def left_out_curve(panel: Axes, channel: str, time: FloatArray, values: FloatArray, **look: Any) -> None:
    """Draw readings that were left out, thin: they are shown, but do not set the scale."""
    low, high = panel.dataLim.intervaly
    curve(panel, channel, time, values, **{"color": COLOURS["measured"], "linewidth": 0.7, "alpha": 0.8, **look})
    panel.dataLim.intervaly = (float(low), float(high))


def band(
    panel: Axes, channel: str, time: FloatArray, middle: FloatArray, reach: FloatArray, *, label: str = ""
) -> None:
    """Shade a channel's band in its display unit: between the least and the most of each stretch of rows."""
    stretch = max(1, len(time) // _BAND_POINTS)
    starts = np.arange(0, len(time), stretch)
    shown = CHANNELS[channel].to_display
    low = np.fmin.reduceat(shown(middle - reach), starts)
    high = np.fmax.reduceat(shown(middle + reach), starts)
    # The last stretch reaches to the last row.
    at = np.append(time[starts], time[-1])
    low, high = np.append(low, low[-1]), np.append(high, high[-1])
    step: Literal["post"] | None = "post" if stretch > 1 else None
    panel.fill_between(at, low, high, step=step, color=COLOURS["sky"], alpha=0.35, linewidth=0, label=label)


def scale_to_lines(panel: Axes) -> None:
    """Scale a panel to its lines; a wider band is shown up to half of their span on either side."""
    ends = [end for line in panel.lines for end in _ends(np.asarray(line.get_ydata(), dtype=float))]
    if not ends:
        return
    low, high = min(ends), max(ends)
    room = 0.5 * (high - low) or 1.0
    below, above = panel.dataLim.intervaly
    panel.set_ylim(max(below, low - room) - 0.1 * room, min(above, high + room) + 0.1 * room)


def _ends(values: FloatArray) -> list[float]:
    known = values[np.isfinite(values)]
    return [float(known.min()), float(known.max())] if len(known) else []


def held_curve(panel: Axes, time: FloatArray, voltage: FloatArray, hold: str, **look: Any) -> None:
    """Draw a voltage as it was held between the rows."""
    shape = {"zero": "steps-post", "zero-before": "steps-pre"}.get(hold, "default")
    panel.plot(*decimate(time, voltage), drawstyle=shape, **look)
    low, high = panel.dataLim.intervaly
    margin = 0.08 * (max(high, 0.0) - min(low, 0.0)) or 1.0
    panel.set_ylim(min(low, 0.0) - margin, max(high, 0.0) + margin)


def shade(
    panel: Axes,
    time: FloatArray,
    rows: Sequence[tuple[int, int]],
    *,
    colour: str,
    label: str = "",
    height: float = 1.0,
) -> None:
    """Shade half-open ranges of rows, from the foot of a panel to a part of its height.

    A range of one row stays visible. Many short ranges, such as the single stale values of a
    long record, are joined where less than a pixel lies between them.
    """
    for index, (begin, end) in enumerate(blocks(time, rows)):
        opacity = 0.28 if height == 1.0 else 0.8
        named = label if index == 0 else ""
        panel.axvspan(begin, end, ymax=height, color=colour, alpha=opacity, linewidth=0, label=named)


def blocks(time: FloatArray, rows: Sequence[tuple[int, int]]) -> list[list[float]]:
    """From when to when ranges of rows are shaded: none too short to be visible, none nearer to the next than a
    pixel."""
    least = 0.002 * (time[-1] - time[0])
    joined: list[list[float]] = []
    for start, stop in sorted(rows):
        begin, end = float(time[start]), float(time[min(stop, len(time)) - 1])
        if end - begin < least:
            begin, end = (begin + end - least) / 2, (begin + end + least) / 2
        if joined and begin - joined[-1][1] < least / 2:
            joined[-1][1] = max(end, joined[-1][1])
        else:
            joined.append([begin, end])
    return joined


def legend_above(panel: Axes, *, columns: int = _COLUMNS) -> None:
    """A legend above the right end of a panel, out of the way of the curves and of the panel's name."""
    handles, labels = panel.get_legend_handles_labels()
    if handles:
        if len(handles) >= _MANY:
            room = _ROOM - sum(sorted(map(len, labels))[:-1])
            labels = [label_text(label, longest=max(room, _SHORTEST)) for label in labels]
        panel.legend(
            handles,
            labels,
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            ncols=min(columns, len(handles)),
            borderaxespad=0.2,
            columnspacing=1.4,
        )
