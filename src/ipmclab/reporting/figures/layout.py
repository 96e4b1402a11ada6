"""Where panels stand in a figure, in inches: the same margins everywhere, and no search for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from matplotlib.figure import Figure

from ipmclab.reporting.style import PAGE_WIDTH

Axis = Literal["all", "col", "row", "none"]


@dataclass(frozen=True)
class Margins:
    """The space around panels and between them, for tick labels, titles, axis labels and legend.

    Parameters
    ----------
    left, right, top, bottom : float [inch]
        Around all panels.
    row_gap, column_gap : float [inch]
        Between two of them.
    """

    left: float = 0.6
    right: float = 0.15
    top: float = 0.27
    bottom: float = 0.42
    row_gap: float = 0.27
    column_gap: float = 0.12


def panel_grid(
    heights: Sequence[float],
    columns: int = 1,
    margins: Margins | None = None,
    *,
    sharex: Axis = "none",
    sharey: Axis = "none",
) -> tuple[Figure, Any]:
    """A page-wide figure of rows of panels.

    A search for the best margins costs more than the drawing, and would give every figure
    another left edge.

    Parameters
    ----------
    heights : sequence of float [inch]
        Of each row of panels.
    columns : int
    margins : Margins, optional
        The usual ones where it is left out.
    sharex, sharey : "all", "col", "row" or "none"

    Returns
    -------
    figure : Figure
    panels : array of Axes, shape (n_rows, columns)
    """
    margins = margins or Margins()
    height = margins.top + sum(heights) + margins.row_gap * (len(heights) - 1) + margins.bottom
    width = PAGE_WIDTH - margins.left - margins.right
    each = (width - margins.column_gap * (columns - 1)) / columns
    figure = Figure(figsize=(PAGE_WIDTH, height))
    grid = figure.add_gridspec(
        len(heights),
        columns,
        left=margins.left / PAGE_WIDTH,
        right=1.0 - margins.right / PAGE_WIDTH,
        top=1.0 - margins.top / height,
        bottom=margins.bottom / height,
        wspace=margins.column_gap / each,
        hspace=margins.row_gap / (sum(heights) / len(heights)),
        height_ratios=list(heights),
    )
    return figure, grid.subplots(sharex=sharex, sharey=sharey, squeeze=False)
