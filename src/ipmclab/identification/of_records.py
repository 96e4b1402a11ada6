"""What a fit says of its records: what changed the readings that it used, and what to think of its numbers."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import replace
from typing import Final, Literal

from ipmclab.identification.problem.record import PreparedRun
from ipmclab.run import Finding

GrowingLeak = Literal["none", "hidden", "shown"]

NOISE: Final = "nothing but noise"
_RISES: Final = "current-rises"

_ALWAYS_REPORTED: Final = frozenset({"sampling-period-unknown", _RISES})
"""Findings of a record that are no errors, but on which numbers of the fit hang."""


def findings_of_records(
    records: Sequence[PreparedRun], found: Sequence[Sequence[Finding]], growing_leak: GrowingLeak
) -> tuple[Finding, ...]:
    """Findings of the records that change what enters the fit, or what to think of it, with the run they belong to.

    Parameters
    ----------
    records : sequence of PreparedRun
    found : sequence of sequence of Finding
        What ``check`` says of each.
    growing_leak : "none", "hidden" or "shown"
        Whether the model has a leak that grows, which could explain a current that rises, and the readings show it.
    """
    explained = {_RISES} if growing_leak == "shown" else set()
    return tuple(
        _in_fit(finding, record.label, growing_leak)
        for record, findings in zip(records, found, strict=True)
        for finding in findings
        if finding.code not in explained
        and (
            finding.severity == "error"
            or finding.values.get("moving")  # a gap in which the model is driven by a guess
            or (finding.channel == "voltage" and finding.samples)  # it drives the model
            or (
                (finding.effect != "none" or finding.code in _ALWAYS_REPORTED)
                and (finding.channel is None or finding.channel in record.readings)
            )
        )
    )


def _in_fit(finding: Finding, label: str, growing_leak: GrowingLeak) -> Finding:
    """A finding of a record as a fit says it: where the contact was missing, the fit has the voltage at 0."""
    if finding.code == _RISES and growing_leak == "hidden":
        return replace(
            finding,
            message=f"{label}: {finding.message}; the growing leak of this model is hidden by the other residuals of "
            "the fit",
            repair="record longer at this voltage, or identify from the part before the rise",
            values={**finding.values, "hidden": 1.0},
        )
    late = finding.code == "contact-missing"
    return replace(
        finding,
        severity="warning" if late else finding.severity,
        message=f"{label}: {finding.message}{'; the fit takes the voltage as 0 V there' if late else ''}",
    )


def left_out_of(record: PreparedRun, which: Set[str], why: str) -> Finding:
    """``channel-left-out``: channels that the free parameters ask for and that hold nothing to be fitted.

    Parameters
    ----------
    record : PreparedRun
    which : set of str
    why : str
        What they held: ``NOISE``, or no usable reading.
    """
    listed, verb = " and ".join(sorted(which)), "was" if len(which) == 1 else "were"
    return Finding(
        "channel-left-out",
        "info" if why == NOISE else "warning",  # check warns of noise, and nothing is lost by leaving it out
        f"{record.label}: {listed} held {why} and {verb} left out of the fit",
        "check that the instrument was connected and in range",
        channel=min(which) if len(which) == 1 else None,
    )
