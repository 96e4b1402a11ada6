"""Which runs a campaign should record next: those that give most information on what is not known yet of its
samples."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from ipmclab.campaign.blocks import CampaignRun
from ipmclab.campaign.campaign import ROOM, Campaign
from ipmclab.campaign.grown import lines_of
from ipmclab.campaign.known import KnownSample, OnProgress, has_laws, known_of, recorded_runs
from ipmclab.campaign.planned import plan_campaign
from ipmclab.campaign.state import MODELS
from ipmclab.errors import InputError
from ipmclab.fit.fit import Fit
from ipmclab.model.environment import Environment
from ipmclab.planning.candidates import Allowance
from ipmclab.planning.draws import Samples
from ipmclab.planning.goals import GoalName
from ipmclab.planning.strips import StripsProposal, propose_for_strips
from ipmclab.rig.experiments.experiment import Experiment
from ipmclab.rig.safety.limits import Limits

BELOW_ELECTROLYSIS: Final = 1.2
"""Largest amplitude [V] that is proposed, unless the campaign itself applies more or a limit is named."""

_ENOUGH: Final = 10**15  # bytes: a plan for the times of its runs needs no disk


@dataclass(frozen=True)
class Wishes:
    """What is asked for otherwise than the campaign has it.

    Parameters
    ----------
    limits : mapping of name to text
        In the place of those of the file.
    longest : float [s]
        Of a signal.
    rest, soak : float [s], optional
        With each run, and before one in another condition; as the campaign is planned where they are left out.
    hydration, wet : float [s]
        In water before each run; how long the strip stays wet.
    """

    limits: Mapping[str, str] = field(default_factory=dict)
    longest: float = 160.0
    rest: float | None = None
    soak: float | None = None
    hydration: float = 0.0
    wet: float = math.inf


@dataclass(frozen=True, eq=False)
class NextRuns:
    """What a campaign should record next.

    Parameters
    ----------
    proposal : StripsProposal
    lines : str
        The runs as further experiments of the campaign file (TOML).
    """

    proposal: StripsProposal
    lines: str


def propose_for_campaign(
    campaign: Campaign,
    folder: Path | None,
    *,
    fits: Sequence[Fit] = (),
    free: Sequence[str] = (),
    goal: GoalName = "parameters",
    minutes: float = 15.0,
    wishes: Wishes | None = None,
    draws: int | Sequence[Samples] = 0,
    **asked: Any,
) -> NextRuns:
    """Propose which runs of a campaign's samples to record next.

    What is known of a sample is what a fit of it says, or what its runs so far say, which are identified here. What can
    be recorded follows from the campaign: its limits, its conditions and its rest times.

    Parameters
    ----------
    campaign : Campaign
    folder : Path, optional
        Where ``ipmclab characterise`` put its runs; it can be left out where fits are given.
    fits : sequence of Fit
        Each of runs of one of the samples.
    free : sequence of str
        As ``identify`` takes them; circuit and coupling where it is empty.
    goal : "parameters", "prediction" or "model"
    minutes : float [min]
    wishes : Wishes, optional
    draws : int or sequence of Samples
        As ``propose_runs`` takes them, of each sample one.
    **asked
        ``inputs`` and ``rival`` of ``propose_runs``, and ``on_progress``, a function that is called with what is done
        next.

    Raises
    ------
    InputError
        A folder of another campaign, a fit of none of the samples, nothing known of any, no run within the limits.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import numpy as np
    >>> from ipmclab import identify, load_actuator, simulate
    >>> from ipmclab.campaign.campaign_file import campaign_from_text
    >>> from ipmclab.campaign.template import TEMPLATE
    >>> strip = load_actuator("friend-1-measured")
    >>> run = simulate(strip, "step 1 V", duration=20, rate=50)
    >>> noise = 1e-4 * np.random.default_rng(20261123).standard_normal(len(run))
    >>> fit = identify(strip, replace(run, current=run.current + noise), free="circuit.dc_resistivity")
    >>> campaign = campaign_from_text(TEMPLATE.replace("strip-1", "friend-1"))
    >>> found = propose_for_campaign(campaign, None, fits=[fit], minutes=4, wishes=Wishes(longest=10.0))
    >>> print(found.lines.partition("measured")[0], end="")
    [[experiments]]
    name = "next-1"
    samples = ["friend-1"]
    signals = ["triangle 1 V 0.1 Hz"]
    duration = "10 s"
    """
    on_progress: OnProgress = asked.pop("on_progress", lambda _: None)
    results, left = ((), 0) if folder is None else recorded_runs(campaign, folder)
    models = None if folder is None else folder / MODELS
    known, remarks = known_of(campaign, results, fits=fits, free=free, models=models, on_progress=on_progress)
    ways = {sample: ways_of(campaign, sample, one, wishes or Wishes()) for sample, one in known.items()}
    on_progress("asking the model")
    proposal = propose_for_strips(
        {sample: one.fit for sample, one in known.items()},
        ways,
        goal=goal,
        minutes=minutes,
        draws=draws if isinstance(draws, int) else _by_sample(draws, known),
        **asked,
    )
    if left:
        remarks = (*remarks, f"{left} runs of the campaign are not recorded yet: their information is not counted")
    proposal = replace(proposal, remarks=remarks)
    return NextRuns(proposal, lines_of(campaign, proposal, {sample: one.condition for sample, one in known.items()}))


def _by_sample(draws: Sequence[Samples], known: Mapping[str, KnownSample]) -> dict[str, Samples]:
    """Samples of posteriors by the sample of whose runs they are."""
    of = {frozenset(content for _, content in one.fit.runs): sample for sample, one in known.items()}
    found = {}
    for one in draws:
        sample = of.get(frozenset(one.runs))
        if sample is None:
            raise InputError(
                "the posterior is of other runs than the fit of any sample",
                code="another-posterior",
                where=one.where,
                repair="give the posterior of the runs of a fit, and that fit (--fit)",
            )
        found[sample] = one
    return found


def ways_of(campaign: Campaign, sample: str, known: KnownSample, wishes: Wishes) -> dict[str, Allowance]:
    """How a sample can be recorded: as each of its experiments, whose limits, rests and conditions hold.

    Experiments that differ in nothing of this are one. The largest amplitude is what the campaign itself applies to
    the sample in an experiment, 1.2 V at least, and never above its limit.

    Parameters
    ----------
    campaign : Campaign
    sample : str
    known : KnownSample
    wishes : Wishes

    Raises
    ------
    InputError
        No experiment reads what the fit has read, where it was.
    """
    times = _times_without_signals(campaign, sample)
    follows = has_laws(known.fit.actuator)
    outputs = {name for one in known.fit.observations for name in one.noise}
    found: dict[str, Allowance] = {}
    for part in campaign.parts:
        experiment = part.experiments.get(sample)
        if experiment is None or part.name not in times:
            continue
        reads = tuple(name for name in ("current", *experiment.measured) if name in outputs)
        if not reads or not (follows or known.condition in ("", *_names(experiment))):
            continue  # nothing is known of what it reads, or of the strip in its air
        allowed = Allowance(
            limits=_limits(experiment, wishes.limits),
            rate=experiment.rate,
            longest=wishes.longest,
            rest=times[part.name] if wishes.rest is None else wishes.rest,
            hydration=wishes.hydration,
            wet=wishes.wet,
            soak=_settle(experiment) if wishes.soak is None else wishes.soak,
            conditions=_conditions(experiment) if follows else (),
            reads=tuple(dict.fromkeys(reads)),
        )
        if allowed not in found.values():
            found[part.name] = allowed
    if not found:
        raise InputError(
            f"no experiment of the campaign records {sample} as its fit knows it",
            code="no-run",
            where=campaign.where,
            repair="identify it from runs of the campaign",
        )
    return found


def _names(experiment: Experiment) -> set[str]:
    return {one.name for one in experiment.environments} or {ROOM}


def _settle(experiment: Experiment) -> float:
    return max((one.settle for one in experiment.environments), default=0.0)


def _conditions(experiment: Experiment) -> tuple[Environment, ...]:
    known = [
        Environment(one.temperature, one.relative_humidity)
        for one in experiment.environments
        if one.temperature is not None and one.relative_humidity is not None
    ]
    return tuple(dict.fromkeys(known))


def _limits(experiment: Experiment, given: Mapping[str, str]) -> Limits:
    limits = Limits.from_table({**experiment.limits, **given}, where=experiment.where)
    if "voltage" in given:
        return limits
    times = np.arange(0.0, experiment.duration, 1.0 / experiment.rate)
    applied = max(float(np.abs(one.voltage(times)).max(initial=0.0)) for one in experiment.signals)
    most = min(max(applied, BELOW_ELECTROLYSIS), limits.voltage.most)
    return replace(limits, voltage=replace(limits.voltage, most=most))


def _times_without_signals(campaign: Campaign, sample: str) -> dict[str, float]:
    """What a run of each experiment takes [s] in addition to its signal: rests, zeros, and what else the campaign
    plans.

    A run that is alone in its plan has no pause there; the next one after it has.
    """
    found: dict[str, float] = {}
    for one in plan_campaign(campaign, bytes_free=_ENOUGH).runs:
        run: CampaignRun = one.run
        if run.sample == sample and run.planned.purpose == "signal":
            overhead = one.seconds - run.planned.duration
            found[run.part] = min(overhead, found.get(run.part, overhead))
    experiments = {part.name: part.experiments[sample] for part in campaign.parts if part.name in found}
    return {name: max(overhead, _rest(experiments[name])) for name, overhead in found.items()}


def _rest(experiment: Experiment) -> float:
    return experiment.rest_before + experiment.rest_after + experiment.pause + 2.0 * experiment.zero_time
