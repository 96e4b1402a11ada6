"""A sitting: what is recorded at the bench without leaving it; the unit in which a campaign is carried out."""

from __future__ import annotations

import zlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from uuid import uuid4

from ipmclab.campaign.blocks import Block, CampaignRun
from ipmclab.campaign.campaign import Campaign
from ipmclab.model import Actuator
from ipmclab.rig.channels import Rig
from ipmclab.rig.experiments.experiment import Experiment


@dataclass(frozen=True)
class Sitting:
    """Some runs of a block, recorded one after the other.

    Parameters
    ----------
    block : Block
    runs : tuple of CampaignRun
    uuids : tuple of str
        One for each run: by it the run is found on the disk, whatever ended the program meanwhile.
    """

    block: Block
    runs: tuple[CampaignRun, ...]
    uuids: tuple[str, ...]

    @property
    def experiment(self) -> Experiment:
        """What the recorder gets."""
        listed = tuple(run.listed(uuid) for run, uuid in zip(self.runs, self.uuids, strict=True))
        signals = tuple(dict.fromkeys(one.signal for one in listed))
        return replace(self.block.experiment, listed=listed, signals=signals)


def sittings_of(campaign: Campaign, blocks: Sequence[Block], done: Collection[str] = ()) -> Iterator[Sitting]:
    """What is to be sat through, without the runs that are done.

    At a virtual bench, and where a strip is clamped for each run, each run is a sitting of its own; else a block is.

    Parameters
    ----------
    campaign : Campaign
    blocks : sequence of Block
    done : collection of str
        The ids of runs that need not be recorded any more.
    """
    alone = campaign.is_virtual or campaign.clamped == "for each run"
    for block in blocks:
        left = [run for run in block.runs if run.id not in done]
        for runs in [[run] for run in left] if alone else [left] if left else []:
            yield sitting(block, runs)


def sitting(block: Block, runs: Sequence[CampaignRun], uuids: Sequence[str] = ()) -> Sitting:
    """A sitting with new uuids where none are given."""
    return Sitting(block, tuple(runs), tuple(uuids) or tuple(str(uuid4()) for _ in runs))


def experiment_for(campaign: Campaign, one: Sitting, title: str) -> Experiment:
    """The experiment of a sitting with what its campaign adds: title and rig, and the mounting of a virtual strip."""
    block = one.block
    mounting = None
    if campaign.is_virtual:  # nobody takes its strip out of the clamp
        # A block is known by its first run: its number moves where the campaign grows.
        first = one.runs[0] if campaign.clamped == "for each run" else block.runs[0]
        mounting = f"virtual-{zlib.crc32(f'{campaign.title}/{first.id}'.encode()):08x}"
    rig = "virtual" if isinstance(campaign.rig_file, str) else campaign.rig_file
    return replace(one.experiment, title=title, rig=rig, mounting_id=one.experiment.mounting_id or mounting)


def virtual_rig(campaign: Campaign, one: Sitting, failures: Mapping[str, int]) -> tuple[Rig, Actuator | None]:
    """The rig of a sitting at a virtual bench, and the strip in it.

    Its noise depends on the campaign's seed, the run and how often it failed its checks, and on nothing that was
    recorded before: a campaign that was interrupted anywhere gives the same readings.
    """
    run, block = one.runs[0], one.block
    seed = zlib.crc32(f"{campaign.seed}/{run.id}/{failures.get(run.id, 0)}".encode())
    # In the room a strip dries from when it left its water; a chamber is waited for until it holds.
    virtual = replace(campaign.rig.virtual, seed=seed, hydrated=not block.experiment.environments)
    if block.experiment.environments:
        air = block.experiment.environments[0]
        if air.temperature is not None:
            virtual = replace(virtual, temperature=air.temperature)
        if air.relative_humidity is not None:
            virtual = replace(virtual, relative_humidity=air.relative_humidity)
    strip = block.strip.virtual(run.measured, run.label, run.condition)
    return replace(campaign.rig, virtual=virtual), strip
