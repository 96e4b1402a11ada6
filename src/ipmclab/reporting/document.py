"""The report of a fit: one HTML file that carries everything with it."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from markupsafe import Markup, escape

from ipmclab.errors import InputError
from ipmclab.fit.answer import known_title
from ipmclab.fit.in_brief import most_important_first
from ipmclab.fit.rows import listed
from ipmclab.fit.verdict import lacks_something
from ipmclab.kinds import tell_kinds
from ipmclab.model.validity import CODES as VALIDITY_CODES
from ipmclab.model.validity import SMALL_BENDING
from ipmclab.prediction.fitted import fitted_outputs
from ipmclab.prediction.scores import LAGS, Comparison
from ipmclab.prediction.validate import Validation, run_labels, validate
from ipmclab.quality import check, measure
from ipmclab.reporting import tables
from ipmclab.reporting.diagnoses import diagnoses_part
from ipmclab.reporting.drawn import drawn_outputs
from ipmclab.reporting.figures.frequency import frequency_figure
from ipmclab.reporting.figures.prediction import prediction_figure
from ipmclab.reporting.figures.residuals import autocorrelation_figure
from ipmclab.reporting.figures.shape import shape_figure
from ipmclab.reporting.fit_verdict import verdict
from ipmclab.reporting.many_runs import many_runs_part
from ipmclab.reporting.micrographs import micrographs
from ipmclab.reporting.page_file import render, write_page
from ipmclab.reporting.profiles import profiles_part
from ipmclab.reporting.svg import inline_svg
from ipmclab.reporting.wording import NO_BREAK, plain, with_unit
from ipmclab.run import Finding, Run
from ipmclab.units import CHANNELS
from ipmclab.version import __version__

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit
    from ipmclab.model import Actuator
    from ipmclab.quality import Metric

_PARTS: Final = ("numpy", "scipy", "numba", "matplotlib")


@dataclass(frozen=True)
class Picture:
    """A figure of the report."""

    title: str
    svg: Markup
    caption: str


@tell_kinds
def report(
    fit: Fit,
    *,
    runs: Sequence[Run],
    validation_runs: Sequence[Run] = (),
    path: str | Path,
    also: Sequence[Actuator] = (),
    command: str = "",
    overwrite: bool = False,
) -> Path:
    """Write one self-contained HTML file about a fit: it needs no network and no script.

    Parameters
    ----------
    fit : Fit
        What ``identify`` returned.
    runs : sequence of Run
        The runs it was identified from, in the order of the call.
    validation_runs : sequence of Run
        Runs to predict.
    path : str or Path
        Where the report goes, ending in .html.
    also : sequence of Actuator
        Other models, compared with the same validation runs side by side.
    command : str
        How the report was asked for, kept in it.
    overwrite : bool
        Whether an existing file may be replaced.

    Returns
    -------
    path : Path

    Raises
    ------
    InputError
        Runs that are not those of the fit, another suffix, a folder that does not exist, or a
        file that does.

    Examples
    --------
    >>> import tempfile
    >>> from ipmclab import identify, load_actuator, simulate
    >>> actuator = load_actuator("friend-2")
    >>> step = simulate(actuator, "step 1 V", duration=20.0, rate=50.0)
    >>> square = simulate(actuator, "square 1 V 0.1 Hz", duration=20.0, rate=50.0)
    >>> fit = identify(actuator, step, free="electrical")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     report(fit, runs=[step], validation_runs=[square], path=Path(folder) / "report.html").name
    'report.html'
    """
    return write_page(lambda: html(fit, runs, validation_runs, also=also, command=command), path, overwrite=overwrite)


def html(
    fit: Fit,
    runs: Sequence[Run],
    validation_runs: Sequence[Run] = (),
    *,
    also: Sequence[Actuator] = (),
    command: str = "",
) -> str:
    """The text of the report; its arguments are those of ``report``."""
    _same_runs(fit, runs)
    labels = [observation.label for observation in fit.observations]
    fitted = [fitted_outputs(fit, run, place) for place, run in enumerate(runs)]
    hashes = [observation.content_sha256 for observation in fit.observations]
    models = (fit.actuator, *also)
    validations = [validate(model, validation_runs, used=hashes) for model in models] if validation_runs else []
    sentences, doubt = verdict(fit, validations)
    measured = [measure(run) for run in runs]
    measured_later = [measure(run) for run in validation_runs]
    return render(
        "template.html.j2",
        {"symbol": symbol},
        title=f"{fit.actuator.name}: from records to a model",
        subtitle=_subtitle(fit, runs),
        verdict=sentences,
        doubt=doubt,
        parameters=tables.parameter_rows(fit),
        known=tables.known_rows(fit),
        known_title=known_title(fit),
        truth="the value that describes this model" if lacks_something(fit) else "the true value",
        undetermined=[direction.sentence for direction in fit.undetermined],
        correlations=tables.correlation_table(fit),
        profiles=profiles_part(fit),
        remarks=any(row.remark for row in tables.parameter_rows(fit)),
        next_known=any(one.interval_next_mounting for one in fit.parameters.values()),
        fixed=tables.fixed_rows(fit.actuator, list(fit.parameters)),
        validation=_validation_part(validations),
        fit_rows=tables.fit_rows(fit, fitted),
        # What is undetermined is under the parameters already.
        fit_findings=most_important_first(
            [finding for finding in fit.findings if finding.code != "undetermined"],
            {name for one in fit.observations for name in one.noise},
        ),
        fit_figures=[
            *(_fit_picture(*each, fit.actuator) for each in zip(range(len(runs)), runs, labels, fitted, strict=True)),
            *_shapes(fit.actuator, list(zip(runs, labels, fitted, strict=True)), "fit-shape"),
        ],
        diagnoses=diagnoses_part(fit),
        frequency=_frequency_part(models, runs),
        procedure=_procedure_part(fit),
        many_runs=many_runs_part(fit),
        records=[
            *_records(runs, labels, measured, "identified from", fit.findings),
            *_records(validation_runs, run_labels(validation_runs), measured_later, "predicted"),
        ],
        definitions=tables.definitions(metric for metrics in (*measured, *measured_later) for metric in metrics),
        sample=tables.sample_facts(fit.actuator, runs),
        micrographs=list(micrographs(tables.sample_of(fit.actuator, runs))),
        making=_making(fit, command),
    )


def _procedure_part(fit: Fit) -> Markup:
    """The steps that came before a joint fit; nothing for other fits."""
    if fit.procedure is None:
        return Markup()
    return Markup(render("procedure.html.j2", {"symbol": symbol}, **fit.procedure))


def symbol(text: str) -> Markup:
    """A symbol with its index set low.

    Examples
    --------
    >>> symbol("ρ_dc")
    Markup('ρ<sub>dc</sub>')
    """
    letter, _, index = text.partition("_")
    return Markup("{}<sub>{}</sub>").format(letter, index) if index else escape(text)


def _same_runs(fit: Fit, runs: Sequence[Run]) -> None:
    expected = [observation.content_sha256 for observation in fit.observations]
    given = [run.content_sha256 for run in runs]
    if given == expected:
        return
    place = next((k for k, pair in enumerate(zip(given, expected, strict=False)) if pair[0] != pair[1]), None)
    if place is None:
        raise InputError(
            f"{len(given)} runs given, {len(expected)} made the fit",
            code="other-runs",
            where="runs",
            repair=f"give {listed([one.label for one in fit.observations])}, in this order",
        )
    raise InputError(
        f"run {place} is not {fit.observations[place].label}, from which the fit was made: its content is another "
        f"(SHA-256 {given[place][:12]}..., expected {expected[place][:12]}...)",
        code="other-runs",
        where=f"runs[{place}]",
        repair="give the runs of the fit in the order of identify",
    )


def _subtitle(fit: Fit, runs: Sequence[Run]) -> str:
    outputs = [name for name in CHANNELS if any(name in one.noise for one in fit.observations)]
    count = f"{len(runs)} run{'s' if len(runs) > 1 else ''}"
    sample = f" of sample {fit.actuator.sample.id}" if fit.actuator.sample else ""
    return f"Identified from {listed(outputs)} in {count}{sample}, {len(fit.parameters)} parameters free."


def _validation_part(validations: Sequence[Validation]) -> dict[str, Any] | None:
    if not validations:
        return None
    actuators = [validation.actuator for validation in validations]
    names, pictures = _model_names(actuators), []
    drawn = [drawn_outputs(actuators, one.comparisons) for one in validations[0].runs]
    for place, (one, (comparisons, not_drawn)) in enumerate(zip(validations[0].runs, drawn, strict=True)):
        models = {
            name: {output: other.runs[place].comparisons[output] for output in comparisons}
            for name, other in zip(names, validations, strict=True)
        }
        pictures.append(
            Picture(
                one.label,
                inline_svg(
                    prediction_figure(one.run, models),
                    f"prediction-{place}",
                    f"Measured and predicted {listed(comparisons)} of {one.label} over time, with the errors",
                ),
                f"{one.label}: measured (grey) and predicted from the voltage alone, with the error below."
                f"{_banded(comparisons)} {not_drawn}",
            )
        )
    pictures += _shapes(
        validations[0].actuator,
        [(one.run, one.label, found) for one, (found, _) in zip(validations[0].runs, drawn, strict=True)],
        "shape",
    )
    lags = [
        (run.label, score)
        for run, (found, _) in zip(validations[0].runs, drawn, strict=True)
        for output, score in run.scores.items()
        if output in found and len(score.autocorrelation)
    ]
    if lags:
        pictures.append(
            Picture(
                "What the errors remember",
                inline_svg(autocorrelation_figure(lags), "memory", "Autocorrelation of each prediction error"),
                f"Autocorrelation of the prediction errors of {names[0]}. White noise stays within the band in "
                f"95{NO_BREAK}% of the lags; what is outside is something that the model does not know.",
            )
        )
    rows = tables.score_rows(validations, names)
    return {
        "several_models": len(validations) > 1,
        "rows": rows,
        "remarks": any(row.remark for row in rows),
        "figures": pictures,
        "lags": LAGS,
        "banded": any(score.inside_band is not None for one in validations for score in one.scores.values()),
        "unseen": not any(one.used_in_fit or one.rows_in_fit for one in validations[0].runs),
        "findings": _findings_of_each(names, validations),
    }


def _findings_of_each(names: Sequence[str], validations: Sequence[Validation]) -> list[tuple[str, Sequence[Finding]]]:
    """What was found for each model, under its name; once, without a name, where it is the same for all."""
    found = [validation.findings for validation in validations]
    if all(one == found[0] for one in found):
        return [("", found[0])] if found[0] else []
    return [(name, one) for name, one in zip(names, found, strict=True) if one]


def _fit_picture(
    place: int, run: Run, label: str, comparisons: Mapping[str, Comparison], actuator: Actuator
) -> Picture:
    comparisons, not_drawn = drawn_outputs([actuator], comparisons)
    return Picture(
        label,
        inline_svg(
            prediction_figure(run, {"model": comparisons}),
            f"fit-{place}",
            f"Measured and modelled {listed(comparisons)} of {label} over time, with the residuals",
        ),
        f"{label}: measured (grey) and fitted model, with what is left over below.{_banded(comparisons)} {not_drawn}",
    )


def _banded(comparisons: Mapping[str, Comparison]) -> str:
    wide = [
        f"±{with_unit(float(np.nanmedian(one.reach)), CHANNELS[output])} of {CHANNELS[output].name}"
        for output, one in comparisons.items()
        if one.reach is not None and np.isfinite(one.reach).any()
    ]
    if not wide:
        return ""
    return (
        " Shaded: where 95 % of the readings should lie, for the errors of the parameters and the noise; its median is "
        f"{listed(wide)}. A band that is much wider than the record ends at the edge of its panel."
    )


def _shapes(
    actuator: Actuator, runs: Sequence[tuple[Run, str, Mapping[str, Comparison]]], name: str
) -> Iterator[Picture]:
    """The strip from the side, for the runs in which it bends far."""
    small = SMALL_BENDING * actuator["geometry.free_length"]
    for place, (run, label, comparisons) in enumerate(runs):
        one = comparisons.get("displacement")
        if one is None or not np.nanmax(np.abs(one.predicted), initial=0.0) > small:
            continue
        held = replace(run, hold="zero") if run.hold == "unknown" else run  # a part of a row changes no shape
        yield Picture(
            f"{label}: the strip from the side",
            inline_svg(
                shape_figure(actuator, held), f"{name}-{place}", f"The shape of the strip at some times of {label}"
            ),
            f"{label}: how far the modelled strip bends, to scale, from rest and without the beam's inertia. A dot is "
            "what a laser reads; a dashed strip has left it.",
        )


def _model_names(models: Sequence[Actuator]) -> list[str]:
    """A name for each model, no two alike; the first is that of the fit."""
    names = [model.name for model in models]
    if names.count(names[0]) > 1:
        names[0] = f"{names[0]} (this fit)"
    return [f"{name} [{place}]" if names.count(name) > 1 else name for place, name in enumerate(names)]


def _frequency_part(models: Sequence[Actuator], runs: Sequence[Run]) -> Picture:
    slowest = min(1.0 / (run.time[-1] - run.time[0]) for run in runs)
    fastest = max(run.rate / 2 for run in runs)
    frequency = np.geomspace(min(1e-3, slowest / 2), max(100.0, 2 * fastest), 600)
    outputs = ("current", "displacement", "force")
    names = _model_names(models)
    responses = {
        name: dict(zip(outputs, model.frequency_response(frequency, outputs), strict=True))
        for name, model in zip(names, models, strict=True)
    }
    figure = frequency_figure(frequency, responses, covered=(slowest, fastest))
    return Picture(
        "Frequency response",
        inline_svg(figure, "frequency-response", "Gain and phase of current, displacement and force over frequency"),
        f"Gain and phase of each output against the applied voltage, of {listed(names)}. The runs of the fit lie "
        f"between {plain(slowest)} Hz (their length) and {plain(fastest, trim=True)} Hz (half their rate); what is "
        "shaded is extrapolated.",
    )


def _records(
    runs: Sequence[Run],
    labels: Sequence[str],
    measured: Sequence[Sequence[Metric]],
    role: str,
    said: Sequence[Finding] = (),
) -> list[dict[str, Any]]:
    """The part on each record; where a model left what it holds for, not again what ``said`` says of that record."""
    beyond = {finding.message for finding in said if finding.code in VALIDITY_CODES}
    return [
        {
            "label": label,
            "role": role,
            "facts": [("role", role), *tables.run_facts(run)],
            "findings": [one for one in check(run) if f"{label}: {one.message}" not in beyond],
            "metrics": tables.metric_rows(metrics),
            "sha256": run.content_sha256,
        }
        for run, label, metrics in zip(runs, labels, measured, strict=True)
    ]


def _making(fit: Fit, command: str) -> list[tuple[str, str]]:
    made = [
        ("command", command),
        ("written", datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")),
        ("search", f"{fit.message} ({fit.evaluations} evaluations of the model)" if fit.evaluations else fit.message),
        ("identified by", f"ipmclab {fit.software_version}" if fit.software_version else ""),
        ("report by", f"ipmclab {__version__}"),
        ("with", ", ".join([f"Python {platform.python_version()}", *(f"{name} {version(name)}" for name in _PARTS)])),
    ]
    return [(name, value) for name, value in made if value]
