"""From runs to a fit with all that is shown with it: profiles, and each run left out.

The answer comes first. What follows can be interrupted, and is asked for where it is costly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, Required, TypedDict, Unpack

from ipmclab.consistency.of_fit import units_off
from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.fit.fit_table import with_findings
from ipmclab.fit.interrupted import NO_PROFILES
from ipmclab.identification.asked import outputs_of_fit
from ipmclab.identification.identify import identify
from ipmclab.identification.problem.free import parse_free
from ipmclab.model import Actuator
from ipmclab.prediction.left_out import leave_one_run_out
from ipmclab.prediction.validate import run_labels
from ipmclab.progress import OnProgress, part, reporting_to
from ipmclab.refitting.profiles import profile
from ipmclab.run import Finding, Run

LONG: Final = 10_000
"""Rows of all runs together from which profiles, and fits without each run, are costly."""


class Asked(TypedDict, total=False):
    """What ``identify`` takes in addition to an actuator and its runs."""

    free: Required[Sequence[str]]
    per_run: Sequence[str]
    per_mounting: Sequence[str]
    prior: Sequence[str]
    labels: Sequence[str] | None


def fit_of_runs(
    actuator: Actuator,
    runs: Sequence[Run],
    *,
    thorough: bool = True,
    anyway: bool = False,
    progress: OnProgress | None = None,
    **asked: Unpack[Asked],
) -> Fit:
    """Identify, follow the profile of every parameter, and leave out each run where there are several.

    Parameters
    ----------
    actuator : Actuator
    runs : sequence of Run
    thorough : bool
        Follow profiles and leave runs out even where that is costly: with a leak, whose law bends, or 10,000 rows.
    anyway : bool
        Fit even where a unit seems to be off by 1000.
    progress : function of (str, float), optional
        Called with a sentence and the fraction that is done.
    **asked
        ``free``, ``per_run``, ``per_mounting``, ``prior`` and ``labels``, as ``identify`` takes them.

    Returns
    -------
    fit : Fit
        With ``profiles``, and with ``left_out`` where there are two runs or more. Where that was interrupted by Ctrl-C,
        or was costly and not asked for, the fit as it stood, and a finding ``not-followed``.

    Raises
    ------
    InputError
        What ``identify`` refuses; readings whose unit seems to be off by 1000 (``unit-off``).

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> fit = fit_of_runs(strip, [simulate(strip, "step 1 V", duration=10, rate=20)], free=["circuit.dc_resistivity"])
    >>> list(fit.profiles), fit.left_out
    (['circuit.dc_resistivity'], ())
    """
    if not anyway:
        _refuse_wrong_units(actuator, runs, asked)
    with reporting_to(progress):
        with part("", 0.0, 0.8):
            fit = identify(actuator, runs, **asked)
        if NO_PROFILES in fit.findings:
            return fit  # who ended its intervals wants no more of them
        if not thorough and _is_costly(actuator, runs):
            return with_findings(fit, [_not_followed("because each run of the model takes long")])
        with part("", 0.8, 0.9):
            fit, done = _unless_interrupted(profile, fit)
        if not done or len(runs) < 2:
            return fit
        with part("", 0.9, 1.0):
            return _unless_interrupted(leave_one_run_out, fit)[0]


def _refuse_wrong_units(actuator: Actuator, runs: Sequence[Run], asked: Asked) -> None:
    """Refuse readings that no strip of these dimensions gives, before any search."""
    names = parse_free(
        actuator.parameter_values, asked["free"], asked.get("per_run", ()), asked.get("per_mounting", ())
    )
    labels = asked.get("labels") or run_labels(runs)
    for label, run in zip(labels, runs, strict=False):
        for finding in units_off(actuator, run, outputs_of_fit(names)):
            raise InputError(
                finding.message,
                code=finding.code,
                where=label,
                repair=f"{finding.repair}. To fit these readings as they are: identify --anyway",
            )


def _is_costly(actuator: Actuator, runs: Sequence[Run]) -> bool:
    return bool(actuator.structure.leak) or sum(len(run) for run in runs) >= LONG


def _unless_interrupted(follow: Callable[[Fit], Fit], fit: Fit) -> tuple[Fit, bool]:
    """The fit with what follows, or as it stood; and whether it was let run to its end."""
    try:
        return follow(fit), True
    except KeyboardInterrupt:
        return with_findings(fit, [_not_followed("because the fit was interrupted")]), False


def _not_followed(why: str) -> Finding:
    return Finding(
        "not-followed",
        "info",
        f"profiles of the parameters, or fits without each run, are not there, {why}: values and intervals are valid "
        "without them",
        "identify with --thorough, and let it run to its end, to have them in the report",
    )
