"""``ipmclab next CAMPAIGN``: the runs of a campaign's samples that would give most information, and the file that
requests them."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ipmclab.cli.expected import print_expected
from ipmclab.cli.output import print_json, print_paragraph, print_remarks, print_table, progress, significant
from ipmclab.errors import InputError
from ipmclab.platform import as_typed
from ipmclab.toml_file import glance

if TYPE_CHECKING:
    from ipmclab.planning.strips import StripsProposal


@dataclass(frozen=True)
class OfCampaign:
    """The campaign that is asked, and what is to become of the answer.

    Parameters
    ----------
    file : str
        Its file, or its name in the library.
    folder : Path, optional
        Where its runs are.
    fits : tuple of Path
    free : tuple of str
    append, yes : bool
        Whether the runs are written at the end of the file, and whether without asking.
    """

    file: str
    folder: Path | None
    fits: tuple[Path, ...]
    free: tuple[str, ...]
    append: bool
    yes: bool


def is_campaign(file: str) -> bool:
    """Whether a file is a campaign, or this is the name of one in the library; else it should be a fit."""
    from ipmclab.campaign.campaign_file import library_campaigns

    path = Path(file)
    if not path.is_file():
        return file.removesuffix(".toml") in library_campaigns()
    table = glance(path)
    return table is not None and "experiments" in table and "samples" in table


def print_next(of: OfCampaign, wishes: Mapping[str, Any], asked: Mapping[str, Any], *, as_json: bool) -> None:
    """Propose the next runs of a campaign, print them, and write them into its file where that is wanted.

    Parameters
    ----------
    of : OfCampaign
    wishes : mapping
        Of ``campaign.next_runs.Wishes``.
    asked : mapping
        Goal, time and the rest, as ``propose_for_campaign`` takes them.
    as_json : bool
    """
    from ipmclab import read_fit
    from ipmclab.campaign.campaign_file import load_campaign
    from ipmclab.campaign.grown import append
    from ipmclab.campaign.next_runs import Wishes, propose_for_campaign

    campaign = load_campaign(of.file)
    folder = of.folder or _usual_folder(of.file)
    if folder is None and not of.fits:
        raise InputError(
            "no folder is named in which the runs of the campaign are",
            code="missing-option",
            where="--folder",
            repair="give --folder FOLDER, the one that characterise --out named, or fits of its samples (--fit)",
        )
    _refuse_append(of, as_json=as_json)
    with progress("reading the runs") as tell:
        found = propose_for_campaign(
            campaign,
            folder,
            fits=[read_fit(path) for path in of.fits],
            free=of.free,
            wishes=Wishes(**wishes),
            on_progress=lambda text: tell(text, 0.0),
            **asked,
        )
    if not as_json:
        _print(found.proposal, found.lines, float(asked["minutes"]))
    written = of.append and (of.yes or _agreed(of.file))
    if written:
        append(campaign, Path(of.file), folder, found.lines)
    if as_json:
        print_json(
            {
                "campaign": of.file,
                **found.proposal.to_table(),
                "lines": found.lines,
                "appended_to": of.file if written else None,
            }
        )
    elif written:
        where = f" --out {as_typed(folder)}" if folder is not None else ""
        print(f"wrote {of.file}: ipmclab characterise {as_typed(of.file)}{where} records them")
    elif not of.append:
        print_paragraph(
            f"These lines at the end of {of.file} make them part of the campaign; --append writes them there, and "
            "ipmclab characterise then continues in the same folder."
        )


def _usual_folder(file: str) -> Path | None:
    """The folder next to a campaign file that has its name and holds a campaign."""
    from ipmclab.campaign.state import FILE

    path = Path(file)
    folder = path.with_suffix("")
    return folder if folder != path and (folder / FILE).is_file() else None


def _refuse_append(of: OfCampaign, *, as_json: bool) -> None:
    """Before the work: whether the file can be written, and whether there is somebody to ask."""
    if of.append and not Path(of.file).is_file():
        raise InputError(
            "a campaign of the library stays as it is",
            code="usage",
            where="--append",
            repair="leave --append out, and put the lines at the end of a file of your own",
        )
    if of.append and not (of.yes or (sys.stdin.isatty() and not as_json)):
        raise InputError(
            "nobody can be asked whether the file may be changed",
            code="usage",
            where="--append",
            repair="give --yes too, or leave --append out: the lines are printed",
        )


def _agreed(file: str) -> bool:
    return input(f"write these lines at the end of {file}? [y/N] ").strip().lower() in ("y", "yes")


def _print(proposal: StripsProposal, lines: str, minutes: float) -> None:
    from ipmclab.cli.record_view import duration_text
    from ipmclab.planning.proposal_words import of_time

    rows = []
    for sample, run in proposal.runs:
        one = run.candidate
        where = "as it was" if one.condition is None else str(one.condition)
        rows.append(
            [
                str(run.number),
                sample,
                run.experiment,
                str(one.signal),
                f"{one.duration:g} s",
                where,
                duration_text(run.time),
                f"{significant(run.gain, 2)} ({significant(run.gain_per_minute, 2)}/min)",
            ]
        )
    print_table(["run", "sample", "as", "signal", "for", "condition", "on the bench", "gain [nats]"], rows)
    print_paragraph(of_time(proposal, minutes, among="over all samples"))
    for sample, of_sample in proposal.of.items():
        print(f"\n{sample}: {len(of_sample.runs)} of the runs")
        print_expected(of_sample)
    said = [f"run {run.number}: {text}" for _, run in proposal.runs for text in run.remarks]
    said += [f"{sample}: {text}" for sample, each in proposal.of.items() for text in each.remarks]
    print_remarks([*said, *proposal.remarks])
    print()
    print(lines, end="")
