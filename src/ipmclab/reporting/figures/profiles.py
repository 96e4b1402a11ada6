"""The profile of the likelihood of each parameter, side by side."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.style import COLOURS, LINES, label_text, style
from ipmclab.reporting.wording import spelled_unit

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit
    from ipmclab.fit.profile import Profile

FloatArray = npt.NDArray[np.float64]

_HIGHEST: Final = 1.8  # times the threshold: the top of a panel
_WIDE: Final = 20.0  # ratio of the ends of an axis from which it is logarithmic
_COLUMNS: Final = 3
_MARGIN: Final = 0.04  # of the width


def profiles_figure(fit: Fit) -> Figure:
    """Draw by how much chi-square grows as each parameter is held at other values.

    Parameters
    ----------
    fit : Fit
        With at least one profile.

    Returns
    -------
    figure : Figure
    """
    known = fit.actuator.parameters()
    count = len(fit.profiles)
    rows = -(-count // _COLUMNS)
    with style():
        figure, grid = panel_grid(
            [1.05] * rows,
            _COLUMNS,
            margins=Margins(left=0.5, top=0.62, bottom=0.5, row_gap=0.78, column_gap=0.3),
            sharey="all",
        )
        for panel, (name, one) in zip(grid.flat, fit.profiles.items(), strict=False):
            base = known.get(name.partition("[")[0])
            factor = base.quantity.to_display(1.0) if base is not None else 1.0
            unit = base.quantity.display_unit if base is not None else fit.parameters[name].unit
            _draw(panel, one, fit.parameters[name].value, factor, log=base is not None and base.transform == "log")
            panel.set_title(label_text(name, longest=34), fontsize=7.5)
            panel.set_xlabel(spelled_unit(unit) or "no unit", labelpad=1.5)
        highest = _HIGHEST * max(one.threshold for one in fit.profiles.values())
        grid[0, 0].set_ylim(0.0, highest)
        for panel in grid[:, 0]:
            panel.set_ylabel("excess of χ²")
        for panel in grid.flat[count:]:
            panel.set_visible(False)
        _legend(figure)
    return figure


def _draw(panel: Any, one: Profile, middle: float, factor: float, *, log: bool) -> None:
    values = factor * np.array(one.values)
    excess = np.array(one.excess)
    low, high = _ends(values, excess, one.threshold)
    wide = log and low > 0.0 and high / low > _WIDE
    if wide:
        panel.set_xscale("log")
    curve_x, curve_y = _curve(values, excess, log=log)
    panel.plot(curve_x, curve_y, color=COLOURS["blue"])
    panel.plot(values, excess, "o", color=COLOURS["blue"], markersize=2.2)
    if math.isfinite(one.parabola) and one.parabola > 0.0:
        panel.plot(curve_x, _parabola(curve_x, factor * middle, factor * one.parabola, log=log), **_PARABOLA)
    panel.axhline(one.threshold, color=COLOURS["vermillion"], linewidth=0.8, linestyle=LINES[1])
    for end in (factor * number for number in one.interval):
        if math.isfinite(end) and low < end < high:
            panel.axvline(end, color=COLOURS["vermillion"], linewidth=0.6)
    panel.set_xlim(low, high)
    if wide:
        panel.xaxis.set_major_locator(LogLocator(numticks=4))
        panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        panel.xaxis.set_minor_formatter(NullFormatter())
    else:
        panel.xaxis.set_major_locator(MaxNLocator(nbins=3))
        panel.xaxis.set_major_formatter(StrMethodFormatter("{x:.6g}"))


_PARABOLA: Final[dict[str, Any]] = {"color": COLOURS["muted"], "linewidth": 0.9, "linestyle": LINES[2]}


def _ends(values: FloatArray, excess: FloatArray, threshold: float) -> tuple[float, float]:
    """Of the axis: to the last point that is visible, and what is next to it."""
    visible = np.flatnonzero(excess <= _HIGHEST * threshold)
    first, last = max(int(visible[0]) - 1, 0), min(int(visible[-1]) + 1, len(values) - 1)
    low, high = float(values[first]), float(values[last])
    if low > 0.0 and high / low > _WIDE:
        edge = (high / low) ** _MARGIN
        return low / edge, high * edge
    margin = _MARGIN * (high - low)
    return low - margin, high + margin


def _curve(values: FloatArray, excess: FloatArray, *, log: bool) -> tuple[FloatArray, FloatArray]:
    """Through the points: the root of the excess with its sign is nearly a straight line, and never turns back."""
    from scipy.interpolate import PchipInterpolator

    if len(values) < 2:
        return values, excess
    place = np.log(values) if log and values[0] > 0.0 else values
    root = np.sqrt(excess) * np.where(np.arange(len(values)) < int(excess.argmin()), -1.0, 1.0)
    fine = np.unique(np.concatenate([np.linspace(a, b, 24) for a, b in pairwise(place)]))
    height = PchipInterpolator(place, root)(fine)
    return (np.exp(fine) if log and values[0] > 0.0 else fine), np.asarray(height * height)


def _parabola(values: FloatArray, middle: float, error: float, *, log: bool) -> FloatArray:
    if log and middle > 0.0 and values.min() > 0.0:
        return np.asarray((np.log(values / middle) * middle / error) ** 2)
    return np.asarray(((values - middle) / error) ** 2)


def _legend(figure: Figure) -> None:
    figure.legend(
        handles=[
            Line2D([], [], color=COLOURS["blue"], marker="o", markersize=2.2, label="profile"),
            Line2D([], [], label="what the curvature promises", **_PARABOLA),
            Line2D([], [], color=COLOURS["vermillion"], linewidth=0.8, linestyle=LINES[1], label="95 %"),
        ],
        loc="upper right",
        ncols=3,
        borderaxespad=0.2,
    )
