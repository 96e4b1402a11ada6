"""Figures of runs, fits and predictions."""

from __future__ import annotations

from ipmclab.report.figures.overview import overview as overview
from ipmclab.report.figures.runs import plot as plot

__all__ = ["overview", "plot"]
