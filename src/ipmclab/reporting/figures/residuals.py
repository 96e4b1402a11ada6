"""What a residual still remembers: its autocorrelation, with the band of a white one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ipmclab.prediction.scores import Score
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.style import COLOURS, label_text, style
from ipmclab.units import CHANNELS


def autocorrelation_figure(scores: Sequence[tuple[str, Score]]) -> Figure:
    """Draw the residual autocorrelation of each output of each run.

    Parameters
    ----------
    scores : sequence of (title, Score)
        Scores of single runs, with at least one lag.

    Returns
    -------
    figure : Figure
    """
    columns = min(len(scores), 3)
    rows = -(-len(scores) // columns)
    largest = max(float(np.max(np.abs(one.autocorrelation))) for _, one in scores)
    limit = max(0.2, 1.1 * largest)
    with style():
        figure, grid = panel_grid(
            [0.85] * rows, columns, margins=Margins(top=0.42, row_gap=0.52, column_gap=0.2), sharex="all", sharey="all"
        )
        for panel, (title, one) in zip(grid.flat, scores, strict=False):
            lags = np.arange(1, len(one.autocorrelation) + 1)
            panel.fill_between(
                lags,
                -one.autocorrelation_band,
                one.autocorrelation_band,
                color=COLOURS["mask"],
                alpha=0.28,
                linewidth=0,
            )
            panel.vlines(lags, 0.0, one.autocorrelation, color=COLOURS["blue"], linewidth=1.6)
            panel.axhline(0.0, color=COLOURS["muted"], linewidth=0.5)
            panel.set_title(f"{label_text(title, longest=34)}\n{CHANNELS[one.output].name}", fontsize=8.0)
            panel.set_ylim(-limit, limit)
            panel.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]))
            panel.xaxis.set_major_locator(MaxNLocator(nbins=4, integer=True))
        for panel in grid.flat[len(scores) :]:
            panel.set_visible(False)
        for panel in grid[-1]:
            panel.set_xlabel("lag (rows)")
    return figure
