"""``ipmclab characterise``: a campaign, from its plan to its report."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from ipmclab.cli.options import Answer, Json, Yes, answers_in
from ipmclab.cli.output import print_json, print_paragraph, print_table, progress, read
from ipmclab.cli.record_view import View, duration_text, size_text
from ipmclab.errors import InputError

if TYPE_CHECKING:
    from ipmclab.campaign.campaign import Campaign
    from ipmclab.campaign.conduct import Sat
    from ipmclab.campaign.planned import CampaignPlan
    from ipmclab.campaign.sitting import Sitting
    from ipmclab.campaign.state import State
    from ipmclab.store.journal.laboratory import Laboratory

REPORT: Final = "report.html"
METRICS: Final = "metrics.csv"
REPEATS: Final = "repeats.csv"
COMPARISON: Final = "comparison.html"


def characterise(
    campaign: Annotated[
        str | None,
        typer.Argument(
            metavar="CAMPAIGN",
            help="A campaign file (.toml), or friend-chapter-5: chapter 5 of the thesis.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Where runs, state and report go; in a folder that has them already, the campaign continues where it "
            "stopped.",
            show_default=False,
        ),
    ] = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Print every run with its time and what the guard watches; do nothing.")
    ] = False,
    yes: Yes = False,
    answer: Answer = None,
    template: Annotated[bool, typer.Option("--template", help="Print a campaign file to start from.")] = False,
    as_json: Json = False,
) -> None:
    """Characterise samples: plan a campaign, record it, and write its report.

    A virtual bench runs in lock-step; a real one is driven as by ipmclab record, with its prompts. The same
    command continues where an earlier one stopped, whatever stopped it.

    \b
    ipmclab characterise friend-chapter-5 --plan
    ipmclab characterise campaign.toml --out chapter-5
    """
    from ipmclab.campaign.campaign_file import load_campaign
    from ipmclab.campaign.template import TEMPLATE

    if template:
        if as_json:
            print_json({"template": TEMPLATE})
        else:
            print(TEMPLATE, end="")
        return
    if campaign is None:
        raise InputError(
            "no campaign is named",
            code="usage",
            where="characterise",
            repair="ipmclab characterise CAMPAIGN.toml --plan; --template prints a campaign to start from",
        )
    loaded = load_campaign(campaign)
    if plan:
        _print_plan(loaded, out or Path(), as_json=as_json)
        return
    if out is None:
        raise InputError(
            "no folder is named",
            code="missing-option",
            where="--out",
            repair="give --out FOLDER, or --plan to see what would happen",
        )
    _carry_out(loaded, campaign, out, yes=yes, answers=answers_in(answer or [], example="clamp=done"), as_json=as_json)


def _plan(campaign: Campaign, folder: Path) -> CampaignPlan:
    from ipmclab.campaign.planned import plan_campaign

    there = next((one for one in (folder, folder.parent) if one.is_dir()), Path())
    with progress(f"planning {campaign.title}"):
        return plan_campaign(campaign, bytes_free=shutil.disk_usage(there).free)


def _print_plan(campaign: Campaign, folder: Path, *, as_json: bool) -> None:
    planned = _plan(campaign, folder)
    if as_json:
        print_json(planned.as_dict())
        return
    order = f"randomised with seed {campaign.seed}" if campaign.order == "randomised" else "as listed"
    print(f"{campaign.title}: {len(campaign.strips)} samples on {campaign.rig.name}, order {order}")
    rows = [
        [
            str(one.run.number),
            duration_text(one.starts),
            duration_text(one.seconds),
            one.run.sample,
            one.run.part,
            one.run.condition,
            one.run.label,
            str(one.run.planned.repeat),
        ]
        for one in planned.runs
    ]
    print_table(["run", "after", "takes", "sample", "experiment", "condition", "signal", "repeat"], rows)
    for text, where in planned.watched().items():
        print_paragraph(f"The guard watches{f' in {where}' if where else ''}: {text}.")
    for text in planned.questions if not campaign.is_virtual else ():
        print_paragraph(f"A person is asked: {text}.")
    for text in planned.remarks:
        print_paragraph(f"Remark: {text}.")
    print_paragraph(
        f"In all {len(planned.runs)} runs in {len(planned.blocks)} blocks, at least {duration_text(planned.seconds)} "
        f"at a bench; needs {size_text(planned.bytes_needed)}."
    )


def _carry_out(
    campaign: Campaign, file: str, folder: Path, *, yes: bool, answers: dict[str, str], as_json: bool
) -> None:
    from ipmclab.campaign.conduct import Conduct, refuse_ended
    from ipmclab.campaign.state import State
    from ipmclab.cli.recorder import recover_first
    from ipmclab.store.journal.laboratory import Laboratory

    planned = _plan(campaign, folder)  # whatever cannot be done is reported before anything moves
    laboratory = Laboratory.open(folder)
    view = View(quiet=as_json, keys=sys.stdin.isatty())
    options = {"file": file, "yes": yes, "answers": answers, "keys": sys.stdin.isatty() and sys.stderr.isatty()}

    def say(text: str) -> None:
        if not as_json:
            print(text, flush=True)

    with State(laboratory.root) as state:
        _refuse_own_files(laboratory.root, state)
        joined = None if campaign.is_virtual else _join(laboratory, view)
        for text in recover_first(laboratory):
            say(f"  {text}")
        sit = _sit(campaign, laboratory, view, options)
        conduct = Conduct(campaign, planned.blocks, laboratory, state, sit=sit, on_progress=say)
        conduct.begin()
        if joined is not None:
            refuse_ended(joined, where=str(folder))
        done = len(planned.runs) - conduct.left
        say(f"{campaign.title}: {len(planned.runs)} runs" + (f", {done} of them done already" if done else ""))
        _ask_facts(campaign, state, say)
        conduct.run()
        _finish(campaign, planned, folder, state, as_json=as_json)


def _sit(campaign: Campaign, laboratory: Laboratory, view: View, options: dict[str, Any]) -> Any:
    """What carries a sitting out: a virtual bench in this process, a real one by a recorder."""
    from ipmclab.cli.sitting import at_virtual_bench, by_recorder

    def sit(sitting: Sitting, state: State) -> Any:
        if campaign.is_virtual:
            return at_virtual_bench(campaign, laboratory, sitting, state)
        return by_recorder(campaign, laboratory, sitting, view, options)

    return sit


def _refuse_own_files(folder: Path, state: State) -> None:
    """Refuse a folder in which what a campaign writes would take the place of somebody's own file."""
    for name in (METRICS, REPEATS, COMPARISON, REPORT) if not state.of("campaign") else ():
        if (folder / name).exists():
            raise InputError(
                "the file exists already, and no campaign was carried out in this folder",
                code="file-exists",
                where=str(folder / name),
                repair="name another folder, or move that file away",
            )


