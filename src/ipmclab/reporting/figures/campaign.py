"""The records of one experiment of a campaign: a column for each signal and condition, every repeat over the others."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from ipmclab.campaign.results import Repeated
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.figures.panels import curve, name_panel, series
from ipmclab.reporting.style import label_text, style
from ipmclab.units import CHANNELS

MOST_COLUMNS = 5
"""Wide enough to be read on a page."""


def records_figure(groups: Sequence[Repeated]) -> Figure:
    """Draw current and response of some kinds of runs side by side.

    Parameters
    ----------
    groups : sequence of Repeated
        Of one sample and one experiment, ``MOST_COLUMNS`` at most, each with a result.
    """
    shown = groups[0].results[0].record.channels
    channels = [name for name in dict.fromkeys(("current", groups[0].measured)) if name in shown]
    with style():
        figure, grid = panel_grid(
            [1.05] * len(channels), len(groups), Margins(bottom=0.72, column_gap=0.2), sharex="col", sharey="row"
        )
        for column, group in enumerate(groups):
            for row, channel in enumerate(channels):
                panel = grid[row, column]
                for place, one in enumerate(group.results):
                    look = {**series(place), "linewidth": 0.9, "alpha": 0.9}
                    curve(panel, channel, one.record.time, one.record.channels[channel], **look)
                panel.margins(x=0.01)
                if column == 0:
                    name_panel(panel, CHANNELS[channel].name, CHANNELS[channel])
            grid[-1, column].set_xlabel(f"time (s)\n{label_text(group.label)}\n{label_text(group.condition)}")
        return figure
