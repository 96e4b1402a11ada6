"""Runs of a campaign side by side: the records of one experiment with every repeat, and runs that a model predicts."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from ipmclab.campaign.results import Repeated
from ipmclab.prediction.run_validation import RunValidation
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.figures.panels import MEASURED, band, curve, model_series, name_panel, series
from ipmclab.reporting.style import label_text, style
from ipmclab.reporting.wording import percent
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


def predicted_figure(runs: Sequence[RunValidation], outputs: Sequence[str]) -> Figure:
    """Draw what was measured of some runs and what a model says from the voltage alone: a column for each run.

    Parameters
    ----------
    runs : sequence of RunValidation
        ``MOST_COLUMNS`` at most.
    outputs : sequence of str
        A row of panels for each.
    """
    with style():
        margins = Margins(top=0.52, bottom=0.58, column_gap=0.2, row_gap=0.36)
        figure, grid = panel_grid([1.05] * len(outputs), len(runs), margins, sharex="col", sharey="row")
        for column, one in enumerate(runs):
            for row, output in enumerate(outputs):
                panel = grid[row, column]
                panel.margins(x=0.01)
                pair = one.comparisons.get(output)
                if pair is None:
                    continue
                curve(panel, output, pair.time, pair.measured, label="measured", **MEASURED)
                if pair.reach is not None:
                    band(panel, output, pair.time, pair.predicted, pair.reach, label="95 % band")
                curve(panel, output, pair.time, pair.predicted, label="predicted", **model_series(0))
                panel.set_title(percent(one.scores[output].fit_percent), loc="right")
                if column == 0:
                    name_panel(panel, CHANNELS[output].name, CHANNELS[output])
            grid[-1, column].set_xlabel(f"time (s)\n{label_text(one.label)}")
        figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="upper right", ncols=3, borderaxespad=0.2)
        return figure
