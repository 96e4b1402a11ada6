"""``ipmclab validate``: actuators against runs they were not identified from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from ipmclab.cli.files import labels, named_by_file, read_runs
from ipmclab.cli.options import ActuatorName, Details, Json, RunFiles
from ipmclab.cli.output import (
    finding_document,
    print_json,
    print_most_important,
    print_paragraph,
    print_table,
    progress,
    read,
    significant,
)
from ipmclab.units import CHANNELS, TIME

if TYPE_CHECKING:
    from ipmclab.prediction.scores import Score
    from ipmclab.prediction.validate import Validation


_ALL: Final = "all runs"


def validate(
    actuator: ActuatorName,
    runs: RunFiles,
    also: Annotated[
        list[str] | None, typer.Option(metavar="ACTUATOR", help="Another actuator to compare with; may be repeated.")
    ] = None,
    details: Details = False,
    as_json: Json = False,
) -> None:
    """Predict runs from their voltage alone and hold the prediction against what was measured.

    \b
    ipmclab validate fitted.toml square.nc --also friend-2
    """
    from ipmclab.prediction.validate import validate as validate_actuator

    names = [actuator, *(also or [])]
    models = [named_by_file(name) for name in names]
    loaded = read_runs(runs)
    with progress("predicting"):
        validations = [validate_actuator(model, loaded) for model in models]
    if as_json:
        print_json({"validations": [validation_document(*each, runs) for each in zip(names, validations, strict=True)]})
    else:
        print_validations(names, validations, runs, details=details)


def print_validations(
    names: Sequence[str],
    validations: Sequence[Validation],
    runs: Sequence[Path],
    *,
    details: bool = False,
    where: str = "--details",
) -> None:
    """Print the scores of one or several actuators on the same runs, side by side; ``where`` other findings stand."""
    from ipmclab.prediction.verdict import verdict_of

    places = [
        (label, [validation.runs[index].scores for validation in validations])
        for index, label in enumerate(labels(runs))
    ]
    if len(runs) > 1:
        places.append((_ALL, [validation.scores for validation in validations]))
    headers = ["run", "output", "fit", "RMSE", "of range", "largest error", "at", "lags outside"]
    if any(score.inside_band is not None for _, of_each in places for scores in of_each for score in scores.values()):
        headers.append("in 95 % band")
    rows: list[list[str]] = []
    missing: dict[tuple[str, str], list[str]] = {}
    for place, of_each in places:
        for output in of_each[0]:
            for name, scores in zip(names, of_each, strict=True):
                score = scores[output]
                if score.fit_percent is None:
                    missing.setdefault((CHANNELS[output].name, score.reason), []).append(place)
                else:
                    cells = _cells(score)[: len(headers) - 2]
                    rows.append([place, CHANNELS[output].name, *cells, *([name] if len(names) > 1 else [])])
    if rows:
        print_table(headers + (["actuator"] if len(names) > 1 else []), rows)
    for (output, reason), where_missing in missing.items():
        of_runs = ", ".join(dict.fromkeys(place for place in where_missing if place != _ALL))
        print_paragraph(f"No score of {output} in {of_runs or _ALL}: {reason}.")
    for name, validation in zip(names, validations, strict=True):
        verdict = verdict_of(validation)
        if validation.findings or verdict.sentences:
            print(f"{name}:")
            for sentence in verdict.sentences:
                print_paragraph(sentence)
            run_labels = [one.label for one in validation.runs]
            print_most_important(validation.findings, details=details, labels=run_labels, where=where)


def _warnings(validation: Validation) -> list[str]:
    """Where the predictions leave what the model holds for, with the runs."""
    from ipmclab.model.validity import sentence

    return [f"{one.label}: {sentence(found)}" for one in validation.runs for found in one.predicted.metadata.findings]


def _cells(score: Score) -> list[str]:
    quantity = CHANNELS[score.output]
    percent = f"{significant(score.rmse_percent_of_range, 2)} %" if score.rmse_percent_of_range is not None else "-"
    return [
        score.fit_text,
        read(score.rmse, quantity, digits=3),
        percent,
        read(score.max_error, quantity, digits=3),
        read(score.max_error_time, TIME),
        f"{100.0 * score.lags_outside:.0f} %" if score.lags_outside is not None else "-",
        f"{100.0 * score.inside_band:.0f} %" if score.inside_band is not None else "-",
    ]


def validation_document(name: str, validation: Validation, runs: Sequence[Path]) -> dict[str, Any]:
    """A validation as it is written to a JSON document; ``name`` is what the user called the actuator."""
    from ipmclab.prediction.verdict import verdict_of

    document: dict[str, Any] = validation.as_dict() | {"actuator": name}
    document["runs"] = [{"run": path} | run for path, run in zip(runs, document["runs"], strict=True)]
    document["warnings"] = _warnings(validation)
    document["verdict"] = verdict_of(validation).sentences
    document["findings"] = [finding_document(finding) for finding in validation.findings]
    return document