def _join(laboratory: Laboratory, view: View) -> Sat | None:
    """A recorder that outlived the command which started it is followed to its end first; None where none runs."""
    from ipmclab.cli.sitting import follow
    from ipmclab.rig.process.client import attach

    try:
        recorder = attach(laboratory.root)
    except InputError:
        return None
    return follow(recorder, view, joined=True)


def _ask_facts(campaign: Campaign, state: State, say: Any) -> None:
    """At a real bench: ask for the masses and the stiffness, and read the four probes."""
    if campaign.is_virtual or not campaign.facts:
        return
    if not sys.stdin.isatty():
        say(f"  not measured, for nobody is at a terminal: {', '.join(campaign.facts)}")
        return
    from ipmclab.cli.facts import asked_facts

    for strip in campaign.strips:
        known = {one["name"]: one["value"] for one in state.of("fact") if one["sample"] == strip.sample.id}
        for fact in asked_facts(campaign, strip, known):
            state.add("fact", sample=strip.sample.id, **fact.as_dict())


def _finish(campaign: Campaign, planned: CampaignPlan, folder: Path, state: State, *, as_json: bool) -> None:
    """Measure what was recorded, write tables and report, and say what came of it."""
    from ipmclab.campaign.identified import identify_samples
    from ipmclab.campaign.published import reproduced
    from ipmclab.campaign.results import by_repeat, comparable, less_drift, read_results, write_metrics, write_repeats
    from ipmclab.comparison.compare import compare
    from ipmclab.reporting.campaign import report_campaign
    from ipmclab.reporting.comparison import write_comparison

    with progress("measuring the runs"):
        results = read_results(folder, planned.blocks, state.recorded)
        metrics = write_metrics(results, folder / METRICS)
        printed = reproduced(by_repeat(results))
    with progress("identifying the samples") as tell:
        models = identify_samples(campaign, folder, results, state, on_progress=tell)
    comparison = None
    with progress("holding the runs side by side"):
        if kept := comparable(results):
            comparison = compare(kept, strips=campaign.models)
            write_comparison(
                comparison, folder / COMPARISON, command=f"ipmclab characterise {campaign.where}", overwrite=True
            )
        without = results if comparison is None else less_drift(results, comparison)
        repeats = write_repeats(by_repeat(without), folder / REPEATS)
    with progress("writing the report"):
        report = report_campaign(
            campaign,
            planned.blocks,
            results,
            state.events,
            folder / REPORT,
            comparison=comparison,
            models=models,
            overwrite=True,
        )
    flagged = [name for name, one in state.recorded.items() if one["verdict"] == "flagged"]
    again = sum(one["verdict"] == "repeat" for one in state.of("recorded"))
    agree = sum(one.agrees for one in printed)
    if as_json:
        print_json(
            {
                "out": folder,
                "runs": [{"id": name, **one} for name, one in state.recorded.items()],
                "flagged": flagged,
                "repeated": again,
                "metrics": metrics,
                "repeats": repeats,
                "report": report,
                "comparison": folder / COMPARISON if comparison is not None else None,
                "models": [
                    {"sample": one.sample, "fit": one.path, "scores": one.scores, "failure": one.failure or None}
                    for one in models
                ],
                "published": {"numbers": len(printed), "within_tolerance": agree},
            }
        )
        return
    print(
        f"{_so_many(len(state.done), 'run is', 'runs are')} recorded, {_so_many(again, 'was', 'were')} repeated, "
        f"{_so_many(len(flagged), 'is', 'are')} flagged"
    )
    for name in flagged:
        print(f"  flagged: {name}")
    if printed:
        print(f"of {len(printed)} published numbers {agree} are met within their tolerance")
        for one in printed:
            if not one.agrees:
                text = f"{read(one.mean, one.quantity)} against {read(one.number, one.quantity)}"
                print(f"  outside: figure {one.published.figure}, {one.published.metric}: {text}")
    for one_model in models:
        print_paragraph(str(one_model))
    print(f"{metrics}\n{repeats}\n{report}")


def _so_many(count: int, one: str, several: str) -> str:
    return f"{count} {one if count == 1 else several}"
