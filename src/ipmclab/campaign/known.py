"""What a campaign knows of its samples so far: a fit of each, from its own runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ipmclab.campaign.blocks import blocks_of
from ipmclab.campaign.campaign import Campaign, Strip
from ipmclab.campaign.identified import model_name
from ipmclab.campaign.results import RunResult, read_results
from ipmclab.campaign.state import FILE, as_begun, read_events
from ipmclab.errors import InputError, IpmclabError
from ipmclab.fit.fit import Fit
from ipmclab.fit.interrupted import uninterrupted
from ipmclab.identification.identify import identify
from ipmclab.model import Actuator, load_actuator
from ipmclab.model.declared import ELECTRICAL, MOTION, in_group
from ipmclab.model.stages.coupling import ZERO
from ipmclab.run import Run

OnProgress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class KnownSample:
    """What is known of a sample of a campaign.

    Parameters
    ----------
    fit : Fit
    results : tuple of RunResult
        Its runs that were kept.
    condition : str
        That of the last run of the fit.
    """

    fit: Fit
    results: tuple[RunResult, ...]
    condition: str


def recorded_runs(campaign: Campaign, folder: Path) -> tuple[tuple[RunResult, ...], int]:
    """The runs of a campaign that were kept so far, those without a signal left out; and how many are left to record.

    Parameters
    ----------
    campaign : Campaign
    folder : Path
        Where ``ipmclab characterise`` put them.

    Raises
    ------
    InputError
        No campaign was carried out in this folder, or another one.
    """
    events = read_events(folder)
    begun = as_begun(events)
    if begun is None or begun["checksum"] != campaign.checksum:
        raise InputError(
            "this folder has another campaign, or another version of this one",
            code="another-campaign",
            where=str(folder),
            repair=f"name the folder of this campaign, or give the file as it was: {FILE} has it",
        )
    recorded = {one["run"]: one for one in events if one["event"] == "recorded"}
    results = read_results(folder, blocks_of(campaign), recorded)
    kept = tuple(one for one in results if one.verdict == "kept" and one.run.planned.purpose == "signal")
    done = [name for name, one in recorded.items() if one["verdict"] in ("kept", "flagged")]
    return kept, len(set(begun["plan"]) - set(done))


def known_of(
    campaign: Campaign,
    results: Sequence[RunResult],
    *,
    fits: Sequence[Fit] = (),
    free: Sequence[str] = (),
    models: Path | None = None,
    on_progress: OnProgress = lambda _: None,
) -> tuple[dict[str, KnownSample], tuple[str, ...]]:
    """What is known of each sample: by a fit that is given, or identified here from all of its runs.

    A sample whose model has no laws of the environment is identified in the condition in which most of its runs are.

    Parameters
    ----------
    campaign : Campaign
    results : sequence of RunResult
        As ``recorded_runs`` gives them.
    fits : sequence of Fit
        Each of runs of one of the samples.
    free : sequence of str
        As ``identify`` takes them; the circuit, and the coupling where the tip was read, where it is empty.
    models : Path, optional
        The folder of the models that the campaign identified: where the search of a sample begins.
    on_progress : callable
        Called with what is done next.

    Returns
    -------
    known : mapping of sample to KnownSample
    remarks : tuple of str
        Of what nothing is known.

    Raises
    ------
    InputError
        A fit of none of the samples, or no sample of which anything is known.
    """
    ids = [strip.sample.id for strip in campaign.strips]
    ours = {sample: tuple(one for one in results if one.run.sample == sample) for sample in ids}
    given = {_sample_of(fit, ours): fit for fit in fits}
    found: dict[str, KnownSample] = {}
    remarks: list[str] = []
    for strip in campaign.strips:
        sample = strip.sample.id
        if sample in given:
            found[sample] = _by_fit(given[sample], ours[sample])
            remarks += _newer(sample, found[sample])
            continue
        if not ours[sample]:
            remarks.append(f"{sample} has no run yet: the information of its next run is not known")
            continue
        on_progress(f"identifying {sample}")
        try:
            found[sample] = _identified(_start(strip, models), ours[sample], free)
        except IpmclabError as error:
            remarks.append(f"{sample} is left out, for its model cannot be identified: {error.message}")
    if not found:
        raise InputError(
            f"nothing is known of a sample yet: {'; '.join(remarks)}",
            code="nothing-known",
            where=campaign.where,
            repair="record some of its runs first: ipmclab characterise",
        )
    return found, tuple(remarks)


def _sample_of(fit: Fit, ours: Mapping[str, Sequence[RunResult]]) -> str:
    """Of which sample a fit is: its runs say so, or else its actuator."""
    contents = {content for _, content in fit.runs}
    for sample, each in ours.items():
        if any(one.record.content_sha256 in contents for one in each):
            return sample
    own = fit.actuator.sample
    if own is not None and own.id in ours:
        return own.id
    raise InputError(
        "the fit is of none of the campaign's samples",
        code="another-fit",
        where="fit",
        repair=f"give a fit of a run of {', '.join(ours)}",
    )


def _by_fit(fit: Fit, results: Sequence[RunResult]) -> KnownSample:
    contents = [content for _, content in fit.runs]
    used = [one for one in results if one.record.content_sha256 in contents]
    condition = used[-1].run.condition if used else (results[-1].run.condition if results else "")
    return KnownSample(fit, tuple(results), condition)


def _newer(sample: str, known: KnownSample) -> Iterator[str]:
    contents = {content for _, content in known.fit.runs}
    count = sum(one.record.content_sha256 not in contents for one in known.results)
    if count:
        yield f"{count} runs of {sample} are not in its fit: their information is not counted here"


def _start(strip: Strip, models: Path | None) -> Actuator:
    """What the campaign has identified of a sample from one of its runs, or else the actuator that it names."""
    if models is not None and (path := models / f"{model_name(strip.sample.id)}.toml").is_file():
        return replace(load_actuator(path), fit_table=None)
    if strip.actuator is None:
        raise InputError(
            "the campaign names no actuator for it, which says what its model is",
            code="no-actuator",
            where=strip.sample.id,
            repair='add actuator = "friend-2" to the sample, or give a fit',
        )
    return replace(load_actuator(strip.actuator), fit_table=None)


def _identified(actuator: Actuator, results: Sequence[RunResult], free: Sequence[str]) -> KnownSample:
    used = list(results)
    if not has_laws(actuator):
        counts = Counter(one.run.condition for one in results)
        used = [one for one in results if one.run.condition == counts.most_common(1)[0][0]]
    runs = [_named(one) for one in used]
    fit = uninterrupted(identify(actuator, runs, free=list(free) or _usual(actuator, runs)))
    return KnownSample(fit, tuple(results), used[-1].run.condition)


def has_laws(actuator: Actuator) -> bool:
    """Whether its parameters follow the environment."""
    return bool(actuator.environment_laws or actuator.structure.hydration)


def _usual(actuator: Actuator, runs: Sequence[Run]) -> list[str]:
    """The circuit, and the coupling without its zero, which is faster than records are read."""
    tip = any(run.displacement is not None or run.force is not None for run in runs)
    coupling = [name for name in in_group(MOTION, actuator.parameters()) if name != ZERO]
    return [ELECTRICAL, *(coupling if tip else [])]


def _named(result: RunResult) -> Run:
    return replace(result.record, file=result.run.id)
