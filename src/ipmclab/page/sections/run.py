"""Run: an experiment from its choice to its runs, with the bench live."""

from __future__ import annotations

from ipmclab.page.context import Context
from ipmclab.page.elements.time_plot import TimePlot


def build(context: Context) -> None:
    """Fill the page."""
    TimePlot("Bench", live=True)
