"""``ipmclab demo``: the whole job on the virtual bench, from a strip in the clamp to a report."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from ipmclab.cli.identify import fit_document, print_fit
from ipmclab.cli.options import Json
from ipmclab.cli.output import finding_document, print_json, print_paragraph, print_table, progress, read, with_unit
from ipmclab.cli.validate import print_validations, validation_document
from ipmclab.errors import InputError
from ipmclab.platform import as_typed

if TYPE_CHECKING:
    from ipmclab.cli.published import Comparison
    from ipmclab.fit.fit import Fit
    from ipmclab.model import Actuator
    from ipmclab.prediction.validate import Validation
    from ipmclab.rig.bench import Bench
    from ipmclab.run import Run

SAMPLE: Final = 2
"""The thesis's number of the strip."""

FOLDER: Final = "ipmclab-demo"
REPORT: Final = "report.html"
SEED: Final = 20261121
FOR_THE_FIT: Final = ("force-step.nc", "force-sine.nc")
"""The thesis identified d from the force of these two (section 4.5)."""

PICTURED: Final = "force-square.nc"
"""The prediction that is in the picture with the two runs of the fit."""

_BOUNDS: Final = {"stated": "", "lower_bound": "> ", "upper_bound": "< "}

Say = Callable[[str], None]


def demo(
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help=f"A new folder for the results; {FOLDER} (or {FOLDER}-2 and so on) unless given.",
            show_default=False,
        ),
    ] = None,
    stand_in: Annotated[
        bool,
        typer.Option("--stand-in", help="Record through NI's own client, from the stand-in chassis (extra ni)."),
    ] = False,
    as_json: Json = False,
) -> None:
    """Do the whole job on the virtual bench.

    Records sample 2 of Friend's thesis on a simulated bench, identifies a model of it, predicts runs that the
    model never saw, writes a report, and holds the model against what the thesis measured.

    \b
    ipmclab demo
    """
    from ipmclab import load_actuator, write_fit
    from ipmclab.cli.conflict import finding
    from ipmclab.cli.published import compare_with_thesis
    from ipmclab.data import published_sample
    from ipmclab.identification.identify import identify as identify_actuator
    from ipmclab.prediction.headline import DURATION, RATE
    from ipmclab.prediction.validate import validate as validate_actuator
    from ipmclab.quality import check as check_run

    def say(text: str) -> None:
        if not as_json:
            print(text, flush=True)

    sample = published_sample(SAMPLE)
    strip = replace(load_actuator(sample.id), sample=sample)
    if stand_in:
        from ipmclab.cli.rig_serve import need_client

        need_client()
    folder = _new_folder(out)

    where = "the stand-in chassis" if stand_in else "the virtual bench"
    say(f"1. Recording {strip.name} on {where}, {DURATION:g} s at {RATE:g} rows a second")
    runs = _record(strip, folder, say, stand_in=stand_in)
    used = [runs[name] for name in FOR_THE_FIT]
    unseen = {name: run for name, run in runs.items() if name not in FOR_THE_FIT}

    say("\n2. Checking the records")
    findings = {name: check_run(run) for name, run in runs.items()}
    for name, found in findings.items():
        say(f"   {name}: {', '.join(one.code for one in found) or 'nothing found'}")

    say("\n3. Identifying in the thesis's order: electrical from the current, then coupling from the force")
    say("   (the thesis measured R_dc first, from the steady current; here it is free)")
    with progress("identifying the electrical parameters"):
        electrical = identify_actuator(strip, used, free="electrical")
    if not as_json:
        print_fit(electrical, where="--json")
    with progress("identifying the coupling"):
        # The circuit stays free, so that one fit holds every parameter with its uncertainty.
        fit = identify_actuator(electrical.actuator, used, free="electrical,coupling")
        write_fit(fit, folder / "fitted.toml")
    say("")
    if not as_json:
        print_fit(fit, where=f"{REPORT} in step 5", before=electrical)

    say("\n4. Predicting runs that the model never saw: the square, and every displacement")
    with progress("predicting"):
        validation = validate_actuator(fit.actuator, list(unseen.values()))
    if not as_json:
        print_validations(["fitted.toml"], [validation], [Path(name) for name in unseen], where="--json")
        print_paragraph(open_and_predicted(fit, validation))

    say("\n5. Writing the report and one picture of it all")
    report, picture = folder / REPORT, folder / "overview.svg"
    with progress("writing the report"):
        from ipmclab.reporting import overview, save_figure
        from ipmclab.reporting import report as write_report

        write_report(fit, runs=used, validation_runs=list(unseen.values()), path=report, command="ipmclab demo")
        save_figure(overview(fit, used, validate_actuator(fit.actuator, [runs[PICTURED]])), picture)
    say(f"   {report}\n   {picture}")

    assert sample.hydrated_mass is not None
    comparisons = compare_with_thesis(fit.actuator)
    paragraphs = finding(fit.actuator, comparisons, hydrated_mass=sample.hydrated_mass)
    if as_json:
        print_json(
            {
                "folder": folder,
                "runs": [folder / name for name in runs],
                "findings": {name: [finding_document(one) for one in found] for name, found in findings.items()},
                "fits": [fit_document(electrical), fit_document(fit)],
                "fitted": folder / "fitted.toml",
                "validation": validation_document("fitted.toml", validation, [folder / name for name in unseen]),
                "report": report,
                "picture": picture,
                "open_and_predicted": open_and_predicted(fit, validation),
                "comparison": [_comparison_document(row) for row in comparisons],
                "finding": paragraphs,
            }
        )
        return
    say("\n6. The model next to what the thesis measured on this strip")
    _print_comparison(comparisons)
    for paragraph in paragraphs:
        print()
        print_paragraph(paragraph)
    say("\n" + _next_steps(folder, report))


