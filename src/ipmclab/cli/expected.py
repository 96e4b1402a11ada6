"""What is expected of proposed runs, as ``ipmclab next`` prints it of a fit and of each sample of a campaign."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ipmclab.cli.output import print_paragraph, print_table

if TYPE_CHECKING:
    from ipmclab.planning.proposal import Proposal


def print_expected(proposal: Proposal) -> None:
    """Print each parameter with its interval now and after the runs."""
    from ipmclab.planning.proposal_words import HOW, interval, of_draws, value

    print_table(
        ["parameter", "value", "95 % interval now", "after these runs", "unit"],
        [
            [one.name, value(one), interval(one, now=True), interval(one, now=False), one.unit]
            for one in proposal.expected
        ],
    )
    print_paragraph(HOW)
    if line := of_draws(proposal):
        print_paragraph(line)
