"""``ipmclab check``: what is wrong with records, and with what is known of a strip."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ipmclab.cli.files import means_actuator, read_runs
from ipmclab.cli.options import Json
from ipmclab.cli.output import finding_document, print_findings, print_json, progress
from ipmclab.errors import unknown_name

if TYPE_CHECKING:
    from ipmclab.run import Finding, Run

SEVERITIES = ("info", "warning", "error")

Items = Annotated[
    list[str],
    typer.Argument(
        metavar="RUN|ACTUATOR...", help="Runs (.nc); actuators (library names, TOML files).", show_default=False
    ),
]


def check(
    items: Items,
    actuator: Annotated[
        str | None,
        typer.Option(metavar="ACTUATOR", help="A model of the strip: foretells a resonance that the rate cannot show."),
    ] = None,
    fail_on: Annotated[
        str | None,
        typer.Option(metavar="|".join(SEVERITIES), help="Exit with 1 on a finding at least this severe."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Check records, those of one sample also against each other, and strips against all that is known of them.

    \b
    ipmclab check step.nc sine.nc --fail-on error
    ipmclab check friend-2
    ipmclab check fitted.toml step.nc sine.nc
    """
    if fail_on is not None and fail_on not in SEVERITIES:
        raise unknown_name("severity", fail_on, SEVERITIES, where="--fail-on")
    model = None
    if actuator is not None:
        from ipmclab import load_actuator

        model = load_actuator(actuator)
    strips = [item for item in items if means_actuator(item)]
    runs = [Path(item) for item in items if item not in strips]
    loaded = read_runs(runs)
    with progress("checking"):
        from ipmclab.quality import check as check_run
        from ipmclab.quality import check_together

        known = [(strip, _conflicts(strip, loaded)) for strip in strips]
        found = [check_run(run, model) for run in loaded]
        between = check_together(loaded) if len(loaded) > 1 else ()

    everything = [finding for findings in (*found, between, *(one for _, one in known)) for finding in findings]
    ranks = [SEVERITIES.index(finding.severity) for finding in everything]
    if as_json:
        print_json(
            {
                "runs": [
                    {"run": path, "findings": [finding_document(finding) for finding in findings]}
                    for path, findings in zip(runs, found, strict=True)
                ],
                "together": [finding_document(finding) for finding in between],
                "actuators": [
                    {"actuator": strip, "findings": [finding_document(finding) for finding in findings]}
                    for strip, findings in known
                ],
                "worst": SEVERITIES[max(ranks)] if ranks else None,
            }
        )
    else:
        for place, (path, findings) in enumerate(zip(runs, found, strict=True)):
            _print(f"run {place}, {path}" if len(runs) > 1 else str(path), findings)
        if between:
            print("together:")
            print_findings(between)
        for strip, findings in known:
            _print(strip, findings)
    if fail_on is not None and any(rank >= SEVERITIES.index(fail_on) for rank in ranks):
        raise typer.Exit(1)


def _print(name: str, findings: Sequence[Finding]) -> None:
    print(f"{name}: {len(findings) or 'no'} finding{'' if len(findings) == 1 else 's'}")
    print_findings(findings)


def _conflicts(strip: str, runs: Sequence[Run]) -> tuple[Finding, ...]:
    """The cross-checks on one actuator; to a sample of the thesis belongs what the thesis states of it."""
    from ipmclab import load_actuator, read_fit
    from ipmclab.consistency import cross_check, published_of
    from ipmclab.data import published_sample

    model = load_actuator(strip)
    fit = read_fit(strip) if model.fit_table is not None else None
    facts = () if Path(strip).exists() else published_of(strip)
    sample = model.sample
    if sample is None and facts and facts[0].sample is not None:
        sample = published_sample(int(facts[0].sample.removeprefix("friend-")))
    found = cross_check(model, runs, fit=fit, facts=facts, sample=sample)
    # What the runs say of each other is under "together".
    return tuple(finding for finding in found if not (finding.code == "prefix-disagrees" and "until" in finding.values))
