"""What is said of proposed runs, on the terminal and on the page alike."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from ipmclab.units import significant

if TYPE_CHECKING:
    from ipmclab.planning.proposal import Expected, Proposal
    from ipmclab.planning.strips import StripsProposal

HOW: Final = (
    "Both intervals come from standard errors, so that they compare. Those of the fit follow what its readings allow "
    "and can be wider."
)
"""What the intervals of a proposal are."""

AIMS: Final = {
    "parameters": "narrows the joint interval of the parameters",
    "prediction": "lowers the error of the prediction",
    "model": "distinguishes the model from its rival",
}
"""What each run of a plan does most, by the goal that it is for."""


def of_time(proposal: Proposal | StripsProposal, minutes: float, *, among: str = "") -> str:
    """How much of the time the runs take, and why it is these; ``among`` says of how many samples."""
    most = ", ".join(text for text in ("most for its time", among, "after those before it") if text)
    return (
        f"{len(proposal.runs)} runs take {proposal.time / 60.0:.3g} of {minutes:g} min, with rests. Each is the one "
        f"that {AIMS[proposal.goal]} {most}."
    )


def of_goal(proposal: Proposal) -> Iterator[str]:
    """What becomes of predictions, and of rivals of the model."""
    said = [f"{name} {_percent(before)} to {_percent(after)}" for name, (before, after) in proposal.predicted.items()]
    yield f"Error of what is predicted for the inputs, of the size of the answer: {', '.join(said)}."
    for name, (first, last) in proposal.evidence.items():
        least = proposal.shows.get(name, {})
        if least:
            amounts = ", ".join(f"{key} of {significant(value, 2)} {unit}" for key, (value, unit) in least.items())
            yield f"These runs would show a stage {name} from {amounts} on, at two standard errors."
        elif name not in proposal.shows:
            yield (
                f"If {name} is true, the first run shows it by {significant(first, 2)} standard errors, all of them by "
                f"{significant(last, 2)}."
            )


def of_limits(proposal: Proposal) -> str:
    """Which limits runs would have passed; empty where none would."""
    listed = ", ".join(f"{name} {count}" for name, count in proposal.refused.items())
    return f"Of {proposal.tried} runs that were tried some would pass a limit: {listed}." if listed else ""


def of_draws(proposal: Proposal) -> str:
    """Over what gains are averages; empty where they hold at the fitted values."""
    if not proposal.draws:
        return ""
    return f"Gains are averages over {proposal.draws} values that the strip may have, intervals are the middle ones."


def value(one: Expected) -> str:
    """The value that the fit has; a dash where that is not determined."""
    return significant(one.value, 4) if one.determined_before else "-"


def interval(one: Expected, *, now: bool) -> str:
    """The interval of a parameter now, or after the runs, with as many digits as distinguish its ends."""
    if not (one.determined_before if now else one.determined_after):
        return "not determined"
    low, high = one.interval_before if now else one.interval_after
    digits = 4
    while digits < 8 and significant(low, digits) == significant(high, digits):
        digits += 1
    return f"{significant(low, digits)} to {significant(high, digits)}"


def bench_time(seconds: float) -> str:
    """A time at the bench."""
    return f"{seconds / 60.0:.1f} min"


def _percent(part: float) -> str:
    return f"{significant(100.0 * part, 2)} %" if part < 1.0 else "unknown"
