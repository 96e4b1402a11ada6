"""What people look at: figures of runs, and one self-contained report of a fit."""

from __future__ import annotations

from ipmclab.reporting.document import report as report
from ipmclab.reporting.figures import before_and_after as before_and_after
from ipmclab.reporting.figures import characteristic as characteristic
from ipmclab.reporting.figures import overview as overview
from ipmclab.reporting.figures import plot as plot
from ipmclab.reporting.save import save_figure as save_figure

__all__ = ["before_and_after", "characteristic", "overview", "plot", "report", "save_figure"]
