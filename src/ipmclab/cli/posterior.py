"""``ipmclab posterior``: samples of what runs leave of the parameters of an actuator."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ipmclab.cli.files import actuator_files, check_output, read_runs
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
    print_json,
    print_most_important,
    print_paragraph,
    print_table,
    progress,
    significant,
)

if TYPE_CHECKING:
    from ipmclab.posterior.posterior import Posterior

_FIGURES = (".svg", ".png", ".pdf")


def posterior(
    actuator: ActuatorName,
    runs: RunFiles,
    free: Free,
    out: Annotated[Path, typer.Option(metavar="POSTERIOR.nc", help="The samples to write; ArviZ reads them.")],
    per_run: PerRun,
    per_mounting: PerMounting,
    prior: Prior,
    figure: Annotated[
        Path | None, typer.Option(metavar="FILE.svg|.png|.pdf", help="Write a figure of all pairs.")
    ] = None,
    steps: Annotated[int, typer.Option(metavar="N", help="The largest number of steps of each walker (chain).")] = 5000,
    scheduler: Scheduler = None,
    workers: Workers = None,
    force: Force = False,
    details: Details = False,
    as_json: Json = False,
) -> None:
    """Fit, then draw samples of the parameters (extra bayes); nothing is given out unless the chains agree.

    \b
    ipmclab posterior friend-2 step.nc --free electrical --out posterior.nc --figure pairs.svg
    """
    from ipmclab import load_actuator
    from ipmclab.engine import opened
    from ipmclab.fit.interrupted import uninterrupted
    from ipmclab.identification.identify import identify

    reads: list[Path | str] = [*actuator_files(actuator), *runs]
    check_output(out, force=force, suffixes=(".nc",), reads=reads)
    if figure is not None:
        check_output(figure, force=force, suffixes=_FIGURES, reads=reads, option="--figure")
    model = load_actuator(actuator)
    loaded = read_runs(runs)
    with progress(f"sampling {model.name}") as tell, opened(scheduler=scheduler, workers=workers) as engine:
        # What samples takes half a second to load, and is looked for before the long work.
        from ipmclab.posterior.packages import bayes_package
        from ipmclab.posterior.posterior import sample_posterior, write_posterior

        bayes_package("emcee")
        fit = identify(model, loaded, free=free, per_run=per_run, per_mounting=per_mounting, prior=prior, progress=tell)
        found = sample_posterior(uninterrupted(fit), steps=steps, engine=engine, progress=tell)
        write_posterior(found, out, overwrite=force)
        if figure is not None:
            from ipmclab.reporting.figures.pairs import pairs_figure
            from ipmclab.reporting.save import save_figure

            save_figure(lambda: pairs_figure(found, fit), figure, overwrite=force)
    if as_json:
        print_json({"posterior": posterior_document(found), "runs": runs, "out": out, "figure": figure})
        return
    print_posterior(found, details=details)
    for path in (out, figure):
        if path is not None:
            print(f"wrote {path}")


def print_posterior(posterior: Posterior, *, details: bool = False) -> None:
    """Print a posterior: its parameters, and how the chains did."""
    from ipmclab.prediction.remarks import AVERAGED

    rows = []
    next_known = any(one.interval_next_mounting is not None for one in posterior.parameters.values())
    for name, one in posterior.parameters.items():
        factor = one.quantity.to_display(1.0) if one.quantity is not None else 1.0
        low, high = (factor * end for end in one.interval)
        notes = [] if one.is_free else ["fixed, as uncertain as stated"]
        notes += ["with its prior"] if one.is_free and one.prior is not None else []
        notes += ["reaches its bound"] if one.at_bound else []
        notes += [AVERAGED] if one.is_average else []
        following = one.interval_next_mounting
        ends = "-" if following is None else " to ".join(significant(factor * end, 3) for end in following)
        rows.append(
            [
                name,
                significant(factor * one.median, 5),
                f"{significant(low, 5)} to {significant(high, 5)}",
                *([ends] if next_known else []),
                one.quantity.display_unit if one.quantity is not None else one.unit,
                f"{one.convergence.r_hat:.4f}",
                f"{one.convergence.bulk:.0f}",
                ", ".join(notes),
            ]
        )
    intervals = ["95 % of samples", *(["next mounting"] if next_known else [])]
    print_table(["parameter", "median", *intervals, "unit", "R-hat", "effective samples", ""], rows)
    why = posterior.next_mounting_unknown
    if why:
        print_paragraph(f"{why[0].upper()}{why[1:]}.")
    if posterior.left_out:
        print_paragraph(f"Not sampled, because the runs do not show it: {', '.join(posterior.left_out)}.")
    if any(one.at_bound for one in posterior.parameters.values()):
        print_paragraph(
            "What reaches its bound is ended by it, not by the runs: its interval says what was taken as possible"
            " beforehand."
        )
    print_most_important(posterior.findings, details=details)
    print_paragraph(
        f"The chains agree after {posterior.steps} steps of each walker, of which the later half was kept; "
        f"{100.0 * posterior.accepted:.0f} % of the proposals were accepted."
    )


def posterior_document(posterior: Posterior) -> dict[str, Any]:
    """A posterior as it is written to a JSON document."""
    names = list(posterior.parameters)
    return {
        "actuator": posterior.actuator,
        "parameters": {
            name: {
                "mean": one.mean,
                "median": one.median,
                "standard_deviation": one.standard_deviation,
                "interval": one.interval,
                "interval_next_mounting": one.interval_next_mounting,
                "unit": one.unit,
                "prior": one.prior,
                "at_bound": one.at_bound,
                "is_average": one.is_average,
                "is_free": one.is_free,
                "r_hat": one.convergence.r_hat,
                "effective_samples": one.convergence.bulk,
                "effective_samples_in_tails": one.convergence.tail,
                "autocorrelation_time": one.convergence.autocorrelation_time,
            }
            for name, one in posterior.parameters.items()
        },
        "correlations": {one: {other: posterior.correlation(one, other) for other in names} for one in names},
        "left_out": posterior.left_out,
        "next_mounting_unknown": posterior.next_mounting_unknown or None,
        "findings": [finding_document(finding) for finding in posterior.findings],
        "seed": posterior.seed,
        "steps": posterior.steps,
        "accepted": posterior.accepted,
    }
