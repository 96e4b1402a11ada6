"""A fit, and the runs that it was made from, held against what else is known of the strip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ipmclab.identify.consistency.capacitance import CODE as CAPACITANCE
from ipmclab.identify.consistency.cross_check import cross_check
from ipmclab.identify.consistency.noisy_voltage import noisy_voltage
from ipmclab.identify.fit import Fit
from ipmclab.identify.fit_table import with_findings
from ipmclab.run import Finding, Run


def with_cross_checks(fit: Fit, runs: Sequence[Run]) -> Fit:
    """A fit with a finding for each pair of facts about its strip that contradict each other.

    Parameters
    ----------
    fit : Fit
    runs : sequence of Run
        From which it was made.
    """
    conflicts = [_said_of_the_file(one, fit, runs) for one in cross_check(fit.actuator, runs, fit=fit)]
    return with_findings(fit, [*conflicts, *noisy_voltage(fit, runs)])


def _said_of_the_file(finding: Finding, fit: Fit, runs: Sequence[Run]) -> Finding:
    """A capacitance that no measured run gave is the file's own, and no mistake of who fits it."""
    if finding.code != CAPACITANCE:
        return finding
    simulated = all(run.metadata.origin != "measured" for run in runs)
    fitted = any(name.endswith(".permittivity") for name in fit.parameters)
    if fitted and not simulated:
        return finding
    why = "these runs were simulated, so it is that of the actuator behind them" if simulated else "no run changed it"
    return replace(
        finding, severity="info", message=f"{fit.actuator.name} itself has this value ({why}): {finding.message}"
    )
