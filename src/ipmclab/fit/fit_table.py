"""A fit in the types that TOML has: the ``[fit]`` table of a fitted actuator's file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ipmclab.fit.fit import Fit
from ipmclab.run import Finding


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
        "parameters": [
            {
                "name": parameter.name,
                "value": parameter.value,
                "unit": parameter.unit,
                "symbol": parameter.symbol,
                "standard_error": parameter.standard_error,
                "interval": list(parameter.interval),
                "determined": parameter.determined,
                "at_bound": parameter.at_bound,
                **_pair("interval_next_mounting", parameter.interval_next_mounting),
                **_pair("prior", parameter.prior),
                **({"prior_of_literature": True} if parameter.prior_of_literature else {}),
            }
            for parameter in fit.parameters.values()
        ],
        "correlations": [[fit.correlations[a][b] for b in names] for a in names],
        "undetermined": [
            {
                "coefficients": dict(direction.coefficients),
                "sentence": direction.sentence,
                "error": direction.error,
                "cures": list(direction.cures),
            }
            for direction in fit.undetermined
        ],
        "covariance": {
            "names": list(fit.covariance),
            "rows": [[row[other] for other in fit.covariance] for row in fit.covariance.values()],
        },
        **({"mountings": fit.mountings.to_table()} if fit.mountings else {}),
        "left_out": [one.to_table() for one in fit.left_out],
        "known": [one.to_table() for one in fit.known],
        "diagnoses": [one.to_table() for one in fit.diagnoses],
        **({"procedure": dict(fit.procedure)} if fit.procedure else {}),
        **({"practical": fit.practical.to_table()} if fit.practical else {}),
        **({"profiles": {name: one.to_table() for name, one in fit.profiles.items()}} if fit.profiles else {}),
        "runs": [
            {
                "label": run.label,
                "content_sha256": run.content_sha256,
                "hold": run.hold,
                "delay": run.delay,
                "start": run.start,
                "initial_state": dict(run.initial_state),
                "offset": dict(run.offset),
                "drift": dict(run.drift),
                "noise": dict(run.noise),
                "samples": dict(run.samples),
                "span": dict(run.span),
                "series_resistance": run.series_resistance,
                "mounting": run.mounting,
                "noise_model": {output: noise.to_table() for output, noise in run.noise_model.items()},
                **({} if run.state is None else {"state": run.state.to_table()}),
            }
            for run in fit.observations
        ],
        "findings": _findings(fit.findings),
    }


def _findings(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    return [
        {
            "code": finding.code,
            "severity": finding.severity,
            "message": finding.message,
            "repair": finding.repair,
            "channel": finding.channel or "",
            "samples": [list(pair) for pair in finding.samples],
            "effect": finding.effect,
            "values": {key: value for key, value in finding.values.items() if value is not None},
        }
        for finding in findings
    ]


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


def _pair(name: str, values: tuple[float, float] | None) -> dict[str, list[float]]:
    """TOML has nothing for what is not known: the key is left out."""
    return {} if values is None else {name: list(values)}
