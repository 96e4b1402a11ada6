"""Figures of runs, fits and predictions."""

from __future__ import annotations

from ipmclab.reporting.figures.overview import overview as overview
from ipmclab.reporting.figures.runs import plot as plot

__all__ = ["overview", "plot"]
