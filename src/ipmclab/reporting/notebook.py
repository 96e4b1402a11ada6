"""What a notebook shows of a run, an actuator, a fit and what follows from them: a small table and a figure."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import singledispatch
from html import escape
from typing import Final

from matplotlib.figure import Figure

from ipmclab.choosing.choice import Choice
from ipmclab.fit.answer import IN_PYTHON, answer_of
from ipmclab.fit.fit import Fit
from ipmclab.fit.in_brief import more_in_words
from ipmclab.forecasting.forecast_values import Forecast
from ipmclab.model import Actuator, simulate
from ipmclab.prediction.validate import Validation, run_labels
from ipmclab.quality import check
from ipmclab.reporting.drawn import drawn_outputs
from ipmclab.reporting.figures.choice import choice_figure
from ipmclab.reporting.figures.panels import band, curve, name_panel, series, stacked
from ipmclab.reporting.figures.prediction import prediction_figure
from ipmclab.reporting.figures.runs import runs_figure
from ipmclab.reporting.style import style
from ipmclab.reporting.svg import inline_svg, standalone_svg
from ipmclab.reporting.wording import spelled_unit
from ipmclab.run import Finding, Run
from ipmclab.units import CHANNELS, Quantity

_MOST_ROWS: Final = 40
_STEP: Final = "step 1 V"
_SHOWN_SECONDS: Final = 20.0  # of an actuator's answer
_SHOWN_RATE: Final = 25.0  # Hz

_counter = itertools.count(1)


@singledispatch
def html_of(value: object) -> str:
    """A value as the HTML that a notebook shows."""
    return f"<pre>{escape(str(value))}</pre>"


@html_of.register
def _run(run: Run) -> str:
    findings = check(run)
    figure = runs_figure([run], run_labels([run]), [findings])
    return _block(str(run), _findings(findings), _svg(figure, str(run)))


@html_of.register
def _actuator(actuator: Actuator) -> str:
    parameters = actuator.parameters()
    rows = [
        [one.symbol or name, name, _number(one.value, one.quantity), one.quantity.display_unit]
        for name, one in parameters.items()
    ]
    run = simulate(actuator, _STEP, duration=_SHOWN_SECONDS, rate=_SHOWN_RATE)
    text = f"{actuator.name} under {_STEP}"
    figure = runs_figure([run], [text], [()])
    return _block(actuator.name, _table(["symbol", "parameter", "value", "unit"], rows), _svg(figure, text))


@html_of.register
def _fit(fit: Fit) -> str:
    answer = answer_of(fit)
    rows = [
        [one.name, one.value, one.interval, spelled_unit(one.unit), one.remark]
        for group in answer.rows
        for one in group
    ]
    lines = [[one.severity, one.text] for one in answer.findings]
    more = f"<p>{escape(more_in_words(answer.more, IN_PYTHON))}</p>" if answer.more else ""
    step = simulate(fit.actuator, _STEP, duration=_SHOWN_SECONDS, rate=_SHOWN_RATE)
    text = f"{fit.actuator.name} under {_STEP}, as fitted"
    figure = runs_figure([step], [text], [()])
    table = "" if answer.is_refused else _table(["parameter", "value", "95 % interval", "unit", ""], rows)
    findings = (_table(["severity", "finding"], lines) if lines else "") + more
    return _block(
        f"{fit.actuator.name}, fitted to {len(fit.observations)} run(s)",
        f"{table}<p>{escape(answer.verdict)}</p>{findings}",
        _svg(figure, text),
    )


@html_of.register
def _validation(validation: Validation) -> str:
    rows = []
    for run in validation.runs:
        for name, score in run.scores.items():
            rmse = "" if score.rmse is None else f"{_number(score.rmse, CHANNELS[name])} {CHANNELS[name].display_unit}"
            rows.append([run.label, name, score.fit_text, rmse, "used in the fit" if run.used_in_fit else ""])
    first = validation.runs[0]
    text = f"{first.label}: measured and predicted"
    drawn, sentence = drawn_outputs([validation.actuator], first.comparisons)
    figure = _svg(prediction_figure(first.run, {validation.actuator.name: drawn}), text) if drawn else ""
    figure += f"<p>{escape(sentence)}</p>" if sentence else ""
    table = _table(["run", "output", "fit", "RMSE", ""], rows)
    return _block(f"{validation.actuator.name} against {len(validation.runs)} run(s)", table, figure)


@html_of.register
def _choice(choice: Choice) -> str:
    rows = [
        [
            one.name,
            f"{one.log_predictive:.1f}" if one.log_predictive is not None else "",
            "preferred" if one.name == choice.preferred else "",
        ]
        for one in choice.candidates
    ]
    table = _table(["model", "log predictive", ""], rows)
    return _block(f"{choice.preferred} is preferred", table, _svg(choice_figure(choice), "models, ranked"))


@html_of.register
def _forecast(forecast: Forecast) -> str:
    quantity = CHANNELS[forecast.channel]
    last = len(forecast.time) - 1
    rows = [
        [
            f"{forecast.time[k]:.4g} s",
            *(_number(float(values[k]), quantity) for values in (forecast.lower, forecast.mean, forecast.upper)),
        ]
        for k in sorted({0, last // 2, last})
    ]
    with style():
        figure, (panel,) = stacked([1.6])
        middle, reach = 0.5 * (forecast.upper + forecast.lower), 0.5 * (forecast.upper - forecast.lower)
        band(panel, forecast.channel, forecast.time, middle, reach)
        curve(panel, forecast.channel, forecast.time, forecast.mean, **series(0))
        name_panel(panel, forecast.channel, quantity)
    table = _table(["time", "from", f"{forecast.channel} ({quantity.display_unit})", "to"], rows)
    text = f"{forecast.channel} from {forecast.origin:g} s on"
    return _block(text, f"{table}<p>{escape(forecast.made_of)}</p>", _svg(figure, text))


def _number(value: float, quantity: Quantity | None) -> str:
    return f"{value if quantity is None else quantity.to_display(value):.4g}"


def _findings(findings: Sequence[Finding]) -> str:
    return (
        _table(["finding", "severity", "what"], [[one.code, one.severity, one.message] for one in findings])
        if findings
        else ""
    )


def _table(headers: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(text)}</th>" for text in headers)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows[:_MOST_ROWS])
    more = f"<p>and {len(rows) - _MOST_ROWS} more</p>" if len(rows) > _MOST_ROWS else ""
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{more}"


def _svg(figure: Figure, caption: str) -> str:
    """The figure in colours of its own; its ids are its own among all of a notebook."""
    return standalone_svg(str(inline_svg(figure, f"ipmclab-{next(_counter)}", caption)))


def _block(title: str, table: str, figure: str) -> str:
    return f'<div style="max-width: 60em"><p><b>{escape(title)}</b></p>{table}{figure}</div>'
