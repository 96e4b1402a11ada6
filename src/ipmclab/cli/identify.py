"""``ipmclab identify``: from runs to a fitted actuator."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ipmclab.cli.files import actuator_files, check_output, read_runs
from ipmclab.cli.identifiable import collinearity, identifiability_document, print_collinear, print_profiles
from ipmclab.cli.many_runs import many_runs_document, print_many_runs
from ipmclab.cli.options import (
    ActuatorName,
    Details,
    Force,
    Free,
    Json,
    PerMounting,
    PerRun,
    Prior,
    RunFiles,
    Scheduler,
    Workers,
)
from ipmclab.cli.output import (
    finding_document,
    print_briefly,
    print_json,
    print_paragraph,
    print_table,
    progress,
    read,
    significant,
    with_unit,
)
from ipmclab.errors import InputError
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit


def identify(
    actuator: ActuatorName,
    runs: RunFiles,
    free: Free,
    out: Annotated[
        Path, typer.Option(metavar="FITTED.toml", help="The fitted actuator to write; a folder with --each-strip.")
    ],
    per_run: PerRun,
    per_mounting: PerMounting,
    prior: Prior,
    force: Force = False,
    details: Details = False,
    as_json: Json = False,
    thorough: Annotated[
        bool,
        typer.Option(
            "--thorough", help="Also where it takes long: follow the profile of each parameter, and leave out each run."
        ),
    ] = False,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Fit readings whose unit seems to be off by a factor of 1000 as they are.")
    ] = False,
    each_strip: Annotated[
        bool, typer.Option("--each-strip", help="Fit each strip (sample) of the runs by itself, to files in --out.")
    ] = False,
    scheduler: Scheduler = None,
    workers: Workers = None,
) -> None:
    """Identify parameters of an actuator from one or more runs at once.

    \b
    ipmclab identify friend-2 step.nc sine.nc --free electrical --out fitted.toml
    ipmclab identify friend-2 many/*.nc --free electrical --each-strip --workers 4 --out fits
    """
    from ipmclab import load_actuator, write_fit
    from ipmclab.workflows.fitting import fit_of_runs

    if each_strip:
        from ipmclab.cli.identify_each import identify_each
        from ipmclab.workflows.many_strips import Asked

        identify_each(
            Asked(load_actuator(actuator), free, per_run, per_mounting, prior, thorough, anyway),
            read_runs(runs),
            out,
            reads=[*actuator_files(actuator), *runs],
            document=fit_document,
            scheduler=scheduler,
            workers=workers,
            force=force,
            as_json=as_json,
        )
        return
    if scheduler is not None or workers is not None:
        raise InputError(
            "one fit is one piece of work",
            code="usage",
            where="--scheduler" if scheduler is not None else "--workers",
            repair="add --each-strip to fit many strips, or leave it out",
        )
    check_output(out, force=force, suffixes=(".toml",), reads=[*actuator_files(actuator), *runs])
    model = load_actuator(actuator)
    loaded = read_runs(runs)
    with progress(f"identifying {model.name}", answering=True) as tell:
        fit = fit_of_runs(
            model,
            loaded,
            free=free,
            per_run=per_run,
            per_mounting=per_mounting,
            prior=prior,
            thorough=thorough,
            anyway=anyway,
            progress=tell,
        )
        write_fit(fit, out, overwrite=force)
    if as_json:
        print_json({"fit": fit_document(fit), "runs": runs, "out": out})
    else:
        print_fit(fit, details=details)
        print(f"wrote {out}")


def print_fit(
    fit: Fit, *, details: bool = False, where: str = "--details, or the report", before: Fit | None = None
) -> None:
    """Print a fit: in short, or with all that is known of its parameters, its noise and its findings.

    Parameters
    ----------
    fit : Fit
    details : bool
    where : str
        Where the findings stand that the short answer does not say.
    before : Fit, optional
        One that was printed before: a short answer does not repeat its findings.
    """
    from ipmclab.fit.answer import summary_of

    if details:
        print_details(fit)
    else:
        print(summary_of(fit, where, before))


def print_details(fit: Fit) -> None:
    """Print everything that a fit says."""
    from ipmclab.fit.answer import known_title
    from ipmclab.fit.in_brief import most_important_first
    from ipmclab.fit.output_diagnosis import WORDS
    from ipmclab.fit.rows import known_rows, parameter_rows, quantity_of
    from ipmclab.fit.verdict import REFUSED, verdict
    from ipmclab.prediction.remarks import remarks
    from ipmclab.quality.scale import CODE as UNIT_OFF

    print_paragraph(verdict(fit))
    print_briefly([finding for finding in fit.findings if finding.code == UNIT_OFF])
    said = remarks(fit)
    next_known = any(parameter.interval_next_mounting for parameter in fit.parameters.values())
    rows = []
    for row, (name, parameter) in zip(parameter_rows(fit), fit.parameters.items(), strict=True):
        quantity, following = quantity_of(fit, name), parameter.interval_next_mounting
        ends = [significant(end if quantity is None else quantity.to_display(end), 3) for end in following or ()]
        rows.append(
            [
                name,
                row.value,
                row.interval,
                *([" to ".join(ends) or "-"] if next_known else []),
                row.unit,
                collinearity(fit, name),
                said[name],
            ]
        )
    intervals = ["95 % interval", *(["next mounting"] if next_known else [])]
    print_table(["parameter", "value", *intervals, "unit", "collinearity", ""], rows)
    if fit.known and not verdict(fit).startswith(REFUSED):
        print_table(
            [known_title(fit), "value", "95 % interval", "unit", ""],
            [[row.name, row.value, row.interval, row.unit, row.remark] for row in known_rows(fit)],
        )
    if fit.undetermined:
        print("These runs leave open:")
    for direction in fit.undetermined:
        print_paragraph(f"- {direction.sentence}")
    print_profiles(fit)
    print_collinear(fit)
    left = {(one.label, one.output): WORDS[one.verdict] for one in fit.diagnoses}
    noise = [
        [
            observation.label,
            CHANNELS[output].name,
            read(sigma, CHANNELS[output], digits=3),
            str(observation.samples[output]),
            left.get((observation.label, output), ""),
        ]
        for observation in fit.observations
        for output, sigma in observation.noise.items()
    ]
    print_table(["run", "output", "residual", "samples", "what is left"], noise)
    print_many_runs(fit)
    print_paragraph(f"{'Converged' if fit.converged else 'Did not converge'}: {fit.message}")
    # The sentences above say what is not determined.
    outputs = {name for one in fit.observations for name in one.noise}
    findings = most_important_first(fit.findings, outputs)
    print_briefly([finding for finding in findings if finding.code not in ("undetermined", UNIT_OFF)])


def fit_document(fit: Fit) -> dict[str, Any]:
    """A fit as it is written to a JSON document."""
    return {
        "actuator": fit.actuator.name,
        "converged": fit.converged,
        "message": fit.message,
        "rank": fit.rank,
        "parameters": {
            name: {
                "value": parameter.value,
                "unit": parameter.unit,
                "standard_error": parameter.standard_error,
                "interval": parameter.interval,
                "interval_next_mounting": parameter.interval_next_mounting,
                "determined": parameter.determined,
                "at_bound": parameter.at_bound,
                "prior": parameter.prior,
            }
            for name, parameter in fit.parameters.items()
        },
        "known": {
            one.name: {
                "value": one.value,
                "unit": one.quantity.unit,
                "interval": one.interval,
                "words": one.words,
                "leans": one.leans,
            }
            for one in fit.known
        },
        "summary": fit.summary(),
        "undetermined": [
            {"coefficients": direction.coefficients, "sentence": direction.sentence, "cures": direction.cures}
            for direction in fit.undetermined
        ],
        "correlations": fit.correlations,
        "observations": [
            {
                "label": observation.label,
                "content_sha256": observation.content_sha256,
                "delay": with_unit(observation.delay, "s"),
                "start": observation.start,
                "noise": {
                    output: with_unit(sigma, CHANNELS[output].unit) for output, sigma in observation.noise.items()
                },
                "samples": observation.samples,
                **({} if observation.state is None else {"state": observation.state.to_table()}),
            }
            for observation in fit.observations
        ],
        **many_runs_document(fit),
        **identifiability_document(fit),
        "diagnoses": [one.to_table() for one in fit.diagnoses],
        "findings": [finding_document(finding) for finding in fit.findings],
    }
