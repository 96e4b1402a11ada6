"""The methods of a campaign in sentences, from what was planned and what was done."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from ipmclab.campaign.blocks import Block
from ipmclab.campaign.campaign import ROOM, Campaign
from ipmclab.campaign.identified import SampleModel
from ipmclab.fit.rows import listed
from ipmclab.rig.channels import Rig
from ipmclab.rig.experiments.environments import TargetEnvironment
from ipmclab.rig.experiments.experiment import Experiment
from ipmclab.rig.safety.limits import Limits

if TYPE_CHECKING:
    from ipmclab.comparison.compare import Comparison


def methods(campaign: Campaign, blocks: Sequence[Block], events: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Paragraphs for the methods section of a report.

    Parameters
    ----------
    campaign : Campaign
    blocks : sequence of Block
        All of them.
    events : sequence of mapping
        What was done, as the state of the campaign has it.

    Examples
    --------
    >>> import textwrap
    >>> from ipmclab.campaign.blocks import blocks_of
    >>> from ipmclab.campaign.campaign_file import campaign_from_text
    >>> from ipmclab.campaign.template import TEMPLATE
    >>> campaign = campaign_from_text(TEMPLATE)
    >>> print(textwrap.fill(methods(campaign, blocks_of(campaign), [])[1], 110))
    The order was randomised with seed 1: in each repeat of everything the order of samples, of the experiments of
    each and of the signals under each condition was drawn again. A strip was hydrated and clamped once for each
    block of runs under one condition.
    """
    return (
        _setting(campaign, events),
        _order(campaign),
        *_facts(campaign, events),
        *_experiments(campaign, blocks),
        _checks(campaign, events),
    )


def _setting(campaign: Campaign, events: Sequence[Mapping[str, Any]]) -> str:
    rig = campaign.rig
    names = listed([channel.name.replace("_", " ") for channel in rig.channels])
    strips = len(campaign.strips)
    samples = "One sample was" if strips == 1 else f"{strips} samples were"
    text = f"{samples} recorded on {rig.name}, which reads {names}"
    text += f", with {rig.shunt_resistance:g} Ω in series with the strip" if rig.shunt_resistance else ""
    recorded = [str(one["at"]) for one in events if one["event"] == "recorded"]
    if recorded:
        first, last = recorded[0][:10], recorded[-1][:10]
        text += f", on {first}" if first == last else f", from {first} to {last}"
    text += "."
    if campaign.is_virtual:
        text += " The bench was a virtual one: strips, sensors and their noise were computed, in lock-step, from seed "
        text += f"{campaign.seed}; each run began with a strip at rest."
    versions = dict.fromkeys(str(one["version"]) for one in events if one["event"] == "campaign")
    return text + (f" Software: ipmclab {listed(versions)}." if versions else "")


def _order(campaign: Campaign) -> str:
    order = (
        f"The order was randomised with seed {campaign.seed}: in each repeat of everything the order of samples, of "
        "the experiments of each and of the signals under each condition was drawn again."
        if campaign.order == "randomised"
        else "Samples followed each other as they are listed, and so did the experiments and the signals of each."
    )
    clamped = (
        "again for each run"
        if campaign.clamped == "for each run"
        else "once for each block of runs under one condition"
    )
    return f"{order} A strip was hydrated and clamped {clamped}."


