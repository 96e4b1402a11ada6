"""Runs whose voltages agree up to a time must agree in their responses up to that time."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import replace

from ipmclab.consistency.fact import Fact, in_one_air
from ipmclab.measurement.amount import SURE, Amount, conflict, how_sure, sigmas_between
from ipmclab.quality import check_together
from ipmclab.run import Finding, Run
from ipmclab.units import CURRENT

CODE = "prefix-disagrees"

_EXPERIMENT = (
    "repeat the first of the two runs after the second, in the same mounting: if it repeats itself the strip has "
    "changed for good, if not it depends on what went before"
)


def compared_runs(runs: Sequence[Run]) -> tuple[Finding, ...]:
    """What ``check_together`` says of the runs, agreement too."""
    return check_together(runs) if len(runs) > 1 else ()


def in_one_environment(finding: Finding, runs: Sequence[Run]) -> bool:
    """Whether the two runs of a finding state no different environments: elsewhere a strip answers otherwise."""
    return in_one_air(*(runs[int(finding.values[key] or 0)].metadata for key in ("first", "second")))


def prefix_of_runs(together: Sequence[Finding], runs: Sequence[Run], outputs: Set[str]) -> list[Finding]:
    """``prefix-disagrees`` of runs, reading by reading: ``state-changed`` of ``check``, with its experiment.

    Runs of different mountings are expected to differ: all that do are reported in one line of each output. Of a fit
    only what it used counts: ``outputs``; everything where that is empty.
    """
    changed = [
        finding
        for finding in together
        if finding.code == "state-changed" and (not outputs or finding.channel in outputs)
    ]
    between_two = [finding for finding in changed if len(set(_mountings(finding, runs))) == 2]
    return [
        *(
            replace(finding, code=CODE, repair=f"{finding.repair}; cheapest experiment that decides: {_EXPERIMENT}")
            for finding in changed
            if finding not in between_two
        ),
        *(
            _between_mountings([finding for finding in between_two if finding.channel == channel], runs)
            for channel in dict.fromkeys(finding.channel for finding in between_two)
        ),
    ]


def _mountings(finding: Finding, runs: Sequence[Run]) -> list[str]:
    """The mountings of the two runs of a finding that say of which they are."""
    about = [runs[int(finding.values[key] or 0)].metadata for key in ("first", "second")]
    return [one.mounting_id for one in about if one.mounting_id]


def _between_mountings(between_two: Sequence[Finding], runs: Sequence[Run]) -> Finding:
    names = sorted({name for finding in between_two for name in _mountings(finding, runs)})
    ratios = [float(finding.values["ratio"] or 0.0) for finding in between_two]
    return replace(
        between_two[0],
        code=CODE,
        severity="info",
        message=f"{between_two[0].channel}: under the same voltage runs of the mountings {', '.join(names)} differ, as "
        f"mountings do ({min(ratios):.3g} to {max(ratios):.3g} times)",
        repair="",
        values={
            "pairs": len(between_two),
            "least": min(ratios),
            "most": max(ratios),
            "until": between_two[0].values["until"],
        },
    )


def prefix_of_facts(facts: Sequence[Fact]) -> list[Finding]:
    """``prefix-disagrees`` of published numbers: a square begins as a step, so its peak current is no smaller."""
    found = []
    peaks = [fact for fact in facts if fact.metric == "peak_current" and fact.place is None]
    for step in peaks:
        for square in peaks:
            alike = step.measured_with == square.measured_with and step.conditions == square.conditions
            same = step.amplitude is not None and step.amplitude == square.amplitude
            if step.waveform != "step" or square.waveform != "square" or not (alike and same) or square.at_least:
                continue
            first = Amount.of(step.value, step.uncertainty, CURRENT)
            second = Amount.of(square.value, square.uncertainty, CURRENT)
            sigmas = sigmas_between(first, second) if first.value > second.value else 0.0
            if sigmas > SURE:
                bound = "at least " if step.at_least else ""
                found.append(
                    conflict(
                        CODE,
                        f"{square.where}: the current of the {square.signal} is {second} at most where the "
                        f"{step.signal} of {step.where} reaches {bound}{first}: " + how_sure(sigmas),
                        _EXPERIMENT,
                        found=second,
                        expected=first,
                        sigmas=sigmas,
                        channel="current",
                    )
                )
    return found
