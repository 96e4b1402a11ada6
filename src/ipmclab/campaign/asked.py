"""What a recorder in its own process is asked for: a sitting, as its job tells of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ipmclab.campaign.blocks import blocks_of
from ipmclab.campaign.campaign_file import load_campaign
from ipmclab.campaign.sitting import Sitting, experiment_for
from ipmclab.rig.experiments.experiment import Experiment


def asked(sitting: Sitting, folder: Path, title: str) -> dict[str, Any]:
    """A sitting as a part of a job: what JSON can hold."""
    runs = {run.id: uuid for run, uuid in zip(sitting.runs, sitting.uuids, strict=True)}
    return {"folder": str(folder), "title": title, "block": sitting.block.number, "runs": runs}


def experiment_asked_for(file: str, told: Mapping[str, Any]) -> Experiment:
    """The experiment of a sitting, in the recorder's process.

    Parameters
    ----------
    file : str
        The campaign, as it was named.
    told : mapping
        What ``asked`` gave.

    Raises
    ------
    InputError
        What ``load_campaign`` refuses.
    """
    campaign = load_campaign(file)
    block = blocks_of(campaign)[told["block"] - 1]
    known = {run.id: run for run in block.runs}
    sitting = Sitting(block, tuple(known[name] for name in told["runs"]), tuple(told["runs"].values()))
    experiment = experiment_for(campaign, sitting, told["title"])
    return replace(experiment, folder=Path(told["folder"]), where=f"{file}: {block.part}")
