"""Figures of runs, fits and predictions."""

from __future__ import annotations

from ipmclab.reporting.figures.characteristic import characteristic as characteristic
from ipmclab.reporting.figures.estimation import before_and_after as before_and_after
from ipmclab.reporting.figures.overview import overview as overview
from ipmclab.reporting.figures.runs import plot as plot

__all__ = ["before_and_after", "characteristic", "overview", "plot"]
