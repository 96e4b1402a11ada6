"""Fits without what a test does not look at: it takes half of their time, and moves no number of theirs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ipmclab import Actuator, Fit, Run
from ipmclab.identification.identify import identify_freed
from ipmclab.identification.problem.free import parse_free


def brief(
    actuator: Actuator,
    runs: Sequence[Run] | Run,
    free: str | Iterable[str] = "electrical",
    *,
    per_run: str | Iterable[str] = (),
    followed: bool = True,
) -> Fit:
    """What ``identify`` finds, but for what the model lacks; bent intervals only where ``followed``.

    ``tests/identification/test_brief.py`` holds that all else is the same.
    """
    given = [runs] if isinstance(runs, Run) else runs
    names = parse_free(actuator.parameter_values, free, per_run)
    return identify_freed(actuator, given, names, None, diagnosed=False, followed=followed)
