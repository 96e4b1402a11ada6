"""The model of each sample, identified from some of its own runs and compared with those that were not used.

Which runs (``choose_runs``): the steps at the condition under which most signals were applied. The lowest one with the
displacement shows circuit and coupling, and the lowest one with the force shows the modulus, as in the thesis's
procedure; each is the first repeat. Sines, squares, higher steps and further repeats remain to be predicted.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from ipmclab.campaign.campaign import Campaign, Strip
from ipmclab.campaign.results import RunResult
from ipmclab.campaign.state import MODELS, State
from ipmclab.errors import InputError, IpmclabError
from ipmclab.fit.fit import Fit
from ipmclab.fit.fit_file import read_fit, write_fit
from ipmclab.fit.interrupted import uninterrupted
from ipmclab.identification.identify import identify
from ipmclab.model import Actuator, load_actuator
from ipmclab.model.stages.beam import YOUNGS_MODULUS
from ipmclab.model.stages.circuit import SHEET
from ipmclab.model.stages.leak import LEAK, Leak
from ipmclab.platform import is_device
from ipmclab.prediction.scores import fit_in_words
from ipmclab.prediction.validate import Validation, validate
from ipmclab.run import Run
from ipmclab.signals import Step

_MOST_ROWS: Final = 100_000
"""Of a run that a report may wait for."""

_CHANNELS: Final = ("displacement", "force", "current")
"""What shows most of a strip comes first."""

OnProgress = Callable[[str, float], None]


def model_name(sample: str) -> str:
    """What the file of a sample's model is called: its id, with a checksum where a file cannot be called that.

    Examples
    --------
    >>> model_name("friend-2"), model_name("Nafion 117/3"), model_name("aux")
    ('friend-2', 'Nafion-117-3-92348cb4', 'aux-bac20cb8')
    """
    word = re.sub(r"[^A-Za-z0-9._-]+", "-", sample).lstrip(".")
    return word if word == sample and not is_device(word) else f"{word}-{zlib.crc32(sample.encode()):08x}"


@dataclass(frozen=True)
class Choice:
    """From which run a model is identified, and which ones it is to predict.

    Parameters
    ----------
    sample : str
    measured : "displacement", "force" or "current"
        Of these runs, in addition to the current.
    source : RunResult
    free : tuple of str
        As ``identify`` takes them.
    unseen : tuple of RunResult
        Of the same sample under the same condition.
    """

    sample: str
    measured: str
    source: RunResult
    free: tuple[str, ...]
    unseen: tuple[RunResult, ...]

    @property
    def name(self) -> str:
        """Of the file: the sample, and ``-force`` where its modulus was found in addition."""
        return f"{model_name(self.sample)}-force" if self.is_of_modulus else model_name(self.sample)

    @property
    def is_of_modulus(self) -> bool:
        """Whether the modulus alone is identified, after circuit and coupling."""
        return self.free == (YOUNGS_MODULUS,)


@dataclass(frozen=True, eq=False)
class SampleModel:
    """What was identified of a sample, or why nothing was.

    Parameters
    ----------
    sample : str
    choice : Choice, optional
        None where its runs allow no choice.
    path : Path, optional
        The fit file.
    fit : Fit, optional
    validation : Validation, optional
        Against those of ``choice.unseen`` that it is a model of.
    failure : str
        In a sentence; empty where there is a fit.
    """

    sample: str
    choice: Choice | None = None
    path: Path | None = None
    fit: Fit | None = None
    validation: Validation | None = None
    failure: str = ""

    @property
    def scores(self) -> dict[str, float]:
        """Fit percentage of each output that it is a model of, over the runs that were not used for it."""
        outputs = ("force",) if self.choice is not None and self.choice.is_of_modulus else _CHANNELS[::-1]
        found = {} if self.validation is None else self.validation.scores
        scores = {name: found[name].fit_percent for name in outputs if name in found}
        return {name: score for name, score in scores.items() if score is not None}

    def __str__(self) -> str:
        """In one line, as a terminal shows it."""
        if self.choice is None or self.fit is None:
            return f"{self.sample}: no model: {self.failure}"
        what = "modulus" if self.choice.is_of_modulus else "model"
        scores = ", ".join(f"{name} {fit_in_words(score)}" for name, score in self.scores.items()) or "there are none"
        return f"{self.sample}: {what} from {label_of(self.choice.source)}; unseen runs: {scores}"


def label_of(result: RunResult) -> str:
    """A run as people call it within its sample: its signal, with the experiment."""
    run = result.run
    repeat = f", repeat {run.planned.repeat}" if run.planned.repeat > 1 else ""
    return f"{run.label} ({run.part}{repeat})"


def choose_runs(results: Sequence[RunResult], strip: Actuator) -> tuple[Choice, ...]:
    """From which runs of one sample its model is identified.

    Parameters
    ----------
    results : sequence of RunResult
        Of the sample; those that are flagged, without a signal or of a reference are left out.
    strip : Actuator
        Its structure says what is free.

    Returns
    -------
    choices : tuple of Choice
        Circuit and coupling first, from the step of the lowest voltage with displacement (force, or the current alone,
        where there is none); then the modulus, from the lowest step with force. Empty where there is no step.
    """
    kept = [one for one in results if one.verdict == "kept" and one.run.planned.purpose == "signal"]
    for measured in _CHANNELS:
        steps = [one for one in kept if one.run.measured == measured and _height(one) > 0.0]
        if steps:
            break
    else:
        return ()
    condition = _most_signals(steps, kept, measured)
    here = [one for one in kept if one.run.condition == condition]
    first = _choice(here, measured, _electrical_and(measured, strip))
    pushes = [one for one in here if one.run.measured == "force" and _height(one) > 0.0]
    if measured != "displacement" or not pushes:
        return (first,)
    return first, _choice(here, "force", (YOUNGS_MODULUS,))


def _height(one: RunResult) -> float:
    """Of a step [V]; 0 for another signal."""
    signal = one.run.planned.signal
    return abs(signal.amplitude) if isinstance(signal, Step) else 0.0


def _most_signals(steps: Sequence[RunResult], kept: Sequence[RunResult], measured: str) -> str:
    """The condition of a step under which most signals were applied; the first of several."""
    conditions = dict.fromkeys(one.run.condition for one in steps)
    signals = {
        name: {one.run.label for one in kept if (one.run.condition, one.run.measured) == (name, measured)}
        for name in conditions
    }
    return max(conditions, key=lambda name: len(signals[name]))


def _electrical_and(measured: str, strip: Actuator) -> tuple[str, ...]:
    if measured == "current":
        return ("electrical",)
    structure = strip.structure
    modes = structure.displacement_modes if measured == "displacement" else structure.force_modes
    return ("electrical", "coupling", *(("relaxation",) if modes else ()))


def _choice(here: Sequence[RunResult], measured: str, free: tuple[str, ...]) -> Choice:
    ours = [one for one in here if one.run.measured == measured]
    source = min((one for one in ours if _height(one) > 0.0), key=_height)  # the first of those that are as low
    return Choice(source.run.sample, measured, source, free, tuple(one for one in ours if one is not source))


def identify_samples(
    campaign: Campaign,
    folder: Path,
    results: Sequence[RunResult],
    state: State,
    *,
    on_progress: OnProgress = lambda *_: None,
) -> tuple[SampleModel, ...]:
    """Identify and validate the model of each sample of a campaign.

    A fit that is in the folder is read, and what could not be identified is not tried again.

    Parameters
    ----------
    campaign : Campaign
    folder : Path
        Of the campaign: fits go to ``models`` in it.
    results : sequence of RunResult
    state : State
        Gets every model.
    on_progress : callable
        Called with the sample that comes next, and the fraction that is done.
    """
    found: list[SampleModel] = []
    for place, strip in enumerate(campaign.strips if campaign.identify else ()):
        ours = [one for one in results if one.run.sample == strip.sample.id]
        if ours:
            on_progress(strip.sample.id, place / len(campaign.strips))
            found += _of_sample(strip, folder, ours, state)
    return tuple(found)


def _of_sample(strip: Strip, folder: Path, results: Sequence[RunResult], state: State) -> Iterator[SampleModel]:
    sample = strip.sample.id
    if strip.actuator is None:
        yield SampleModel(
            sample, failure="the campaign names no actuator for this sample, which says what its model is"
        )
        return
    stated = _as_measured(strip, load_actuator(strip.actuator), state)
    choices = choose_runs(results, stated)
    if not choices:
        yield SampleModel(sample, failure="no step of a voltage was kept, from which a model is identified")
    model = stated
    for choice in choices:
        try:
            start = _start(model, stated, choice)
            one = _identified(start, _onset(stated), choice, folder / MODELS / f"{choice.name}.toml", state)
        except IpmclabError as error:
            one = SampleModel(sample, choice, failure=error.message)
        yield one
        if one.fit is None:
            return  # the modulus depends on circuit and coupling
        model = one.fit.actuator


def _as_measured(strip: Strip, actuator: Actuator, state: State) -> Actuator:
    """The actuator with the sample, and the sheet resistance that four probes read of it."""
    probed = [one for one in state.of("fact") if (one["sample"], one["name"]) == (strip.sample.id, "sheet resistance")]
    if not probed or SHEET not in actuator.parameter_values:
        return replace(actuator, sample=strip.sample)
    values = {**actuator.parameter_values, SHEET: float(probed[-1]["value"])}
    errors = {**actuator.standard_uncertainties, SHEET: float(probed[-1]["uncertainty"])}
    return replace(
        actuator, sample=strip.sample, parameter_values=values, standard_uncertainties=errors, fit_table=None
    )


def _start(model: Actuator, stated: Actuator, choice: Choice) -> Actuator:
    """What a fit begins with: the leak is in it where a run passes the voltage from which on it gives a current.

    Below it a strip with the leak and one without it are the same, and the one without it is many times as fast.
    """
    structure = stated.structure
    leaks = bool(structure.leak) and _largest(choice.source.record) > _onset(stated)
    values = {**stated.parameter_values, **model.parameter_values}
    errors = {**stated.standard_uncertainties, **model.standard_uncertainties}
    kept = {name: value for name, value in values.items() if leaks or not name.startswith(LEAK)}
    return replace(
        stated,
        parameter_values=kept,
        standard_uncertainties={name: error for name, error in errors.items() if name in kept},
        fit_table=None,
    )


def _onset(actuator: Actuator) -> float:
    structure = actuator.structure
    return Leak(structure.leak, slow=structure.slow_leak).onset(actuator.parameter_values) if structure.leak else np.inf


def _largest(run: Run) -> float:
    return float(np.abs(run.voltage).max())


def _identified(start: Actuator, onset: float, choice: Choice, path: Path, state: State) -> SampleModel:
    """The model of one choice: from its file, or as it failed before, or made now."""
    run = _named(choice.source)
    checksum = run.content_sha256
    before = {one["model"]: one for one in state.of("model") if one["run"] == checksum}.get(choice.name)
    if before is not None and before["failure"]:
        return SampleModel(choice.sample, choice, failure=before["failure"])
    if path.exists():
        fit = _of_file(path, checksum)
    else:
        found = _fitted(start, run, choice.free)
        if isinstance(found, str):
            _entry_of(state, choice, checksum, failure=found)
            return SampleModel(choice.sample, choice, failure=found)
        fit = found
        path.parent.mkdir(exist_ok=True)
        write_fit(fit, path)
    model = SampleModel(choice.sample, choice, path, fit, _validated(fit, choice, onset))
    if before is None:
        _entry_of(state, choice, checksum, scores=model.scores)
    return model


def _fitted(start: Actuator, run: Run, free: Sequence[str]) -> Fit | str:
    """The fit, or why there is none."""
    if len(run) > _MOST_ROWS:
        return f"the run has {len(run)} rows, more than a report waits for; ipmclab identify takes it"
    try:
        return uninterrupted(identify(start, [run], free=free))
    except IpmclabError as error:
        return error.message
    except (ArithmeticError, ValueError) as error:  # a report does not end because one strip is like no other
        return f"the search broke off: {error}"


def _of_file(path: Path, checksum: str) -> Fit:
    fit = read_fit(path)
    if [one for _, one in fit.runs] != [checksum]:
        raise InputError(
            f"{path.name} is a fit of other runs",
            code="file-exists",
            where=str(path),
            repair="move it away; the same command identifies the sample",
        )
    return fit


def _validated(fit: Fit, choice: Choice, onset: float) -> Validation | None:
    """The fit against the runs that were not used for it; one without a leak is compared with none that passes its
    onset."""
    leaks = bool(fit.actuator.structure.leak)
    unseen = [_named(one) for one in choice.unseen if leaks or _largest(one.record) <= onset]
    return validate(fit.actuator, unseen) if unseen else None


def _named(result: RunResult) -> Run:
    return replace(result.record, file=label_of(result))


def _entry_of(
    state: State, choice: Choice, checksum: str, *, scores: Mapping[str, float] | None = None, failure: str = ""
) -> None:
    entry: dict[str, Any] = {"sample": choice.sample, "model": choice.name, "of": choice.source.run.id, "run": checksum}
    state.add("model", **entry, scores=dict(scores or {}), failure=failure)
