"""A fit in the types that TOML has: the ``[fit]`` table of a fitted actuator's file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

from ipmclab.fit.fit import Fit
from ipmclab.named_matrix import matrix_of
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
        "correlations": matrix_of(fit.correlations, names).tolist(),
        "undetermined": in_toml(fit.undetermined),
        "covariance": {
            "names": list(fit.covariance),
            "rows": matrix_of(fit.covariance, fit.covariance).tolist(),
        },
        **({"mountings": in_toml(fit.mountings)} if fit.mountings else {}),
        **{name: in_toml(getattr(fit, name)) for name in ("left_out", "known", "diagnoses")},
        **{
            name: in_toml(one)
            for name in ("procedure", "practical", "profiles", "unmodelled")
            if (one := getattr(fit, name))
        },
        "runs": in_toml(fit.observations),
        "findings": _findings(fit.findings),
    }


def _findings(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    return [in_toml(replace(finding, channel=finding.channel or "")) for finding in findings]


class FitTable(Mapping[str, Any]):
    """The table of a fit, written when it is asked for; a copy or a pickle of it is a dictionary."""

    def __init__(self, fit: Fit) -> None:
        # Who keeps an actuator keeps no record with it, and no table of an earlier fit.
        self._fit = replace(fit, actuator=fit.actuator.with_fit_table(None), residuals=(), estimate=None)

    @cached_property
    def _table(self) -> dict[str, Any]:
        return fit_to_table(self._fit)

    def __getitem__(self, name: str) -> Any:
        return self._table[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._table)

    def __len__(self) -> int:
        return len(self._table)

    def __repr__(self) -> str:
        return repr(self._table)

    def __reduce__(self) -> tuple[type[dict[str, Any]], tuple[dict[str, Any]]]:
        return dict, (self._table,)


def changed(fit: Fit, **changes: Any) -> Fit:
    """A fit with some changes, which the table in its actuator follows."""
    other = replace(fit, **changes)
    return replace(other, actuator=other.actuator.with_fit_table(FitTable(other)))


def with_findings(fit: Fit, more: Sequence[Finding]) -> Fit:
    """A fit with further findings."""
    return changed(fit, findings=(*fit.findings, *more)) if more else fit