def open_and_predicted(fit: Fit, validation: Validation) -> str:
    """How parameters that are not determined go with a prediction that is good, in one sentence; or that all are.

    Parameters
    ----------
    fit : Fit
    validation : Validation
        Of runs that the fit had not used.
    """
    scores = ", ".join(
        f"{score.output} {score.fit_percent:.0f} %"
        for score in validation.scores.values()
        if score.fit_percent is not None
    )
    unknown = [name for name, one in fit.parameters.items() if not one.determined]
    if not unknown:
        return f"All {len(fit.parameters)} parameters are determined, and runs that the fit never saw follow: {scores}."
    return (
        f"Both are true: {len(unknown)} of {len(fit.parameters)} parameters are not determined, and runs that the fit "
        f"never saw are predicted ({scores}), because these readings show what {', '.join(unknown)} do together and "
        "not what each does alone, and a prediction at this rate needs only what they do together."
    )


def _new_folder(wanted: Path | None) -> Path:
    """Make a folder that was not there."""
    folder = wanted or _first_free(FOLDER)
    if folder.exists():
        raise InputError(
            "it exists and was left as it is",
            code="file-exists",
            where=f"--out {folder}",
            repair="name a folder that is not there yet",
        )
    folder.mkdir()
    return folder


def _first_free(name: str) -> Path:
    folder, number = Path(name), 1
    while folder.exists():
        number += 1
        folder = Path(f"{name}-{number}")
    return folder


def _record(strip: Actuator, folder: Path, say: Say, *, stand_in: bool) -> dict[str, Run]:
    """Record each signal of the thesis twice: against the load cell, and free under the laser."""
    from ipmclab import write_run
    from ipmclab.prediction.headline import DURATION, RATE, SIGNALS
    from ipmclab.rig.recording.recorder import record

    runs: dict[str, Run] = {}
    for mounting, channel in enumerate(("force", "displacement")):
        with _bench(strip, SEED + mounting, stand_in=stand_in) as (bench, rest):
            for waveform, signal in SIGNALS.items():
                rest()
                with progress(f"recording {signal}"):
                    run = record(bench, signal, duration=DURATION, rate=RATE, measured=("current", channel))
                path = folder / f"{channel}-{waveform}.nc"
                # Each signal is recorded twice: by its file a run is distinguished in every table and picture.
                run = replace(run, metadata=replace(run.metadata, source_file=path.name))
                write_run(run, path)
                runs[path.name] = run
                say(f"   {signal:<18} current and {channel:<12} -> {path}")
    return runs


@contextmanager
def _bench(strip: Actuator, seed: int, *, stand_in: bool) -> Iterator[tuple[Bench, Callable[[], None]]]:
    """A bench with the strip in its clamp, and what lets the strip discharge before each signal."""
    from ipmclab.rig.virtual import VirtualBench

    if not stand_in:
        bench = VirtualBench(strip, seed=seed)
        yield bench, bench.plant.rest
        return
    from ipmclab.cli.rig_serve import chassis_of, make_server
    from ipmclab.rig.channels import THESIS_RIG
    from ipmclab.rig.ni import NiBench
    from ipmclab.rig.plant import StripPlant

    rig = replace(THESIS_RIG, virtual=replace(THESIS_RIG.virtual, seed=seed))
    plant = StripPlant(rig, strip)
    name, modules = chassis_of(rig)
    chassis, server = make_server(plant, name, modules, port=0, clock="lock-step", faults=(), levels=None)

    def rest() -> None:
        with chassis.lock:
            chassis.advance()
            plant.rest()

    address = server.start()
    try:
        yield NiBench(replace(rig, bench="ni", address=address)), rest
    finally:
        server.stop()


def _print_comparison(comparisons: Sequence[Comparison]) -> None:
    for measured in ("force", "displacement"):
        chosen = [row for row in comparisons if row.measured == measured]
        rows = [
            [
                row.figure,
                row.name,
                _BOUNDS[row.qualifier] + read(row.published, row.quantity),
                read(row.model, row.quantity),
                f"{100.0 * row.difference:+.0f} %",
                "" if row.agrees else "differs",
                row.definition,
            ]
            for row in chosen
        ]
        print_table(["figure", f"{measured} runs", "thesis", "model", "difference", "", "the model is read"], rows)


def _comparison_document(row: Comparison) -> dict[str, Any]:
    unit = row.quantity.unit
    return {
        "figure": row.figure,
        "measured": row.measured,
        "quantity": row.name,
        "definition": row.definition,
        "thesis": with_unit(row.published, unit),
        "qualifier": row.qualifier,
        "model": with_unit(row.model, unit),
        "difference_percent": 100.0 * row.difference,
        "agrees": row.agrees,
    }


def _next_steps(folder: Path, report: Path) -> str:
    # Under `uv run` there is no `ipmclab` on the path: what is shown must work when it is copied.
    program = "uv run ipmclab" if "UV_RUN_RECURSION_DEPTH" in os.environ else "ipmclab"
    names = ("fitted.toml", "force-step.nc", "prediction.nc", "prediction.svg")
    fitted, step, predicted, figure = (as_typed(folder / name) for name in names)
    return "\n".join(
        (
            f"Open {report} in a browser. Then try:",
            f"  {program} check {step}",
            f'  {program} simulate {fitted} --signal "sine 1 V 0.5 Hz" --duration "20 s" --rate "50 Hz" '
            f"--out {predicted}",
            f"  {program} plot {predicted} --out {figure}",
        )
    )
