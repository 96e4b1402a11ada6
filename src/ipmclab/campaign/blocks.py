"""Every run of a campaign in its order: blocks of one strip, in one clamping, under one condition."""

from __future__ import annotations

import hashlib
import random
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, TypeVar

from ipmclab.campaign.campaign import ROOM, Campaign, Part, Strip
from ipmclab.errors import InputError
from ipmclab.rig.experiments.experiment import Experiment, ListedRun
from ipmclab.rig.experiments.steps import PlannedRun, planned_runs, planned_visits, reversed_signal
from ipmclab.rig.experiments.visits import Visit
from ipmclab.signals import Samples, Signal, Step
from ipmclab.signals import Sequence as SignalSequence
from ipmclab.signals.signal import shortened

Thing = TypeVar("Thing")

BASELINE: Final = "baseline"
"""What is in the place of a signal where none is applied."""


@dataclass(frozen=True)
class CampaignRun:
    """One run of a campaign.

    Parameters
    ----------
    id : str
        The same whenever the campaign is planned: sample, experiment, condition, signal and repeat.
    number : int
        Its place in the campaign, counted from 1.
    sample, part, condition, label : str
        ``label`` is its signal, or ``"baseline"``.
    measured : "displacement", "force" or "current"
        What distinguishes the runs of one signal.
    planned : PlannedRun
    """

    id: str
    number: int
    sample: str
    part: str
    condition: str
    label: str
    measured: str
    planned: PlannedRun

    def listed(self, uuid: str) -> ListedRun:
        """What the experiment that records it gets."""
        one = self.planned
        assert one.purpose != "fingerprint"
        return ListedRun(one.signal, one.purpose, one.repeat, one.pair_id, uuid)


@dataclass(frozen=True)
class Block:
    """Runs of one strip that follow each other in one condition.

    Parameters
    ----------
    number : int
        Counts from 1.
    strip : Strip
    part : str
    condition : str
        ``"room"``, or for example ``"20 degC, 80 %RH"``.
    experiment : Experiment
        What is common to its runs.
    runs : tuple of CampaignRun
    """

    number: int
    strip: Strip
    part: str
    condition: str
    experiment: Experiment
    runs: tuple[CampaignRun, ...]


def blocks_of(campaign: Campaign) -> tuple[Block, ...]:
    """Every block of a campaign, in the order in which they are recorded.

    Listed, the samples follow each other, and of each its experiments, their conditions in the order that each states
    (up the list and down again, unless it says otherwise), their signals and the repeats of each. Randomised, each
    repeat of everything is a whole of its own: the order of samples, of the experiments of each, and of the
    signals under each condition is drawn again in it, so that what drifts does not look like a repeat's effect.
    A baseline comes first in its block.

    Examples
    --------
    >>> from ipmclab.campaign.campaign_file import campaign_from_text
    >>> from ipmclab.campaign.template import TEMPLATE
    >>> blocks = blocks_of(campaign_from_text(TEMPLATE.replace("randomised", "listed")))
    >>> [(block.strip.sample.id, block.part, block.condition, len(block.runs)) for block in blocks][:3]
    [('strip-1', 'displacement', '20 degC, 80 %RH', 7),
     ('strip-1', 'displacement', '20 degC, 60 %RH', 7),
     ('strip-1', 'displacement', '20 degC, 80 %RH', 7)]
    """
    found: list[Block] = []
    count = 0
    for strip, part, visit, runs in _in_order(campaign):
        if not runs:
            continue
        experiment = _under(part.experiments[strip.sample.id], visit)
        block = Block(len(found) + 1, strip, part.name, _condition(visit), experiment, ())
        folder = Path(campaign.where).parent
        named = tuple(_named(one, block, visit, count + at, folder) for at, one in enumerate(runs, start=1))
        found.append(replace(block, runs=named))
        count += len(named)
    _refuse_double(found, campaign.where)
    return tuple(found)


def _in_order(campaign: Campaign) -> Iterator[tuple[Strip, Part, Visit | None, list[PlannedRun]]]:
    if campaign.order == "listed":
        for strip in campaign.strips:
            for part in _of(strip, campaign):
                for visit, runs in _visited(part.experiments[strip.sample.id]):
                    yield strip, part, visit, runs
        return
    most = max(one.repeats for part in campaign.parts for one in part.experiments.values())
    for repeat in range(1, most + 1):
        for strip in _drawn(campaign.strips, campaign.seed, repeat):
            for part in _drawn(_of(strip, campaign), campaign.seed, repeat, strip.sample.id):
                experiment = part.experiments[strip.sample.id]
                for visit, runs in _visited(experiment) if repeat <= experiment.repeats else ():
                    place = (strip.sample.id, part.name, 0 if visit is None else visit.number)
                    yield strip, part, visit, _replicate(runs, experiment.repeats, repeat, campaign.seed, place)


