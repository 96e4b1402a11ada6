"""``ipmclab check``: what is wrong with records."""

from __future__ import annotations

from typing import Annotated

import typer

from ipmclab.cli.files import read_runs
from ipmclab.cli.options import Json, RunFiles
from ipmclab.cli.output import finding_document, print_findings, print_json, progress
from ipmclab.errors import InputError, suggest

SEVERITIES = ("info", "warning", "error")


def check(
    runs: RunFiles,
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
    """Check records; those of one sample also against each other.

    \b
    ipmclab check step.nc sine.nc --fail-on error
    """
    if fail_on is not None and fail_on not in SEVERITIES:
        raise InputError(
            f"unknown severity {fail_on!r}",
            code="unknown-severity",
            where="--fail-on",
            repair=suggest(fail_on, SEVERITIES),
        )
    model = None
    if actuator is not None:
        from ipmclab import load_actuator

        model = load_actuator(actuator)
    loaded = read_runs(runs)
    with progress("checking"):
        from ipmclab.quality import check as check_run
        from ipmclab.quality import check_together

        found = [check_run(run, model) for run in loaded]
        between = check_together(loaded) if len(loaded) > 1 else ()

    everything = [finding for findings in (*found, between) for finding in findings]
    ranks = [SEVERITIES.index(finding.severity) for finding in everything]
    if as_json:
        print_json(
            {
                "runs": [
                    {"run": path, "findings": [finding_document(finding) for finding in findings]}
                    for path, findings in zip(runs, found, strict=True)
                ],
                "together": [finding_document(finding) for finding in between],
                "worst": SEVERITIES[max(ranks)] if ranks else None,
            }
        )
    else:
        for place, (path, findings) in enumerate(zip(runs, found, strict=True)):
            name = f"run {place}, {path}" if len(runs) > 1 else str(path)
            print(f"{name}: {len(findings) or 'no'} finding{'' if len(findings) == 1 else 's'}")
            print_findings(findings)
        if between:
            print("together:")
            print_findings(between)
    if fail_on is not None and any(rank >= SEVERITIES.index(fail_on) for rank in ranks):
        raise typer.Exit(1)
