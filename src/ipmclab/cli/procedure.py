"""``ipmclab procedure``: the thesis's own way from a strip to its parameters, step by step."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ipmclab.cli.files import check_output, write_template
from ipmclab.cli.identify import fit_document
from ipmclab.cli.options import Details, Force, Json
from ipmclab.cli.output import (
    TEXT_WIDTH,
    finding_document,
    print_findings,
    print_json,
    print_most_important,
    print_paragraph,
    print_table,
    progress,
)
from ipmclab.errors import InputError, IpmclabError
from ipmclab.platform import as_typed

if TYPE_CHECKING:
    from ipmclab.procedure.follow import Characterisation
    from ipmclab.procedure.step import Step


def procedure(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="PROCEDURE.toml", help="What was measured by hand, and which runs.", show_default=False),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FITTED.toml", help="The fitted actuator to write, or the template.")
    ] = None,
    template: Annotated[bool, typer.Option("--template", help="Write a procedure to fill in.")] = False,
    force: Force = False,
    details: Details = False,
    as_json: Json = False,
) -> None:
    """Find the parameters of a strip step by step: four probes, dc, branches, mass, push, force; then all at once.

    \b
    ipmclab procedure --template --out mine.toml
    ipmclab procedure mine.toml --out fitted.toml
    """
    if template:
        from ipmclab.procedure.template import TEMPLATE

        then = f"ipmclab procedure {as_typed(out)}" if out is not None else ""
        write_template(TEMPLATE, file, out, verb="procedure", then=then, force=force, as_json=as_json)
        return
    if file is None:
        raise InputError(
            "no procedure is given",
            code="usage",
            where="ipmclab procedure",
            repair="write one to fill in: ipmclab procedure --template --out mine.toml",
        )
    if out is not None:
        check_output(out, force=force, suffixes=(".toml",), reads=[file])
    from ipmclab import follow_procedure, read_procedure

    given = read_procedure(file)
    if out is not None:
        check_output(out, force=force, suffixes=(".toml",), reads=given.files)
    steps: dict[str, Step] = {}
    try:
        with progress(f"{given.name}: the procedure") as tell:
            found = follow_procedure(given, progress=tell, step_done=lambda step: steps.update({step.name: step}))
    except (IpmclabError, KeyboardInterrupt):
        if not as_json:
            _print_steps(steps)
        raise
    if not as_json:
        _print(found, details=details)
    for step, finding in found.impossible:
        wrong = InputError(finding.message, code=finding.code, where=f"{file}: {step.name}", repair=finding.repair)
        if not as_json or out is not None:
            raise wrong
        print_json({"error": wrong.as_dict(), **_document(found, out)})  # with all that was found besides
        print(f"error: {wrong}", file=sys.stderr)
        raise typer.Exit(wrong.exit_status)
    if as_json and out is None:
        print_json(_document(found, out))
    if out is not None:
        _write(found, file, out, force=force, as_json=as_json)


def _write(found: Characterisation, file: Path, out: Path, *, force: bool, as_json: bool) -> None:
    """Write the fit of all runs at once."""
    from ipmclab import write_fit

    if found.joint is None:
        raise IpmclabError(
            f"{out} was not written: {', '.join(step.title for step in found.missing)} "
            f"{'is' if len(found.missing) == 1 else 'are'} missing",
            code="procedure-unfinished",
            where=str(file),
            repair=found.missing[0].advice,
        )
    write_fit(found.joint.fit, out, overwrite=force)
    if as_json:
        print_json(_document(found, out))
    else:
        print(f"wrote {out}")


def _print(found: Characterisation, *, details: bool) -> None:
    for number, step in enumerate(found.steps, start=1):
        _print_step(number, step)
    if found.impossible:
        return  # what is next is to write a number again, as the error says
    if found.joint is None:
        step = found.missing[0]
        print_paragraph(f"Next: {step.title}: {step.advice}.")
        return
    rows = [(row.name, *row.said) for row in found.compared]
    print_table(["parameter", "step by step", "all runs at once"], rows, title="Both ways")
    print_paragraph(
        "All runs at once: each run counts once, and what was measured without them (sheet resistance, modulus) is "
        "known beforehand. ± is one standard uncertainty."
    )
    print_most_important([*found.joint.findings, *found.joint.fit.findings], details=details)


def _print_steps(steps: Mapping[str, Step]) -> None:
    """The steps that were done before one failed."""
    from ipmclab.procedure.follow import TO_DO

    for number, name in enumerate(TO_DO, start=1):
        if name in steps:
            _print_step(number, steps[name])


def _print_step(number: int, step: Step) -> None:
    cannot_be = any(one.code == "impossible-value" for one in step.findings)
    state = ": cannot be" if cannot_be else f": {step.how}" if not step.results else ": not enough"
    print(f"{number}. {step.title}" + ("" if step.done else state))
    if step.done or step.results or step.findings:
        if step.results or cannot_be:
            _print_indented(step.how, "   ")
        rows = [(f"   {name}", one.said, one.because) for name, one in {**step.also, **step.results}.items()]
        if rows:
            print_table(["", "± standard uncertainty", "of which"], rows)
        print_findings(step.findings)
    if step.advice and not cannot_be:  # the finding says it
        _print_indented(step.advice, "   -> ")
    print()


def _print_indented(text: str, before: str) -> None:
    print(textwrap.fill(text, TEXT_WIDTH, initial_indent=before, subsequent_indent=" " * len(before)))


def _document(found: Characterisation, out: Path | None) -> dict[str, Any]:
    table = found.to_table()
    for shown, step in zip(table["steps"], found.steps, strict=True):
        shown["findings"] = [finding_document(one) for one in step.findings]
    return {
        "name": found.name,
        "steps": table["steps"],
        "missing": [step.name for step in found.missing],
        "next": found.missing[0].advice if found.missing else None,
        "compared": table["compared"],
        "findings": [finding_document(one) for one in (found.joint.findings if found.joint else ())],
        "fit": None if found.joint is None else fit_document(found.joint.fit),
        "out": out if found.joint is not None else None,
    }
