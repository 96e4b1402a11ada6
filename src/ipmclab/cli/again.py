"""``ipmclab profile`` and ``ipmclab bootstrap``: how sure a fit is, asked of the runs in another way."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated

import typer

from ipmclab.cli.files import fit_or_actuator, read_runs
from ipmclab.cli.identify import fit_document
from ipmclab.cli.options import ActuatorName, Json, PerMounting, PerRun, Prior, RunFiles, Scheduler, Workers
from ipmclab.cli.output import (
    print_json,
    print_most_important,
    print_paragraph,
    print_table,
    progress,
    significant,
)
from ipmclab.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from ipmclab.fit.fit import Fit
    from ipmclab.progress import OnProgress

Free = Annotated[
    list[str],
    typer.Option(
        metavar="NAMES",
        default_factory=list,
        show_default=False,
        help="As in identify. Unless given, of a fitted file: what its fit had freed, also for each run and mounting.",
    ),
]


def profile(
    actuator: ActuatorName,
    runs: RunFiles,
    free: Free,
    per_run: PerRun,
    per_mounting: PerMounting,
    prior: Prior,
    as_json: Json = False,
) -> None:
    """Fit, then follow the likelihood's profile of every parameter to where its 95 % interval ends.

    \b
    ipmclab profile fitted.toml step.nc sine.nc
    """
    from ipmclab.refitting.profiles import profile as follow

    fit = _fitted(actuator, runs, (free, per_run, per_mounting, prior), lambda fit, tell: follow(fit, progress=tell))
    rows = {name: (one.interval, one.is_open) for name, one in fit.profiles.items()}
    if as_json:
        document = {
            name: {
                "value": fit.parameters[name].value,
                "interval": ends,
                "is_open": is_open,
                "unit": fit.parameters[name].unit,
            }
            for name, (ends, is_open) in rows.items()
        }
        print_json({"actuator": actuator, "runs": runs, "fit": fit_document(fit), "profiles": document})
        return
    _print(fit, {name: ends for name, (ends, _) in rows.items()}, "profile's 95 %")


def bootstrap(
    actuator: ActuatorName,
    runs: RunFiles,
    free: Free,
    per_run: PerRun,
    per_mounting: PerMounting,
    prior: Prior,
    count: Annotated[int, typer.Option(help="How many fits, at least 40.", metavar="N")] = 200,
    scheduler: Scheduler = None,
    workers: Workers = None,
    as_json: Json = False,
) -> None:
    """Fit, then fit again to readings drawn under the noise that was found, and see how the parameters scatter.

    \b
    ipmclab bootstrap fitted.toml step.nc --count 200
    """
    from ipmclab.engine import opened
    from ipmclab.refitting.bootstrap import FEWEST_DRAWS
    from ipmclab.refitting.bootstrap import bootstrap as draw

    if count < FEWEST_DRAWS:
        raise InputError(
            f"{count} draws do not give a 95 % interval, which needs {FEWEST_DRAWS}",
            code="out-of-range",
            where="--count",
            repair=f"give 200, or at least {FEWEST_DRAWS}",
        )
    kept = []

    def ask(fit: Fit, tell: OnProgress) -> Fit:
        with opened(scheduler=scheduler, workers=workers) as engine:
            kept.append(draw(fit, count, engine=engine, progress=tell))
        return fit

    fit = _fitted(actuator, runs, (free, per_run, per_mounting, prior), ask)
    (found,) = kept
    if as_json:
        document = {
            name: {
                "value": fit.parameters[name].value,
                "interval": ends,
                "standard_error": found.standard_errors[name],
                "unit": fit.parameters[name].unit,
            }
            for name, ends in found.intervals.items()
        }
        asked = {"actuator": actuator, "runs": runs, "count": count, "failed": found.failed}
        print_json({**asked, "fit": fit_document(fit), "parameters": document})
        return
    _print(fit, found.intervals, "95 % of fits")
    print(f"{count} fits to drawn readings, {found.failed} of them failed")


Lists = tuple[list[str], list[str], list[str], list[str]]


def _fitted(actuator: str, runs: list[Path], names: Lists, ask: Callable[[Fit, OnProgress], Fit]) -> Fit:
    """The fit of runs, and what is then asked of it."""
    from ipmclab.fit.fit import Fit as AnyFit
    from ipmclab.identification.identify import identify

    free, per_run, per_mounting, prior = names
    given = fit_or_actuator(actuator)
    model = given.actuator if isinstance(given, AnyFit) else given
    if not free and isinstance(given, AnyFit):
        free, of_runs, of_mountings = _freed(given)
        if not per_run and not per_mounting:
            per_run, per_mounting = of_runs, of_mountings
    loaded = read_runs(runs)
    with progress(f"fitting {model.name}") as tell:
        fit = identify(model, loaded, free=free, per_run=per_run, per_mounting=per_mounting, prior=prior, progress=tell)
        return ask(fit, tell)


def _freed(fit: Fit) -> tuple[list[str], list[str], list[str]]:
    """What a fit had freed by name, and of that what each run and each mounting had for itself."""
    from ipmclab.identification.problem.free import is_named

    parts = [name.partition("[")[::2] for name in fit.parameters]
    places = [(name, place) for name, place in parts if is_named(name)]
    return (
        list(dict.fromkeys(name for name, _ in places)),
        list(dict.fromkeys(name for name, place in places if place and not place.startswith("mounting "))),
        list(dict.fromkeys(name for name, place in places if place.startswith("mounting "))),
    )


def _print(fit: Fit, found: Mapping[str, tuple[float, float]], title: str) -> None:
    """Print intervals in addition to those of the fit, in the units that people read; then what the fit says."""
    from ipmclab.fit.rows import digits_of, interval_in_words
    from ipmclab.fit.verdict import verdict

    known = fit.actuator.parameters()
    rows = []
    for name, ends in found.items():
        one, base = fit.parameters[name], known.get(name.partition("[")[0])
        factor = base.quantity.to_display(1.0) if base is not None else 1.0
        pairs = [(factor * low, factor * high) for low, high in (one.interval, ends)]
        digits = max(digits_of(factor * one.value, high - low) for low, high in pairs)
        unit = base.quantity.display_unit if base is not None else one.unit
        spans = [interval_in_words(*pair, digits) for pair in pairs]
        rows.append([name, significant(factor * one.value, digits), *spans, unit])
    print_table(["parameter", "value", "95 % interval", title, "unit"], rows)
    print_paragraph(verdict(fit))
    outputs = [name for one in fit.observations for name in one.noise]
    labels = [label for label, _ in fit.runs]
    where = "ipmclab identify --details"
    print_most_important(fit.findings, details=False, outputs=outputs, labels=labels, where=where)
