"""How models compare: the difference of each to the best, with its error."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.figure import Figure

from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.figures.panels import name_rows
from ipmclab.reporting.style import COLOURS, label_text, style
from ipmclab.reporting.wording import plain

if TYPE_CHECKING:
    from ipmclab.choosing.choice import Choice

_WIDE: Final = 20.0  # times as far as the nearest model is the farthest, from which on the axis is logarithmic


def choice_figure(choice: Choice) -> Figure:
    """Draw the ranked differences of the log predictive likelihood, the best model on top.

    Parameters
    ----------
    choice : Choice

    Returns
    -------
    figure : Figure
        A bar of 95 % for each model; hollow where the records cannot distinguish it from the best one.
    """
    ranked = choice.ranked
    values, reaches, distinguished = [0.0], [0.0], [False]
    for one in ranked[1:]:
        difference = choice.differences[one.name, choice.best]
        values.append(difference.value)
        reaches.append(
            min(difference.limit, 1e3) * difference.standard_error if math.isfinite(difference.standard_error) else 0.0
        )
        distinguished.append(difference.is_distinguished)
    places = np.arange(len(ranked))
    with style():
        figure, grid = panel_grid([0.32 * len(ranked) + 0.15], 1, margins=Margins(left=2.3, top=0.32))
        panel = grid[0, 0]
        # Less than a nat is nothing to see.
        far_away = [max(abs(value) + reach, 1.0) for value, reach in zip(values, reaches, strict=True)][1:] or [1.0]
        wide = max(far_away) > _WIDE * min(far_away)
        if wide:
            panel.set_xscale("symlog", linthresh=1.5 * min(far_away), linscale=1.0)
        panel.axvline(0.0, color=COLOURS["muted"], linewidth=0.8)
        for place, value, reach, far, one in zip(places, values, reaches, distinguished, ranked, strict=True):
            colour = COLOURS["vermillion" if far else "blue"]
            if reach:
                panel.plot([value - reach, value + reach], [place, place], color=colour, linewidth=1.6)
            chosen = one.name == choice.preferred
            panel.plot(
                [value],
                [place],
                marker="D" if chosen else "o",
                markersize=6.0 if chosen else 5.0,
                markeredgecolor=colour,
                markerfacecolor=colour if far or chosen else COLOURS["paper"],
                linestyle="none",
            )
        name_rows(panel, [f"{label_text(one.name, longest=30)} ({one.parameters})" for one in ranked])
        panel.xaxis.set_major_formatter(lambda value, _: plain(value, trim=True))
        scale = ", logarithmic scale" if wide else ""
        panel.set_xlabel(f"log predictive likelihood, less that of the best (nat{scale})")
        panel.set_title(
            "diamond: preferred · blue: not distinguishable from the best · orange: worse · bars: 95 %",
            fontsize=7.5,
            fontweight="normal",
        )
    return figure
