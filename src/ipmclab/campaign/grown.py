"""Further experiments at the end of a campaign file: what is in it already stays as it is."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from ipmclab.campaign.blocks import blocks_of
from ipmclab.campaign.campaign import Campaign
from ipmclab.campaign.campaign_file import campaign_from_text
from ipmclab.campaign.planned import plan_campaign
from ipmclab.campaign.state import State
from ipmclab.destination import write_text
from ipmclab.errors import InputError
from ipmclab.model.environment import Environment
from ipmclab.planning.strips import StripsProposal
from ipmclab.toml_file import parse_table
from ipmclab.version import __version__

_NOT_OF_THE_NEW: Final = (
    "name",
    "samples",
    "signal",
    "signals",
    "duration",
    "repeats",
    "pair",
    "baseline",
    "reference",
)
_LIST: Final = re.compile(r'\[\n((?:    "[^"\n]*",\n)+)\]')
_NAME: Final = re.compile(r"next-(\d+)")


def lines_of(campaign: Campaign, proposal: StripsProposal, conditions: Mapping[str, str]) -> str:
    """Proposed runs as experiments of a campaign file (TOML).

    Each is recorded as the experiment of which it is: what its table says is in the new one too.

    Parameters
    ----------
    campaign : Campaign
    proposal : StripsProposal
    conditions : mapping of sample to str
        Where a run without a condition of its own is recorded.
    """
    import tomli_w

    table = parse_table(campaign.text, where=campaign.where)
    parts = {part.name: one for part, one in zip(campaign.parts, table["experiments"], strict=True)}
    visited = {part.name: next(iter(part.experiments.values())).environments for part in campaign.parts}
    many = {name: [one.name for one in each] if len(each) > 1 else [] for name, each in visited.items()}
    numbers = [int(found[1]) for part in campaign.parts if (found := _NAME.fullmatch(part.name))]
    counts = Counter((sample, run.experiment, run.candidate) for sample, run in proposal.runs)
    said = []
    for place, ((sample, experiment, candidate), count) in enumerate(counts.items(), max(numbers, default=0) + 1):
        source = {key: value for key, value in parts[experiment].items() if key not in _NOT_OF_THE_NEW}
        new: dict[str, Any] = {"name": f"next-{place}", "samples": [sample], "signals": [str(candidate.signal)]}
        once = {"repeats": count, "pair": False, "baseline": False}
        elsewhere = {*table.get("method", {}), *(once if "file" in source else ())}
        once = {key: value for key, value in once.items() if key in elsewhere or value > 1}
        new |= {"duration": f"{candidate.duration:g} s", **once, **source}
        if many[experiment]:  # of one condition its table is the source's
            own = candidate.condition
            new["environments"] = [conditions[sample] or many[experiment][0] if own is None else _condition(own)]
        said.append(_LIST.sub(_in_one_line, tomli_w.dumps({"experiments": [new]})))
    return "\n".join(said)


def _in_one_line(found: re.Match[str]) -> str:
    return f"[{found[1].strip().rstrip(',')}]".replace("\n    ", " ")


def _condition(condition: Environment) -> str:
    return f"{condition.temperature:g} degC, {condition.relative_humidity:g} percent"


def grown(campaign: Campaign, path: Path, lines: str) -> Campaign:
    """The campaign with further experiments, checked as its file will be; nothing is written.

    Parameters
    ----------
    campaign : Campaign
    path : Path
        Its file.
    lines : str
        As ``lines_of`` gives them.

    Raises
    ------
    InputError
        What ``load_campaign`` or its plan refuses.
    """
    text = f"{campaign.text.rstrip()}\n\n# What ipmclab next proposed.\n{lines}"
    found = campaign_from_text(text, folder=path.parent, where=campaign.where, name=path.stem)
    plan_campaign(found, bytes_free=10**15)
    return found


def append(campaign: Campaign, path: Path, folder: Path | None, lines: str) -> Campaign:
    """Write further experiments at the end of a campaign file, and record it in the campaign's log.

    Parameters
    ----------
    campaign : Campaign
    path : Path
        Its file.
    folder : Path, optional
        Where it is carried out: the same command continues there.
    lines : str

    Raises
    ------
    InputError
        The file was changed since it was read; the campaign is being carried out; what ``grown`` refuses.
    """
    if path.read_text(encoding="utf-8-sig") != campaign.text:
        raise InputError(
            "the file was changed meanwhile", code="changed-file", where=str(path), repair="give the same command again"
        )
    found = grown(campaign, path, lines)
    if folder is None:
        write_text(found.text, path, overwrite=True)
        return found
    with State(folder) as state:
        write_text(found.text, path, overwrite=True)
        plan = [run.id for block in blocks_of(found) for run in block.runs]
        about = {"title": found.title, "checksum": found.checksum}
        state.add("campaign", **about, version=__version__, plan=plan, text=found.text)
    return found
