"""What a recorder in its own process is asked for: a sitting, as its job describes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ipmclab.campaign.blocks import blocks_of
from ipmclab.campaign.campaign_file import load_campaign
from ipmclab.campaign.sitting import Sitting, experiment_for
from ipmclab.errors import InputError
from ipmclab.rig.experiments.experiment import Experiment


def asked(sitting: Sitting, folder: Path, title: str, checksum: str) -> dict[str, Any]:
    """A sitting as a part of a job: what JSON can hold; the checksum is that of its campaign."""
    runs = {run.id: uuid for run, uuid in zip(sitting.runs, sitting.uuids, strict=True)}
    about = {"folder": str(folder), "title": title, "checksum": checksum}
    return {**about, "block": sitting.block.number, "runs": runs}


def experiment_asked_for(file: str, table: Mapping[str, Any]) -> Experiment:
    """The experiment of a sitting, in the recorder's process.

    Parameters
    ----------
    file : str
        The campaign, as it was named.
    table : mapping
        What ``asked`` gave.

    Raises
    ------
    InputError
        What ``load_campaign`` refuses; a campaign that is not the one that was begun.
    """
    campaign = load_campaign(file)
    if campaign.checksum != table["checksum"]:
        raise InputError(
            "the campaign, or a file that it names, was changed while it is carried out",
            code="another-campaign",
            where=file,
            repair="give it as it was, or begin the changed one in another folder",
        )
    block = blocks_of(campaign)[table["block"] - 1]
    known = {run.id: run for run in block.runs}
    sitting = Sitting(block, tuple(known[name] for name in table["runs"]), tuple(table["runs"].values()))
    experiment = experiment_for(campaign, sitting, table["title"])
    return replace(experiment, folder=Path(table["folder"]), where=f"{file}: {block.part}")
