"""Step 3: the branches from a step and a sine (Friend, section 4.5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from ipmclab.consistency.cross_check import CHECKS
from ipmclab.fit.fit import Fit
from ipmclab.fit.interrupted import uninterrupted
from ipmclab.identification.identify import identify
from ipmclab.measurement.uncertain import Uncertain
from ipmclab.procedure import dc
from ipmclab.procedure.step import Result, Step, advice_for, assumed_finding
from ipmclab.procedure.strip import actuator_of, amounts_of_fit, branch_names
from ipmclab.run import Finding, Run
from ipmclab.units import PERMITTIVITY, RESISTIVITY

TITLE: Final = "branches from the current"

_LEFT_OUT: Final = frozenset({"exact-fixed-value", "undetermined", *CHECKS})
"""What a fit says of values that it was given as exact, whose uncertainty is counted afterwards here, and of facts
compared with each other, of which a step does not know all yet: the joint fit does."""


def fit_findings(fit: Fit, wanted: Sequence[str]) -> tuple[Finding, ...]:
    """What of a fit's findings belongs to a step, and what it did not determine."""
    missing = [name for name in wanted if name not in fit.parameters or not fit.parameters[name].determined]
    doubts = tuple(one for one in fit.findings if one.code not in _LEFT_OUT and one.severity != "info")
    return doubts + tuple(
        Finding("not-determined", "warning", f"{name} is not determined by these runs", "add a run, or a longer one")
        for name in missing
    )


def branches(name: str, runs: Sequence[tuple[str, Run]], known: Mapping[str, Uncertain], count: int) -> Step:
    """Resistivity and permittivity of every branch, with the sheet and the dc resistance held at what was measured.

    Parameters
    ----------
    name : str
        Of the strip.
    runs : sequence of (label, Run)
    known : mapping of dotted name to Uncertain
        Dimensions, sheet and contact resistance; the dc resistivity is found here where it is left out.
    count : int
        Of branches.
    """
    names = branch_names(count)
    has_dc = dc.NAME in known
    wanted = names if has_dc else (dc.NAME, *names)
    how = f"least squares on the current of {', '.join(label for label, _ in runs)}"
    how += (
        " with R_e and R_dc as measured (Friend, eqs 4.3 to 4.6)" if has_dc else " with R_e as measured, R_dc free too"
    )
    actuator = actuator_of(name, known, count)
    fit = uninterrupted(identify(actuator, [run for _, run in runs], free=wanted, labels=[label for label, _ in runs]))
    held = {key: amount for key, amount in known.items() if key not in wanted and not key.startswith("beam.")}
    amounts = amounts_of_fit(fit, held, "noise of the current").determined
    parameters = actuator.parameters()
    results = {
        key: Result(amounts[key], PERMITTIVITY if key.endswith("permittivity") else RESISTIVITY, parameters[key].symbol)
        for key in wanted
        if key in amounts
    }
    worst = max(results.values(), key=lambda one: one.amount.uncertainty / one.amount.value, default=None)
    return Step(
        "branches",
        TITLE,
        how,
        results,
        findings=(*fit_findings(fit, wanted), *assumed_finding([one.amount for one in results.values()])),
        advice=advice_for(worst.amount) if worst is not None else "",
        done=len(results) == len(wanted),
    )
