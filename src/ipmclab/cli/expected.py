"""What is expected of proposed runs, as ``ipmclab next`` prints it of a fit and of each sample of a campaign."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ipmclab.cli.output import print_paragraph, print_table, significant

if TYPE_CHECKING:
    from ipmclab.planning.proposal import Expected, Proposal

AIMS = {
    "parameters": "narrows the joint interval of the parameters",
    "prediction": "lowers the error of the prediction",
    "model": "distinguishes the model from its rival",
}
"""What each run of a plan does most, by the goal that it is for."""


def print_expected(proposal: Proposal) -> None:
    """Print each parameter with its interval now and after the runs."""
    print_table(
        ["parameter", "value", "95 % interval now", "after these runs", "unit"],
        [
            [one.name, significant(one.value, 4), _interval(one, now=True), _interval(one, now=False), one.unit]
            for one in proposal.expected
        ],
    )
    if proposal.draws:
        print_paragraph(
            f"Gains are averages over {proposal.draws} values that the strip may have, intervals are the middle ones."
        )


def _interval(one: Expected, *, now: bool) -> str:
    if not (one.determined_before if now else one.determined_after):
        return "not determined"
    low, high = one.interval_before if now else one.interval_after
    # As many digits as tell the ends apart.
    digits = 4
    while digits < 8 and significant(low, digits) == significant(high, digits):
        digits += 1
    return f"{significant(low, digits)} to {significant(high, digits)}"
