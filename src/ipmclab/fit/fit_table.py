"""A fit in the types that TOML has: the ``[fit]`` table of a fitted actuator's file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ipmclab.fit.fit import Fit
from ipmclab.run import Finding
from ipmclab.tabled import in_toml


def fit_to_table(fit: Fit) -> dict[str, Any]:
    """Everything of a fit but its actuator and its residuals, in the types that TOML has."""
    names = list(fit.parameters)
    return {
        "software_version": fit.software_version,
        "converged": fit.converged,
        "message": fit.message,
        "evaluations": fit.evaluations,
        "rank": fit.rank,
        "singular_values": list(fit.singular_values),
        # Who edits them afterwards has another actuator than the one whose errors these are.
        "values": dict(fit.actuator.parameter_values),
        "parameters": in_toml(list(fit.parameters.values())),
        "correlations": [[fit.correlations[a][b] for b in names] for a in names],
        "undetermined": in_toml(fit.undetermined),
        "covariance": {
            "names": list(fit.covariance),
            "rows": [[row[other] for other in fit.covariance] for row in fit.covariance.values()],
        },
        **({"mountings": in_toml(fit.mountings)} if fit.mountings else {}),
        **{name: in_toml(getattr(fit, name)) for name in ("left_out", "known", "diagnoses")},
        **{name: in_toml(one) for name in ("procedure", "practical", "profiles") if (one := getattr(fit, name))},
        "runs": in_toml(fit.observations),
        "findings": _findings(fit.findings),
    }


def _findings(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    return [in_toml(replace(finding, channel=finding.channel or "")) for finding in findings]


def changed(fit: Fit, **changes: Any) -> Fit:
    """A fit with some changes, which the table in its actuator follows."""
    other = replace(fit, **changes)
    return replace(other, actuator=replace(other.actuator, fit_table=fit_to_table(other)))


def with_findings(fit: Fit, more: Sequence[Finding]) -> Fit:
    """A fit with further findings: nothing else in its table is written again."""
    if not more:
        return fit
    findings = (*fit.findings, *more)
    table = {**(fit.actuator.fit_table or {}), "findings": _findings(findings)}
    return replace(fit, findings=findings, actuator=replace(fit.actuator, fit_table=table))
