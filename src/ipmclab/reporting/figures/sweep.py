"""A sweep: which parameter each metric depends on, and how."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from ipmclab.model.reductions import quantity_of
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.figures.panels import name_rows
from ipmclab.reporting.style import COLOURS, style
from ipmclab.reporting.wording import plain, power_of_ten, spelled_unit
from ipmclab.units import CHANNELS, Quantity

if TYPE_CHECKING:
    from ipmclab.sweep import Swept

FloatArray = npt.NDArray[np.float64]

_POINTS: Final = 2000
_BINS: Final = 12
_SHOWN: Final = 4
"""Parameters that metrics are drawn against: those that matter most to any of them."""

_WORDS: Final = {"peak_time": "time of peak"}


def sweep_figure(swept: Swept) -> Figure:
    """Draw a sweep, a row for each metric.

    First the Sobol indices or Morris's effects of the parameters with their 95 % intervals, where the design gives
    them; then the metric against the parameters that matter most, with its mean in slices of each.

    Parameters
    ----------
    swept : Swept

    Returns
    -------
    figure : Figure
    """
    metrics, names = swept.sweep.metrics.names, swept.sweep.design.names
    points = swept.thinned(_POINTS)
    bars = _sobol(swept) or _morris(swept)
    weights = {name: max((_weight(bars, points, metric, name) for metric in metrics), default=0.0) for name in names}
    most = sorted(names, key=lambda name: -weights[name])[:_SHOWN]
    shown = [name for name in names if name in most]
    quantities = {name: one.quantity for name, one in swept.sweep.actuator.parameters().items() if name in shown}
    height = max(1.25, 0.3 * len(names) + 0.2) if bars else 1.25
    beside = int(bool(bars))
    with style():
        figure, grid = panel_grid(
            [height] * len(metrics),
            len(shown) + beside,
            margins=Margins(
                left=1.55 if bars else 0.7, right=0.6 if bars else 0.2, bottom=0.62, row_gap=0.4, column_gap=0.12
            ),
        )
        for number, (row, metric) in enumerate(zip(grid, metrics, strict=True)):
            last, quantity = number == len(grid) - 1, quantity_of(metric)
            row[0].set_title(_title(metric), fontsize=8.5)
            if bars:
                _draw_bars(row[0], names, bars[metric], last=last)
            for name, panel in zip(shown, row[beside:], strict=True):
                power, unit = _power(points[name], quantities[name])
                across = quantities[name].to_display(1.0) * points[name] / 10.0**power
                _draw_against(panel, across, quantity.to_display(1.0) * points[metric], log=_is_log(swept, name))
                panel.tick_params(labelbottom=last, labelleft=False)
                if last:
                    panel.set_xlabel(f"{name}\n{unit}" if unit else name, fontsize=7.0)
            if bars:  # whose names stand on the left
                row[0].set_xlim(*_limits(bars))
                row[-1].yaxis.set_ticks_position("right")
                row[-1].tick_params(labelright=True)
            else:
                row[0].tick_params(labelleft=True)
    return figure


_Bar = tuple[float, tuple[float, float]]
_Bars = dict[str, dict[str, dict[str, _Bar]]]


def _sobol(swept: Swept) -> _Bars:
    """By metric, parameter and kind of index: a value with its interval."""
    return {
        metric: {
            name: {"first index": (one.first, one.first_interval), "total index": (one.total, one.total_interval)}
            for name, one in of_metric.items()
        }
        for metric, of_metric in swept.indices().items()
    }


def _morris(swept: Swept) -> _Bars:
    """Effects as parts of the largest, so that one axis serves all metrics."""
    found: _Bars = {}
    for metric, of_metric in swept.effects().items():
        largest = max((one.magnitude for one in of_metric.values()), default=1.0) or 1.0
        found[metric] = {
            name: {
                "magnitude": (one.magnitude / largest, _scaled(one.magnitude_interval, largest)),
                "spread": (one.standard_deviation / largest, (np.nan, np.nan)),
            }
            for name, one in of_metric.items()
        }
    return found


def _scaled(ends: tuple[float, float], by: float) -> tuple[float, float]:
    return ends[0] / by, ends[1] / by


def _weight(bars: _Bars, points: dict[str, FloatArray], metric: str, name: str) -> float:
    """How much a parameter matters to a metric, for the choice of panels."""
    if bars:
        return float(np.nan_to_num(max(value for value, _ in bars[metric][name].values())))
    finite = np.isfinite(points[metric])
    if len(np.unique(points[metric][finite])) < 2 or len(np.unique(points[name][finite])) < 2:
        return 0.0
    ranks = [np.argsort(np.argsort(points[column][finite])) for column in (name, metric)]
    return abs(float(np.asarray(np.corrcoef(ranks))[0, 1]))


def _limits(bars: _Bars) -> tuple[float, float]:
    """Of the axis of bars, the same in every row: most indices lie between 0 and 1."""
    every = [end for row in bars.values() for one in row.values() for value, ends in one.values() for end in ends]
    known = np.array([0.0, 1.0, *every])
    low, high = float(np.nanmin(known)), float(np.nanmax(known))
    return low - 0.05 * (high - low), high + 0.05 * (high - low)


def _power(values: FloatArray, quantity: Quantity) -> tuple[int, str]:
    """A power of ten that tick labels would repeat, and the unit with it."""
    largest = float(np.max(np.abs(quantity.to_display(1.0) * values), initial=0.0))
    unit = spelled_unit(quantity.display_unit)
    if largest == 0.0 or 1e-3 <= largest < 1e5:
        return 0, unit
    power = math.floor(math.log10(largest))
    return power, f"{power_of_ten(10.0**power)} {unit}".strip()


def _draw_bars(panel: Any, names: tuple[str, ...], bars: dict[str, dict[str, _Bar]], *, last: bool) -> None:
    places = np.arange(len(names))
    for shift, kind, colour, mark in zip((-0.13, 0.13), bars[names[0]], ("blue", "vermillion"), "os", strict=True):
        for place, name in zip(places, names, strict=True):
            value, ends = bars[name][kind]
            panel.plot(ends, [place + shift] * 2, color=COLOURS[colour], linewidth=1.4)
            panel.plot([value], [place + shift], mark, color=COLOURS[colour], markersize=4.0, label=kind)
    handles = dict(zip(*reversed(panel.get_legend_handles_labels()), strict=True))
    panel.axvline(0.0, color=COLOURS["muted"], linewidth=0.8)
    name_rows(panel, names, fontsize=7.0)
    panel.tick_params(labelbottom=last)
    if last:
        panel.legend(
            handles.values(), handles, loc="upper right", bbox_to_anchor=(1.0, -0.18), fontsize=7.0, ncols=2,
            columnspacing=0.8, handletextpad=0.1, borderaxespad=0.0,
        )  # fmt: skip


def _draw_against(panel: Any, across: FloatArray, up: FloatArray, *, log: bool) -> None:
    finite = np.isfinite(up)
    across, up = across[finite], up[finite]
    panel.plot(across, up, ".", color=COLOURS["sky"], markersize=1.6, alpha=0.6, rasterized=True)
    if log:
        panel.set_xscale("log")
    if len(across) > 4 * _BINS:
        order = np.argsort(across, kind="stable")
        levels = np.unique(across)
        few = len(levels) <= _BINS  # a grid, or a table of few values
        slices = [np.flatnonzero(across == one) for one in levels] if few else np.array_split(order, _BINS)
        middles = [float(np.median(across[part])) for part in slices]
        panel.plot(middles, [float(np.mean(up[part])) for part in slices], color=COLOURS["blue"], linewidth=1.4)
    panel.xaxis.set_major_locator(LogLocator(numticks=4, subs=(1.0, 2.0, 5.0)) if log else MaxNLocator(3))
    panel.xaxis.set_major_formatter(lambda value, _: plain(value, trim=True))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.tick_params(axis="x", labelsize=6.5)
    panel.yaxis.set_major_locator(MaxNLocator(4))
    panel.yaxis.set_major_formatter(lambda value, _: plain(value, 5, trim=True))


def _is_log(swept: Swept, name: str) -> bool:
    ranges = getattr(swept.sweep.design, "ranges", {})
    return name in ranges and bool(ranges[name].log)


def _title(metric: str) -> str:
    output, _, reduction = metric.partition(".")
    unit = spelled_unit(quantity_of(metric).display_unit)
    words = f"{CHANNELS[output].name}, {_WORDS.get(reduction, reduction)}"
    return f"{words} [{unit}]" if unit else words
