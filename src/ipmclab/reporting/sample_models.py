"""The identified model of a sample in the report of its campaign: parameters, scores, a figure, findings."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from markupsafe import Markup

from ipmclab.campaign.identified import Choice, SampleModel, label_of
from ipmclab.campaign.state import MODELS
from ipmclab.fit.in_brief import Brief, in_brief
from ipmclab.prediction.run_validation import RunValidation
from ipmclab.reporting.figures.campaign import MOST_COLUMNS, predicted_figure
from ipmclab.reporting.svg import inline_svg
from ipmclab.reporting.tables import ParameterRow, known_rows, parameter_rows
from ipmclab.reporting.wording import percent
from ipmclab.run import Finding
from ipmclab.units import CHANNELS

_ANOTHER: Final = 80.0
"""Fit of the current [percent] below which the strip, or its contact, is not as it was."""

_MOUNTING: Final = "another-mounting"
"""A campaign that mounts the strip for each run has this finding for each of them."""


@dataclass(frozen=True)
class ModelPart:
    """What a report says of one model of a sample.

    Parameters
    ----------
    sentences : tuple of str
    doubt : bool
        Whether there is none, or a channel that it fails to predict.
    parameters : tuple of ParameterRow
        With what else is known.
    head, scores : tuple of str, tuple of (str, tuple of str)
        The channels; each run that was not used for it with the score of each.
    picture : Markup, optional
    findings : tuple of Brief
        One line each.
    more : str
        How many others there are, and where.
    """

    sentences: tuple[str, ...]
    doubt: bool
    parameters: tuple[ParameterRow, ...] = ()
    head: tuple[str, ...] = ()
    scores: tuple[tuple[str, tuple[str, ...]], ...] = ()
    picture: Markup | None = None
    findings: tuple[Brief, ...] = ()
    more: str = ""


def model_part(model: SampleModel) -> ModelPart:
    """The part of a report that is about one model."""
    if model.fit is None or model.choice is None or model.path is None:
        of = "" if model.choice is None else f" from {label_of(model.choice.source)}"
        return ModelPart((f"No model was identified{of}: {model.failure}.",), doubt=True)
    runs = () if model.validation is None else model.validation.runs
    outputs = [] if model.validation is None else list(model.validation.scores)
    fitted = [name for one in model.fit.observations for name in one.noise]
    lines, more = in_brief(model.fit.findings, fitted, [label for label, _ in model.fit.runs])
    new = () if model.validation is None else in_brief(_fresh(model.validation.findings, model.fit.findings))[0]
    shown = _kinds(runs)
    return ModelPart(
        sentences=tuple(_sentences(model)),
        doubt=any(score <= 0.0 for score in model.scores.values()),
        parameters=(*parameter_rows(model.fit), *known_rows(model.fit)),
        head=tuple(CHANNELS[name].name for name in outputs),
        scores=tuple((one.label, tuple(_score(one, name) for name in outputs)) for one in runs),
        picture=inline_svg(
            predicted_figure(shown, outputs),
            re.sub(r"[^A-Za-z0-9]+", "-", f"model-{model.choice.name}"),
            f"{model.sample}, measured and predicted",
        )
        if shown
        else None,
        findings=(*lines, *new),
        more=_more(more, model.choice, model.path.name) if more else "",
    )


def _sentences(model: SampleModel) -> Iterator[str]:
    assert model.fit is not None
    assert model.choice is not None
    assert model.path is not None
    found = "The modulus was" if model.choice.is_of_modulus else "Circuit and coupling were"
    if model.choice.measured == "current":
        found = "The circuit was"
    where = f"{MODELS}/{model.path.name}"
    yield f"{found} identified from {label_of(model.choice.source)} {_at(model.choice.source.run.condition)} ({where})."
    if model.validation is None:
        yield "No other run is there that it could predict."
        return
    runs = f"{len(model.validation.runs)} run{'s' * (len(model.validation.runs) > 1)}"
    good = [f"{name} with a fit of {percent(score)}" for name, score in model.scores.items() if score > 0.0]
    bad = [f"{name} ({percent(score)})" for name, score in model.scores.items() if score <= 0.0]
    if good:
        yield f"From the voltage alone it predicts {runs} that were not used to identify it: {', '.join(good)}."
    if bad:
        yield f"It does not predict {', '.join(bad)} of {runs}: a constant would have been nearer."
    if any(one.code == _MOUNTING and one.severity == "warning" for one in model.validation.findings):
        yield "They are of other mountings of the strip: how far these differ is not in the 95 % band."
    current = model.validation.scores.get("current")
    if current is not None and current.fit_percent is not None and current.fit_percent < _ANOTHER:
        yield (
            f"The current of these runs is not the one that the model has (fit {percent(current.fit_percent)}): the "
            "contact at the clamp, or the state of the strip, was another one."
        )


def _at(condition: str) -> str:
    return "in the room" if condition == "room" else f"at {condition}"


def _score(one: RunValidation, output: str) -> str:
    score = one.scores.get(output)
    if score is None:
        return "–"
    inside = "" if score.inside_band is None else f" ({100.0 * score.inside_band:.0f} % in the band)"
    return percent(score.fit_percent) + inside


def _kinds(runs: Sequence[RunValidation]) -> list[RunValidation]:
    """The first run of each signal, as many as a figure holds."""
    found: dict[str, RunValidation] = {}
    for one in runs:
        found.setdefault(one.run.metadata.signal or one.label, one)
    return list(found.values())[:MOST_COLUMNS]


def _fresh(findings: Sequence[Finding], before: Sequence[Finding]) -> list[Finding]:
    """What the prediction found that the fit did not say already."""
    said = {_MOUNTING, *(one.code for one in before)}
    return [one for one in findings if one.code not in said]


def _more(count: int, choice: Choice, file: str) -> str:
    what = f"{count} more finding{'s' * (count > 1)}"
    # Beside the model: in the folder of the report a sample called report would take its place.
    command = f"ipmclab report {MODELS}/{file} --runs {choice.source.path} --out {MODELS}/{Path(file).stem}.html"
    return f"{what}: {command}, in the folder of this report, shows {'them' if count > 1 else 'it'}"
