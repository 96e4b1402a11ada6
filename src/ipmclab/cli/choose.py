"""``ipmclab choose``: which of several models the runs call for."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ipmclab.cli.files import actuator_files, check_output, read_runs
from ipmclab.cli.options import Force, Json, PerRun, RunFiles, Scheduler, Workers
from ipmclab.cli.output import console, print_json, print_paragraph, print_table, read, significant
from ipmclab.errors import INTERRUPTED, InputError, IpmclabError
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    from ipmclab.choosing.choice import Choice

_FIGURES = (".svg", ".png", ".pdf")


def choose(
    runs: RunFiles,
    models: Annotated[
        list[str],
        typer.Option(
            metavar="A,B,C",
            help="Actuators, or stages of --actuator (leak.cubic or branches=1,2,3); repeat it, or use commas.",
        ),
    ],
    free: Annotated[
        list[str],
        typer.Option(
            metavar="NAMES",
            default_factory=list,
            show_default=False,
            help="As in identify; by default everything in the groups of a model's stages.",
        ),
    ],
    per_run: PerRun,
    actuator: Annotated[
        str | None, typer.Option(metavar="ACTUATOR", help="The actuator that stages are added to.")
    ] = None,
    hold_out: Annotated[
        str | None,
        typer.Option(metavar="runs|blocks", help="Whole runs (the default for several), or blocks of time."),
    ] = None,
    blocks: Annotated[int, typer.Option(metavar="N", help="About how many blocks of time are compared.")] = 24,
    folds: Annotated[
        int, typer.Option(metavar="N", help="How often, at most, each model is fitted without a part of the readings.")
    ] = 6,
    out: Annotated[
        Path | None, typer.Option(metavar="FITTED.toml", help="Write the fit of the preferred model.")
    ] = None,
    report: Annotated[Path | None, typer.Option(metavar="FILE.html", help="Write a report.")] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE.svg|.png|.pdf", help="Write a figure of the differences.")
    ] = None,
    scheduler: Scheduler = None,
    workers: Workers = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Fit several models, and rank them by how well they predict readings that they did not see.

    \b
    ipmclab choose step.nc sine.nc --actuator friend-2 --models branches=1,2,3
    """
    from ipmclab.choosing.choose import choose as choose_model
    from ipmclab.engine import opened

    named = [name for listed in models for name in listed.split(",")]
    reads: list[Path | str] = [*actuator_files(actuator, *named), *runs]
    outputs = {"--out": (out, (".toml",)), "--report": (report, (".html",)), "--plot": (plot, _FIGURES)}
    for option, (path, suffixes) in outputs.items():
        if path is not None:
            check_output(path, force=force, suffixes=suffixes, reads=reads, option=option)
    if hold_out not in (None, "runs", "blocks"):
        raise InputError(
            f"{hold_out!r} cannot be held out",
            code="bad-hold-out",
            where="--hold-out",
            repair="give --hold-out runs or --hold-out blocks",
        )
    loaded = read_runs(runs)
    with _telling() as tell, opened(scheduler=scheduler, workers=workers) as engine:
        try:
            choice = choose_model(
                loaded,
                models,
                actuator=actuator,
                free=free,
                per_run=per_run,
                held_out=hold_out,  # type: ignore[arg-type]
                blocks=blocks,
                folds=folds,
                engine=engine,
                progress=tell,
            )
        except KeyboardInterrupt:
            raise _stopped() from None
    if out is not None:
        from ipmclab import write_fit

        write_fit(choice.fit, out, overwrite=force)
    if report is not None:
        from ipmclab.reporting.choice import report_choice

        asked = {"--models": models, "--free": free, "--per-run": per_run}
        words = ["ipmclab", "choose", *map(str, runs)]
        words += [word for option, names in asked.items() if names for word in (option, ",".join(names))]
        words += ["--actuator", actuator] if actuator else []
        words += ["--hold-out", hold_out] if hold_out else []
        words += ["--blocks", str(blocks), "--folds", str(folds)]
        report_choice(choice, report, runs=loaded, command=shlex.join(words), overwrite=force)
    if plot is not None:
        from ipmclab.reporting.choice import plot_choice

        plot_choice(choice, plot, overwrite=force)
    written = {"out": out, "report": report, "plot": plot}
    if as_json:
        print_json(choice.as_dict() | {"runs": runs} | written)
    else:
        print_choice(choice)
        for path in written.values():
            if path is not None:
                print(f"wrote {path}")
    if choice.unfinished:
        raise SystemExit(INTERRUPTED)  # what is finished is kept, and it is not all that was asked


def _stopped() -> IpmclabError:
    stopped = IpmclabError(
        "stopped before two models were finished: nothing can be compared",
        code="interrupted",
        repair="run the command again, with fewer --models, --folds or --free where it takes too long, or --workers",
    )
    stopped.exit_status = INTERRUPTED
    return stopped


def print_choice(choice: Choice) -> None:
    """Print the ranking, and what came of it in words."""
    ranked = choice.ranked
    rows = []
    for one in ranked:
        difference = choice.to_best(one.name)
        aic, bic = ([getattr(one, which), min(getattr(other, which) for other in ranked)] for which in ("aic", "bic"))
        rows.append(
            [
                one.name,
                str(one.parameters),
                "0" if difference is None else significant(difference.value, 3),
                "" if difference is None else significant(difference.standard_error, 2),
                "" if difference is None or difference.is_distinguished else "not distinguishable",
                *(read(one.rmse[output], CHANNELS[output], digits=3) for output in choice.outputs),
                significant(aic[0] - aic[1], 3),
                significant(bic[0] - bic[1], 3),
                "preferred" if one.name == choice.preferred else "",
            ]
        )
    errors = [f"RMSE of {CHANNELS[output].name}" for output in choice.outputs]
    print_table(["model", "parameters", "difference", "its error", "", *errors, "AIC", "BIC", ""], rows)
    held = "whole runs" if choice.held_out == "runs" else "blocks of time"
    print_paragraph(
        f"Held out: {held}, compared in {choice.blocks} blocks. Differences of the log predictive likelihood in "
        f"nats. AIC and BIC are of the fit to everything, with {choice.readings} readings counted as "
        f"{significant(choice.effective_readings, 2)} independent ones."
    )
    for sentence in choice.sentences:
        print_paragraph(sentence)


@contextmanager
def _telling() -> Iterator[Callable[[str, int, int], None] | None]:
    """Say on a terminal which fit is being made."""
    if not sys.stderr.isatty():
        yield None
        return
    with console(stderr=True).status("choosing") as status:
        yield lambda what, done, total: status.update(f"choosing: {what} (fit {done + 1} of {total})")
