"""Fits without what a test does not look at: it takes half of their time, and moves no number of theirs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ipmclab import Actuator, Fit, Run
from ipmclab.identification.identify import identify_freed, with_priors
from ipmclab.identification.problem.free import parse_free


def brief(
    actuator: Actuator,
    runs: Sequence[Run] | Run,
    free: str | Iterable[str] = "electrical",
    *,
    per_run: str | Iterable[str] = (),
    per_mounting: str | Iterable[str] = (),
    prior: str | Iterable[str] = (),
    diagnosed: bool = False,
    followed: bool = True,
) -> Fit:
    """What ``identify`` finds: what the model lacks only where ``diagnosed``, bent intervals only where ``followed``.

    ``tests/identification/test_brief.py`` holds that all else is the same.
    """
    given = [runs] if isinstance(runs, Run) else runs
    names = with_priors(actuator, parse_free(actuator.parameter_values, free, per_run, per_mounting), prior)
    return identify_freed(actuator, given, names, None, diagnosed=diagnosed, followed=followed)
