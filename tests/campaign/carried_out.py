"""Campaigns at the virtual bench, carried out in this process: without the report that the command line writes."""

from pathlib import Path

from ipmclab.campaign.blocks import blocks_of
from ipmclab.campaign.campaign import Campaign
from ipmclab.campaign.conduct import Conduct, Sit
from ipmclab.campaign.state import State
from ipmclab.cli.sitting import at_virtual_bench
from ipmclab.store.journal.laboratory import Laboratory


def begun(campaign: Campaign, folder: Path, state: State, sit: Sit | None = None) -> Conduct:
    """A campaign that has begun, or goes on."""
    laboratory = Laboratory.open(folder)

    def at_bench(sitting, state):
        return at_virtual_bench(campaign, laboratory, sitting, state)

    found = Conduct(campaign, blocks_of(campaign), laboratory, state, sit=sit or at_bench, on_progress=lambda _: None)
    found.begin()
    return found


def carry_out(campaign: Campaign, folder: Path) -> None:
    """All runs of a campaign."""
    folder.mkdir(exist_ok=True)
    with State(folder) as state:
        begun(campaign, folder, state).run()
