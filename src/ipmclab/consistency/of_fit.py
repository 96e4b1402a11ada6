"""A fit, and the runs that it was made from, compared with what else is known of the strip."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from ipmclab.consistency.capacitance import CODE as CAPACITANCE
from ipmclab.consistency.cross_check import cross_check
from ipmclab.consistency.dimensions import thickness_unusual
from ipmclab.consistency.noisy_voltage import noisy_voltage
from ipmclab.fit.fit import Fit
from ipmclab.fit.fit_table import changed, with_findings
from ipmclab.model import Actuator
from ipmclab.quality import check
from ipmclab.quality.record import Record
from ipmclab.quality.scale import CODE as UNIT_OFF
from ipmclab.quality.scale import wrong_scales
from ipmclab.quality.usable import noise_only
from ipmclab.run import Finding, Run


def with_cross_checks(fit: Fit, runs: Sequence[Run]) -> Fit:
    """A fit with a finding for each pair of facts about its strip that contradict each other.

    Where the unit of a reading is off, that comes first, and nothing that a fit of such readings says is shown with it
    but what was left out of them.

    Parameters
    ----------
    fit : Fit
    runs : sequence of Run
        From which it was made.
    """
    read = {output for observation in fit.observations for output in observation.samples}
    off = [
        replace(finding, message=f"{observation.label}: {finding.message}")
        for observation, run in zip(fit.observations, runs, strict=True)
        for finding in units_off(fit.actuator, run, read)
    ]
    if off:
        kept = [one for one in fit.findings if one.effect != "none" and one.code != UNIT_OFF]
        ended = f"{fit.message.partition(', but ')[0]}, but errors contradict this fit (see the findings {UNIT_OFF})"
        # A wrong dimension may be why a reading seems to be off.
        kept = [*thickness_unusual(fit.actuator), *kept]
        return changed(fit, findings=(*off, *kept), diagnoses=(), known=(), message=ended)
    conflicts = [_said_of_the_file(one, fit, runs) for one in cross_check(fit.actuator, runs, fit=fit)]
    return with_findings(fit, [*conflicts, *noisy_voltage(fit, runs)])


def units_off(actuator: Actuator, run: Run, outputs: Collection[str]) -> list[Finding]:
    """The ``unit-off`` of the clock, the voltage and some outputs of a run, by the dimensions of the strip.

    Parameters
    ----------
    actuator : Actuator
    run : Run
    outputs : collection of str
    """
    off = wrong_scales(Record.of(run), noise_only(check(run)), actuator)
    return [one for one in off if one.channel in (None, "voltage", *outputs)]


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
