"""A fit, and the runs that it was made from, held against what else is known of the strip."""

from __future__ import annotations

from collections.abc import Sequence

from ipmclab.identify.consistency.cross_check import cross_check
from ipmclab.identify.fit import Fit
from ipmclab.identify.fit_table import changed
from ipmclab.run import Run


def with_cross_checks(fit: Fit, runs: Sequence[Run]) -> Fit:
    """A fit with a finding for each pair of facts about its strip that contradict each other.

    Parameters
    ----------
    fit : Fit
    runs : sequence of Run
        From which it was made.
    """
    found = cross_check(fit.actuator, runs, fit=fit)
    return changed(fit, findings=(*fit.findings, *found)) if found else fit
