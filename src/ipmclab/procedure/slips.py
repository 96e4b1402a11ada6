"""What a slip of the pen leaves in a step: a number that no strip can have, a reading far from the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from ipmclab.measurement.uncertain import Uncertain
from ipmclab.measurement.written import REPAIR, Written, scatter_of
from ipmclab.model.parameters import Parameter
from ipmclab.procedure.density import LEAST, MOST
from ipmclab.procedure.density import NAME as DENSITY
from ipmclab.procedure.step import Step
from ipmclab.run import Finding

IMPOSSIBLE: Final = "impossible-value"

_SHARE: Final = 0.25
"""Of a variance, from which on a reading that lies far from the others is reported: below it does not matter."""


def slip_in(amount: Uncertain) -> tuple[Written, str, float] | None:
    """The readings with one that lies far from the others whose scatter matters to a number, the source and its share,
    or None."""
    for source, share in amount.shares.items():
        for name, written in amount.written.items():
            if source == scatter_of(name) and share >= _SHARE and written.outlier is not None:
                return written, source, share
    return None


def looked_over(step: Step, declared: Mapping[str, Parameter]) -> Step:
    """A step with what is wrong with its numbers; one that cannot be is shown and goes no further.

    Parameters
    ----------
    step : Step
    declared : mapping of dotted name to Parameter
        They know what can be at all.
    """
    findings = list(step.findings)
    reported = set[str]()
    for result in (*step.results.values(), *step.also.values()):
        found = slip_in(result.amount)
        if found is None or (slip := found[0].slip()) is None or slip[0] in reported:
            continue
        reported.add(slip[0])
        findings.append(
            Finding(
                "reading-apart",
                "warning",
                f"{slip[0]}: {slip[1]}: {100.0 * found[2]:.0f} % of the variance is the {found[1]}",
                REPAIR,
            )
        )
    impossible = [
        _impossible(name, result.amount, declared[name])
        for name, result in step.results.items()
        if name in declared and not _can_be(name, result.amount.value, declared[name])
    ]
    if not impossible:
        return replace(step, findings=tuple(findings))
    return replace(
        step,
        results={},
        also={**step.also, **step.results},
        findings=(*impossible, *findings),
        advice=impossible[0].repair,
        done=False,
    )


def _range(name: str, parameter: Parameter) -> tuple[float, float]:
    return (LEAST, MOST) if name == DENSITY else (parameter.lower, parameter.upper)


def _can_be(name: str, value: float, parameter: Parameter) -> bool:
    low, high = _range(name, parameter)
    return low <= value <= high


def _impossible(name: str, amount: Uncertain, parameter: Parameter) -> Finding:
    low, high = _range(name, parameter)
    unit = f" {parameter.unit}" if parameter.unit else ""
    slip = next((slip[1] for written in amount.written.values() if (slip := written.slip())), "")
    made_of = ", ".join(f"{source} {written.said}" for source, written in amount.written.items())
    return Finding(
        IMPOSSIBLE,
        "error",
        f"{name} of {amount.value:.4g}{unit} cannot be: an IPMC has {low:g} to {high:g}{unit}"
        + (f"; it comes from {made_of}" if made_of else "")
        + (f"; {slip}" if slip else ""),
        REPAIR if slip else "write what is wrong there again; is every unit right?",
        values={"value": amount.value, "least": low, "most": high},
    )
