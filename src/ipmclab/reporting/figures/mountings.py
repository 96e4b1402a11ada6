"""What each mounting says by itself: every parameter over the middle of all, with the interval of the next mounting."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ipmclab.confidence import NORMAL_95
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.figures.panels import name_rows
from ipmclab.reporting.style import COLOURS, style
from ipmclab.reporting.wording import plain

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ipmclab.fit.fit import Fit


def mountings_figure(fit: Fit, names: Sequence[str]) -> Figure:
    """Draw the values of each mounting, one row for each parameter.

    Parameters
    ----------
    fit : Fit
        With ``mountings``.
    names : sequence of str
        Parameters that are positive.

    Returns
    -------
    figure : Figure
        A dot for each mounting that determines the parameter, with its 95 % interval; shaded, that of the next one.
    """
    with style():
        figure, grid = panel_grid([0.34 * len(names) + 0.1], 1, margins=Margins(left=2.3, top=0.32))
        panel = grid[0, 0]
        panel.set_xscale("log")
        panel.axvline(1.0, color=COLOURS["muted"], linewidth=0.6)
        for row, name in enumerate(names):
            values, errors = fit_of_each(fit, name)
            middle = math.exp(float(np.mean(np.log(values))))
            following = next_interval(fit, name)
            if following is not None:
                low, high = (end / middle for end in following)
                panel.barh(row, high - low, left=low, height=0.55, color=COLOURS["sky"], alpha=0.35)
            places = row + np.linspace(-0.16, 0.16, len(values))
            for value, error, place in zip(values, errors, places, strict=True):
                reach = math.exp(NORMAL_95 * error / value)
                ends = [value / reach / middle, value * reach / middle]
                panel.plot(ends, [place, place], color=COLOURS["blue"], linewidth=1.2)
                panel.plot([value / middle], [place], "o", markersize=3.6, color=COLOURS["blue"])
        panel.use_sticky_edges = False  # a bar that ends at the frame looks cut off
        panel.autoscale_view()
        name_rows(panel, names)
        panel.xaxis.set_major_formatter(lambda value, _: plain(value, 2, trim=True))
        panel.xaxis.set_minor_formatter(lambda value, _: plain(value, 2, trim=True) if _few(panel.get_xlim()) else "")
        panel.set_xlabel("value, over the geometric mean of the mountings")
        panel.set_title(
            "a dot with its 95 % interval: one mounting by itself · shaded: the next mounting, 95 %",
            fontsize=7.5,
            fontweight="normal",
        )
    return figure


def _few(limits: tuple[float, float]) -> bool:
    """Whether an axis spans too little for powers of ten to label it."""
    return limits[1] / limits[0] < 12.0


def fit_of_each(fit: Fit, name: str) -> tuple[list[float], list[float]]:
    """Values and standard errors [SI] of the mountings that determine a parameter."""
    assert fit.mountings is not None
    own = [one for key, one in fit.parameters.items() if key.startswith(f"{name}[mounting ")]
    found = [(one.value, one.standard_error if one.determined else math.inf) for one in own]
    if not own:
        found = [(one.values[name], one.errors[name]) for one in fit.mountings.each if name in one.values]
    finite = [(value, error) for value, error in found if math.isfinite(error)]
    return [value for value, _ in finite], [error for _, error in finite]


def next_interval(fit: Fit, name: str) -> tuple[float, float] | None:
    """The interval of the next mounting [SI], which a parameter of each mounting shares with the others."""
    for key, one in fit.parameters.items():
        if key == name or key.startswith(f"{name}[mounting "):
            return one.interval_next_mounting
    return None
