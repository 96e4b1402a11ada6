"""``ipmclab next``: the runs that would give most information on a fitted strip for their time on the bench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ipmclab.cli.expected import print_expected
from ipmclab.cli.options import Json, answers_in, positive
from ipmclab.cli.output import print_json, print_paragraph, print_remarks, print_table, progress
from ipmclab.errors import InputError
from ipmclab.units import FREQUENCY, TIME

if TYPE_CHECKING:
    from ipmclab.planning.proposal import Proposal, ProposedRun


def next_(
    fit: Annotated[
        str,
        typer.Argument(
            metavar="FIT|CAMPAIGN",
            help="A fit (.toml) that identify wrote, or a campaign file: then runs of all of its samples are proposed.",
            show_default=False,
        ),
    ],
    goal: Annotated[str, typer.Option(metavar="GOAL", help="parameters, prediction or model.")] = "parameters",
    minutes: Annotated[float, typer.Option(metavar="MIN", help="Time on the bench, in minutes.")] = 15.0,
    limit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="A limit of the rig, such as current='200 mA'. Unless given, the voltage is at most 1.2 V, in a "
            "campaign as much as it applies itself.",
        ),
    ] = None,
    inputs: Annotated[
        list[str] | None,
        typer.Option("--input", metavar="SIGNAL", help="What a prediction is wanted for: 'sine 1 V 0.1 Hz for 40 s'."),
    ] = None,
    condition: Annotated[
        list[str] | None, typer.Option(metavar="CONDITION", help="What a chamber can give: '25 degC, 60 %RH'.")
    ] = None,
    rival: Annotated[
        str | None,
        typer.Option(
            metavar="STAGE|FIT",
            help="The other model to distinguish it from: a stage that it lacks, or a fit of another model.",
        ),
    ] = None,
    rate: Annotated[str | None, typer.Option(metavar="RATE", help="Rows each second, such as '50 Hz'.")] = None,
    rest: Annotated[
        str | None,
        typer.Option(
            metavar="TIME", help="At 0 V with each run. Unless given: 130 s, or what the campaign's plan has."
        ),
    ] = None,
    hydration: Annotated[
        str, typer.Option(metavar="TIME", help="How long the strip lies in water before each run.")
    ] = "0 s",
    wet: Annotated[str | None, typer.Option(metavar="TIME", help="How long the strip stays wet in the air.")] = None,
    soak: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help="How long the strip waits in another condition before its run. Unless given: 30 min, or what the "
            "campaign has.",
        ),
    ] = None,
    longest: Annotated[str, typer.Option(metavar="TIME", help="The longest signal that is proposed.")] = "160 s",
    draws: Annotated[
        int,
        typer.Option(
            metavar="N", help="Average over N sets of values that the fit allows, and not over its own alone."
        ),
    ] = 0,
    posterior: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE.nc", help="Average over these samples, which ipmclab posterior wrote."),
    ] = None,
    folder: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Where characterise put the runs of the campaign.")
    ] = None,
    fits: Annotated[
        list[Path] | None,
        typer.Option(
            "--fit", metavar="FIT", help="A fit of a sample of the campaign; a sample without one is identified here."
        ),
    ] = None,
    free: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAMES", help="What is identified of the samples of a campaign. Unless given: circuit and coupling."
        ),
    ] = None,
    append: Annotated[
        bool, typer.Option("--append", help="Write the runs at the end of the campaign file, after asking.")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Append without asking.")] = False,
    as_json: Json = False,
) -> None:
    """Propose the next runs of a strip, or of a campaign: those that give most information for each minute
    on the bench.

    \b
    ipmclab next fit.toml --minutes 15
    ipmclab next fit.toml --goal prediction --input "sine 1 V 0.2 Hz for 60 s"
    ipmclab next fit.toml --goal model --rival leak.exponential --limit voltage="3 V"
    ipmclab next campaign.toml --folder campaign --minutes 60 --append
    """
    from ipmclab import load_actuator, propose_runs, read_fit
    from ipmclab.cli.next_campaign import OfCampaign, is_campaign, print_next
    from ipmclab.model.environment import Environment
    from ipmclab.planning.candidates import Allowance
    from ipmclab.planning.draws import read_samples
    from ipmclab.planning.propose import INPUTS
    from ipmclab.rig.safety.limits import Limits
    from ipmclab.units import parse_quantity

    limits = answers_in(limit or [], example="voltage='3 V'", option="--limit")
    times = {
        "rest": None if rest is None else parse_quantity(rest, TIME, where="--rest"),
        "soak": None if soak is None else parse_quantity(soak, TIME, where="--soak"),
    }
    given: dict[str, Any] = {
        "longest": positive(longest, TIME, option="--longest"),
        "hydration": parse_quantity(hydration, TIME, where="--hydration"),
        "wet": float("inf") if wet is None else positive(wet, TIME, option="--wet"),
        **{name: value for name, value in times.items() if value is not None},
    }
    other = load_actuator(rival) if rival is not None and rival.endswith(".toml") else rival
    samples = [read_samples(path) for path in posterior or []]
    asked: dict[str, Any] = {"goal": goal, "minutes": minutes, "inputs": inputs or INPUTS, "rival": other}
    if is_campaign(fit):
        _refuse({"--condition": condition, "--rate": rate}, "a campaign states it itself")
        of = OfCampaign(fit, folder, tuple(fits or ()), tuple(free or ()), append=append, yes=yes)
        print_next(of, {"limits": limits, **given}, {**asked, "draws": samples or draws}, as_json=as_json)
        return
    _refuse({"--folder": folder, "--fit": fits, "--free": free, "--append": append}, "it belongs to a campaign file")
    _refuse({"a second --posterior": samples[1:]}, "a fit has one posterior")
    allowed = Allowance(
        limits=Limits.from_table({"voltage": "1.2 V", **limits}, where="--limit"),
        rate=None if rate is None else positive(rate, FREQUENCY, option="--rate"),
        conditions=tuple(Environment.parse(text) for text in condition or []),
        **given,
    )
    with progress("asking the model"):
        proposal = propose_runs(read_fit(fit), allowed=allowed, draws=samples[0] if samples else draws, **asked)
    if as_json:
        print_json({"fit": fit, **proposal.to_table()})
        return
    _print(proposal, minutes)


def _refuse(options: Mapping[str, object], why: str) -> None:
    for name, value in options.items():
        if value:
            raise InputError(f"{name} has no place here: {why}", code="usage", where=name, repair=f"leave {name} out")


def _print(proposal: Proposal, minutes: float) -> None:
    from ipmclab.planning.proposal_words import bench_time, of_goal, of_limits, of_time

    print_table(
        ["run", "signal", "for", *_where(proposal.runs), "rate", "on the bench"],
        [
            [str(place), *_cells(run, proposal.runs), f"{run.rate:.4g} Hz", bench_time(run.time)]
            for place, run in enumerate(proposal.runs, 1)
        ],
    )
    print_paragraph(of_time(proposal, minutes))
    print()
    print_expected(proposal)
    for text in of_goal(proposal):
        print_paragraph(text)
    print()
    print_table(
        ["best of its kind, as the next run", "for", *_where(proposal.best_of_kind), "on the bench", "of the best"],
        [
            [*_cells(run, proposal.best_of_kind), bench_time(run.time), _part(run, proposal.best_of_kind[0])]
            for run in proposal.best_of_kind
        ],
    )
    if line := of_limits(proposal):
        print_paragraph(line)
    print_remarks([f"run {place}: {text}" for place, run in enumerate(proposal.runs, 1) for text in run.remarks])
    print_remarks(proposal.remarks)


def _where(runs: Sequence[ProposedRun]) -> list[str]:
    return ["at"] if any(run.candidate.condition is not None for run in runs) else []


def _cells(run: ProposedRun, runs: Sequence[ProposedRun]) -> list[str]:
    one = run.candidate
    return [str(one.signal), f"{one.duration:g} s", *([str(one.condition)] if _where(runs) else [])]


def _part(run: ProposedRun, best: ProposedRun) -> str:
    return f"{100.0 * run.gain_per_minute / best.gain_per_minute:.0f} %" if best.gain_per_minute > 0.0 else "-"