def _replicate(
    runs: Sequence[PlannedRun], repeats: int, repeat: int, seed: int, place: tuple[object, ...]
) -> list[PlannedRun]:
    """What is recorded under one condition in one repeat of everything: first what is no signal, then all signals."""
    others = [
        replace(one, repeat=(one.repeat - 1) * repeats + repeat)  # it is there once in each repeat of everything
        for one in runs
        if one.purpose != "signal"
    ]
    signals = [one for one in runs if one.purpose == "signal" and (one.repeat - 1) % repeats + 1 == repeat]
    return [*others, *(one for pair in _drawn(_pairs(signals), seed, repeat, *place) for one in pair)]


def _of(strip: Strip, campaign: Campaign) -> list[Part]:
    return [part for part in campaign.parts if strip.sample.id in part.experiments]


def _visited(experiment: Experiment) -> Iterator[tuple[Visit | None, list[PlannedRun]]]:
    for visit in planned_visits(experiment) or (None,):
        yield visit, list(planned_runs(experiment, visit))


def _pairs(runs: Sequence[PlannedRun]) -> list[list[PlannedRun]]:
    """Runs by signal; the two polarities of one stay together."""
    found: dict[str, list[PlannedRun]] = {}
    for place, one in enumerate(runs):
        found.setdefault(one.pair_id or str(place), []).append(one)
    return list(found.values())


def _drawn(things: Sequence[Thing], *seed: object) -> list[Thing]:
    """Things in an order that the seed gives, on every machine the same."""
    shuffled = list(things)
    random.Random(repr(seed)).shuffle(shuffled)
    return shuffled


def _under(experiment: Experiment, visit: Visit | None) -> Experiment:
    """The experiment at one of its conditions."""
    return experiment if visit is None else replace(experiment, environments=(visit.environment,), reference=None)


def _condition(visit: Visit | None) -> str:
    return ROOM if visit is None else visit.environment.name


def label_of(signal: Signal, folder: Path) -> str:
    """A signal as people call it; one in a file by its path from the campaign's folder, wherever that is named from.

    Parameters
    ----------
    signal : Signal
    folder : Path
        Of the campaign's file, as it was named.
    """
    return shortened(str(_from_there(signal, folder)))


def _from_there(signal: Signal, folder: Path) -> Signal:
    if isinstance(signal, SignalSequence):
        return replace(signal, signals=tuple(_from_there(one, folder) for one in signal.signals))
    if not isinstance(signal, Samples) or not signal.path:
        return signal
    path, found = Path(signal.path), copy(signal)
    inside = path.relative_to(folder) if path.is_relative_to(folder) else path
    object.__setattr__(found, "path", inside.as_posix())
    return found


def _named(planned: PlannedRun, block: Block, visit: Visit | None, number: int, folder: Path) -> CampaignRun:
    if planned.signal == Step(0.0):
        planned = replace(planned, purpose="baseline")  # however it was asked for
    label = label_of(planned.signal, folder) if planned.purpose in ("signal", "reference") else BASELINE
    label = f"{label} (reference)" if planned.purpose == "reference" else label
    again = f" ({visit.number})" if visit is not None and visit.of > 1 else ""
    sample = block.strip.sample.id
    name = f"{sample}/{block.part}/{block.condition}{again}/{label}/{planned.repeat}"
    if planned.pair_id is not None:
        either = min(label, label_of(reversed_signal(planned.signal), folder))
        pair = f"{sample}/{block.part}/{block.condition}{again}/{either}/{planned.repeat}"
        planned = replace(planned, pair_id=hashlib.sha256(pair.encode()).hexdigest()[:12])
    measured = next((one for one in ("displacement", "force") if one in planned.measured), "current")
    return CampaignRun(name, number, sample, block.part, block.condition, label, measured, planned)


def _refuse_double(blocks: Sequence[Block], where: str) -> None:
    """Two runs that nothing distinguishes would be one run for whoever continues after a break."""
    seen: set[str] = set()
    for block in blocks:
        for run in block.runs:
            if run.id in seen:
                raise InputError(
                    f"two runs of {run.sample} are the same: {run.id}",
                    code="bad-value",
                    where=f"{where}: {block.experiment.where}",
                    repair="list each signal and each condition once, and state how often: repeats = 2",
                )
            seen.add(run.id)
