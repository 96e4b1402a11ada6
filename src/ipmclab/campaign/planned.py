"""What a campaign is going to do: every run with its estimated time, and what the guard watches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ipmclab.campaign.blocks import Block, CampaignRun, blocks_of
from ipmclab.campaign.campaign import Campaign
from ipmclab.campaign.sitting import Sitting, sittings_of
from ipmclab.errors import InputError
from ipmclab.rig.experiments.plan import Plan, make_plan
from ipmclab.store.journal.laboratory import BALLAST


@dataclass(frozen=True)
class TimedRun:
    """One run with its time.

    Parameters
    ----------
    run : CampaignRun
    starts : float [s]
        After the campaign began, at the earliest and without what people do: when what makes ready for it begins.
    seconds : float [s]
        From then to its end.
    """

    run: CampaignRun
    starts: float
    seconds: float


@dataclass(frozen=True)
class CampaignPlan:
    """What is going to happen.

    Parameters
    ----------
    campaign : Campaign
    blocks : tuple of Block
    runs : tuple of TimedRun
    limits : mapping of sample and experiment to (mapping of name to text)
        What the guard watches.
    remarks : tuple of str
    seconds : float [s]
        In all, at the least, without what people do.
    questions : tuple of str
        What people are asked to do, once for each kind of step.
    bytes_needed : int
    """

    campaign: Campaign
    blocks: tuple[Block, ...]
    runs: tuple[TimedRun, ...]
    limits: dict[str, dict[str, str]]
    remarks: tuple[str, ...]
    seconds: float
    questions: tuple[str, ...]
    bytes_needed: int

    def watched(self) -> dict[str, str]:
        """What the guard watches, each with the experiments in which it does; empty where it is so in all of them.

        Examples
        --------
        >>> from ipmclab.campaign.campaign_file import campaign_from_text
        >>> from ipmclab.campaign.template import TEMPLATE
        >>> plan = plan_campaign(campaign_from_text(TEMPLATE), bytes_free=10**12)
        >>> list(plan.watched().values())
        ['displacement', 'force']
        """
        parts: dict[str, dict[str, list[str]]] = {}
        for block in self.blocks:
            limits = self.limits[_place(block)]
            text = "; ".join(f"{name} {limit}" for name, limit in limits.items())
            samples = parts.setdefault(block.part, {}).setdefault(text, [])
            if block.strip.sample.id not in samples:
                samples.append(block.strip.sample.id)
        found: dict[str, list[str]] = {}
        for part, texts in parts.items():
            for text, samples in texts.items():
                found.setdefault(text, []).append(part if len(texts) == 1 else f"{part} of {', '.join(samples)}")
        return {text: "" if len(found) == 1 else "; ".join(where) for text, where in found.items()}

    def as_dict(self) -> dict[str, Any]:
        """The plan as a JSON document (SI units)."""
        return {
            "title": self.campaign.title,
            "rig": self.campaign.rig.name,
            "order": self.campaign.order,
            "seed": self.campaign.seed,
            "facts": list(self.campaign.facts),
            "runs": [
                {
                    "number": one.run.number,
                    "id": one.run.id,
                    "sample": one.run.sample,
                    "experiment": one.run.part,
                    "measured": one.run.measured,
                    "condition": one.run.condition,
                    "signal": one.run.label,
                    "repeat": one.run.planned.repeat,
                    "starts": one.starts,
                    "seconds": one.seconds,
                }
                for one in self.runs
            ],
            "limits": self.limits,
            "remarks": list(self.remarks),
            "asks": list(self.questions),
            "seconds": self.seconds,
            "bytes_needed": self.bytes_needed,
        }


def plan_campaign(campaign: Campaign, *, bytes_free: int) -> CampaignPlan:
    """Check every run of a campaign against rig, limits and disk, and compute when each will come.

    Parameters
    ----------
    campaign : Campaign
    bytes_free : int
        On the disk that it goes to.

    Raises
    ------
    InputError
        What cannot be done, with its experiment.

    Examples
    --------
    >>> from ipmclab.campaign.campaign_file import campaign_from_text
    >>> from ipmclab.campaign.template import TEMPLATE
    >>> plan = plan_campaign(campaign_from_text(TEMPLATE), bytes_free=10**12)
    >>> plan.runs[1].run.id
    'strip-1/displacement/20 degC, 80 %RH (1)/step 1 V/1'
    """
    blocks = blocks_of(campaign)
    timed: list[TimedRun] = []
    limits: dict[str, dict[str, str]] = {}
    remarks: dict[tuple[str, str], dict[str, None]] = {}
    questions: dict[str, None] = {}
    passed, needed = 0.0, BALLAST
    for one in sittings_of(campaign, blocks):
        plan = _plan(campaign, one, bytes_free)
        limits[_place(one.block)] = plan.as_dict()["limits"]
        for text in plan.remarks:
            remarks.setdefault((one.block.part, text), {})[one.block.strip.sample.id] = None
        questions.update(dict.fromkeys(step.text for step in plan.steps if step.question is not None))
        timed += _timed(one, plan, passed)
        passed += plan.seconds
        needed += plan.bytes_needed - BALLAST
    said = tuple(_remark(blocks, part, text, list(samples)) for (part, text), samples in remarks.items())
    return CampaignPlan(campaign, blocks, tuple(timed), limits, said, passed, tuple(questions), needed)


def _remark(blocks: Sequence[Block], part: str, text: str, samples: Sequence[str]) -> str:
    """What is to be thought of in an experiment; of which samples, where it is not so of all of them."""
    of_all = len({block.strip.sample.id for block in blocks if block.part == part}) == len(samples)
    return f"{part}: {text}" if of_all else f"{part} of {', '.join(samples)}: {text}"


def _place(block: Block) -> str:
    """Sample and experiment of a block."""
    return f"{block.strip.sample.id}, {block.part}"


def _plan(campaign: Campaign, one: Sitting, bytes_free: int) -> Plan:
    run = one.runs[0]
    strip = one.block.strip.virtual(run.measured, run.label, run.condition)
    try:
        return make_plan(one.experiment, campaign.rig, bytes_free=bytes_free, actuator=strip)
    except InputError as error:
        raise error.at(f"{campaign.where}: {error.where}", f"{one.block.strip.sample.id}: {error.message}") from error


def _timed(one: Sitting, plan: Plan, began: float) -> list[TimedRun]:
    """The runs of a sitting: what makes ready for one counts to it, and what ends the sitting to the last."""
    found: list[TimedRun] = []
    since = at = began
    runs: Sequence[CampaignRun] = one.runs
    for step in plan.steps:
        at += step.seconds
        if step.run is not None and step.run.purpose != "fingerprint":
            found.append(TimedRun(runs[len(found)], since, at - since))
            since = at
    last = found[-1]
    return [*found[:-1], TimedRun(last.run, last.starts, last.seconds + at - since)]
