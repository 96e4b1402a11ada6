"""What a fit left of each output: how it is correlated in time, and with the voltage."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from ipmclab.fit.output_diagnosis import WORDS, OutputDiagnosis
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.style import COLOURS, label_text, style
from ipmclab.units import CHANNELS


def diagnoses_figure(diagnoses: Sequence[OutputDiagnosis]) -> Figure:
    """Draw the correlations of what is left of some outputs of some runs, over the lag.

    Parameters
    ----------
    diagnoses : sequence of OutputDiagnosis
        Each with at least one lag.

    Returns
    -------
    figure : Figure
    """
    with style():
        figure, grid = panel_grid(
            [0.85] * len(diagnoses), 2, margins=Margins(top=0.62, bottom=0.42, row_gap=0.5, column_gap=0.5)
        )
        for (left, right), one in zip(grid, diagnoses, strict=True):
            left.plot(one.lags, one.autocorrelation, color=COLOURS["measured"], linewidth=1.4)
            _draw(left, one, one.whitened, "blue")
            _draw(right, one, one.with_voltage, "vermillion")
            for panel, correlations in ((left, (*one.autocorrelation, *one.whitened)), (right, one.with_voltage)):
                limit = 1.12 * max(2.0 * one.band, *map(abs, correlations))
                panel.set_ylim(-limit, limit)
                panel.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]))
            where = f"{label_text(one.label, longest=26)}, {CHANNELS[one.output].name}"
            left.set_title(f"{where}: {WORDS[one.verdict]}", fontsize=7.5)
        for panel, name in zip(grid[-1], ("with itself", "with the voltage"), strict=True):
            panel.set_xlabel(f"lag (s), correlation {name}")
        _legend(figure)
    return figure


def _draw(panel: Any, one: OutputDiagnosis, values: Sequence[float], colour: str) -> None:
    panel.axhspan(-one.band, one.band, color=COLOURS["mask"], alpha=0.28, linewidth=0)
    panel.axhline(0.0, color=COLOURS["muted"], linewidth=0.5)
    panel.vlines(one.lags, 0.0, values, color=COLOURS[colour], linewidth=1.6)
    panel.set_xscale("log")
    panel.xaxis.set_major_locator(LogLocator(numticks=6))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.xaxis.set_minor_formatter(NullFormatter())


def _legend(figure: Figure) -> None:
    handles = [
        Line2D([], [], color=COLOURS["measured"], linewidth=1.4, label="residuals"),
        Line2D([], [], color=COLOURS["blue"], linewidth=1.6, label="what is new in each, under the noise found"),
        Line2D([], [], color=COLOURS["vermillion"], linewidth=1.6, label="that, with the voltage so much earlier"),
    ]
    figure.legend(handles=handles, loc="upper left", ncols=3, bbox_to_anchor=(0.07, 1.0))