def _facts(campaign: Campaign, events: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """What was measured of the strips without a run, and how."""
    facts = [one for one in events if one["event"] == "fact"]
    by: dict[str, dict[str, list[str]]] = {}  # of each way: what was measured, and of which samples
    for one in facts:
        by.setdefault(str(one["how"]), {}).setdefault(str(one["name"]), []).append(str(one["sample"]))
    lines = []
    for how, names in by.items():
        samples = list(dict.fromkeys(sample for each in names.values() for sample in each))
        of = "" if len(samples) == len(campaign.strips) else f" of {listed(samples)}"
        lines.append(f"{listed(names)}{of} ({how})")
    if lines:
        yield f"Measured without a run: {'; '.join(lines)}."


def _experiments(campaign: Campaign, blocks: Sequence[Block]) -> Iterator[str]:
    """What was recorded in each experiment; what holds for all of them is said once, before."""
    kinds = [next(iter(part.experiments.values())) for part in campaign.parts]
    between = partial(_between, is_rested=not campaign.is_virtual and campaign.clamped != "for each run")
    limits = partial(_limits, rig=campaign.rig)
    said = [(text, {text(one) for one in kinds} - {""}) for text in (between, _environment, limits)]
    shared = [text for text, found in said if len(found) == 1]
    common = [found.pop() for _, found in said if len(found) == 1]
    if common:
        yield " ".join(common)
    for part, experiment in zip(campaign.parts, kinds, strict=True):
        ours = [block for block in blocks if block.part == part.name]
        own = [text(experiment) for text, _ in said if text not in shared and text(experiment)]
        if ours:
            yield " ".join([_experiment(part.name, experiment, ours), *own])


def _experiment(name: str, experiment: Experiment, ours: Sequence[Block]) -> str:
    samples = listed(dict.fromkeys(block.strip.sample.id for block in ours))
    signals = listed(dict.fromkeys(run.label for block in ours for run in block.runs))
    conditions = list(dict.fromkeys(block.condition for block in ours))
    count = sum(len(block.runs) for block in ours)
    where = "in room conditions" if conditions == [ROOM] else f"at {listed(conditions)}"
    if len(conditions) > 1:
        way = "up the list and down again" if experiment.order == "palindromic" else "in this order"
        where += f", visited {way}"
    return (
        f"{name[0].upper()}{name[1:]}: {listed(experiment.measured)} of {samples} {where}; {signals}; "
        f"{experiment.duration:g} s each at {experiment.rate:g} rows a second, after {experiment.rest_before:g} s and "
        f"before {experiment.rest_after:g} s at 0 V; {count} run{'s' if count > 1 else ''}."
    )


def _environment(experiment: Experiment) -> str:
    if not experiment.environments:
        return ""
    one: TargetEnvironment = experiment.environments[0]
    return (
        f"Where a condition was set, a run began once the air had held it (within {one.temperature_tolerance:g} K and "
        f"{one.humidity_tolerance:g} %RH) for {one.settle:g} s."
    )


def _between(experiment: Experiment, *, is_rested: bool) -> str:
    """What happened between runs; a strip that is clamped for each run, or begins at rest anyway, needs no pause."""
    text = f"Channels were read at rest for {experiment.zero_time:g} s before and after each run."
    if is_rested and experiment.pause:
        text += f" Between the runs of a block the strip rested at 0 V for {experiment.pause:g} s."
    return text


def _limits(experiment: Experiment, *, rig: Rig) -> str:
    """What the guard watched of the two that every run has; a limit beyond the range of its channel it cannot see."""
    limits = Limits.from_table(experiment.limits)
    unwatched, texts = limits.unwatched(rig, experiment.measured), limits.as_text()
    of = [f"{name} {texts[name]}" for name in ("voltage", "current") if name in texts and name not in unwatched]
    return f"The guard watched: {'; '.join(of)}." if of else ""


def _checks(campaign: Campaign, events: Sequence[Mapping[str, Any]]) -> str:
    verdicts = Counter(one["verdict"] for one in events if one["event"] == "recorded")
    text = f"Every run was checked; one with a finding of severity {campaign.fails_at} was recorded again, "
    text += f"at most {campaign.attempts} times in all, and flagged then."
    if campaign.fails_at == "never":
        text = "Every run was checked, and kept whatever was found."
    parts = [
        f"{verdicts[verdict]} {one if verdicts[verdict] == 1 else several}"
        for verdict, one, several in (
            ("kept", "run passed", "runs passed"),
            ("repeat", "was recorded again", "were recorded again"),
            ("flagged", "is flagged", "are flagged"),
            ("interrupted", "was cut off and recorded again", "were cut off and recorded again"),
        )
        if verdicts[verdict]
    ]
    return text + (f" {listed(parts)[0].upper()}{listed(parts)[1:]}." if parts else "")


def identification(models: Sequence[SampleModel]) -> tuple[str, ...]:
    """The paragraph on how the models of the samples were identified; none where there are no models."""
    if not any(one.fit is not None for one in models):
        return ()
    modulus = any(one.fit is not None and one.choice is not None and one.choice.is_of_modulus for one in models)
    also = " The modulus was then identified from the step of the lowest voltage with the force." if modulus else ""
    return (
        "The model of each sample was identified from the first repeat of one step of a voltage, the lowest one under "
        "the condition under which most signals were applied: the circuit from its current, the coupling from its "
        "displacement, or from its force where no displacement was recorded. The leak is in the model where that "
        f"voltage passes its threshold.{also} All other parameters have the values of the actuator that the campaign "
        "names, and the sheet resistance that of the four probes where it was read. Every other run under that "
        "condition was predicted from its voltage alone.",
    )


def comparing(comparison: Comparison | None) -> tuple[str, ...]:
    """The paragraph on how the runs were held side by side; none where they were not."""
    if comparison is None:
        return ()
    rows = [row for row in comparison.rows if row.baseline]
    drift = (
        f"From the displacement of {len(rows)} runs the curl of the strip was taken: the rate of its baseline in the "
        "same air, along a straight line. It is still in the tables above. "
        if rows
        else ""
    )
    effects = (
        "Effects are those of a linear mixed model of each metric, of magnitudes by their logarithm, with random "
        "intercepts of strips and of mountings: restricted maximum likelihood, 95 % intervals after Kenward and Roger. "
        if comparison.models
        else ""
    )
    return (f"{drift}{effects}The interval of a mean over repeats is Student's.",)
