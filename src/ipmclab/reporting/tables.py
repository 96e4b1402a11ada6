"""The rows of a report's tables: every number already as people read it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ipmclab.fit.rows import quantity_of
from ipmclab.prediction.remarks import remarks
from ipmclab.prediction.scores import Comparison, Score, score
from ipmclab.prediction.validate import Validation
from ipmclab.quality.noise import noise_level
from ipmclab.reporting.wording import (
    NO_BREAK,
    NOT_DETERMINED,
    estimate,
    interval,
    percent,
    plain,
    spelled_unit,
    with_error,
    with_unit,
)
from ipmclab.run import Run, RunMetadata
from ipmclab.units import ANGLE, CHANNELS

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit, FittedParameter
    from ipmclab.model import Actuator
    from ipmclab.quality import Metric
    from ipmclab.sample import Sample


@dataclass(frozen=True)
class ParameterRow:
    """One parameter of a table."""

    name: str
    symbol: str
    value: str
    unit: str
    uncertainty: str = ""
    interval: str = ""
    remark: str = ""
    determined: bool = True
    next_mounting: str = "–"


@dataclass(frozen=True)
class ScoreRow:
    """One output of one run, predicted by one model."""

    output: str
    run: str
    model: str
    fit: str
    rmse: str
    of_range: str
    max_error: str
    where: str
    lags: str
    inside: str
    samples: str
    remark: str
    pooled: bool = False


@dataclass(frozen=True)
class FitRow:
    """One output of one run of the fit."""

    run: str
    output: str
    fit: str
    rmse: str
    of_range: str
    noise: str
    samples: str


@dataclass(frozen=True)
class Cell:
    """One coefficient of the correlation table, with its shade."""

    text: str
    colour: str


@dataclass(frozen=True)
class CorrelationRow:
    """The coefficients of one parameter, up to and with its own column."""

    name: str
    cells: tuple[Cell, ...]


@dataclass(frozen=True)
class CorrelationTable:
    """The lower half of the correlation matrix."""

    symbols: tuple[str, ...]
    rows: tuple[CorrelationRow, ...]


@dataclass(frozen=True)
class MetricRow:
    """One metric of a record."""

    name: str
    channel: str
    value: str
    unit: str
    interval: str


def parameter_rows(fit: Fit) -> list[ParameterRow]:
    """The free parameters: one that the runs do not determine is called so, and has no number."""
    rows = []
    said = remarks(fit)
    for name, one in fit.parameters.items():
        quantity = quantity_of(fit, name)
        shown: Callable[[float], float] = quantity.to_display if quantity else float
        unit = spelled_unit(quantity.display_unit if quantity else one.unit)
        rows.append(
            ParameterRow(
                name,
                symbol_of(one),
                with_error(shown(one.value), shown(one.standard_error)) if one.determined else NOT_DETERMINED,
                unit,
                interval=interval(*map(shown, one.interval)),
                remark=said[name],
                determined=one.determined,
                next_mounting=interval(*map(shown, one.interval_next_mounting)) if one.interval_next_mounting else "–",
            )
        )
    return rows


def known_rows(fit: Fit) -> list[ParameterRow]:
    """The quantities that the readings determine, whatever they leave open of the parameters."""
    rows = []
    for one in fit.known:
        shown = one.quantity.to_display
        low, high = map(shown, one.interval)
        rows.append(
            ParameterRow(
                one.words,
                "",
                estimate(shown(one.value), (low, high)),
                spelled_unit(one.quantity.display_unit),
                interval=interval(low, high),
                remark=f"if {' and '.join(one.leans)} {'is' if len(one.leans) == 1 else 'are'} exact"
                if one.leans
                else "",
            )
        )
    return rows


def symbol_of(parameter: FittedParameter) -> str:
    """The symbol of a parameter, with the run that it belongs to; its name where it has none."""
    base, bracket, place = parameter.name.partition("[")
    symbol = parameter.symbol or base.rsplit(".", 1)[-1]
    return f"{symbol}{bracket}{place}"


def correlation_table(fit: Fit) -> CorrelationTable | None:
    """Correlations of the estimates, of those that have one with another; None where no two have any."""
    names = [
        name
        for name, row in fit.correlations.items()
        if any(math.isfinite(value) for other, value in row.items() if other != name)
    ]
    if not names:
        return None
    symbols = tuple(symbol_of(fit.parameters[name]) for name in names)
    rows = []
    for place, name in enumerate(names):
        cells = tuple(_cell(fit.correlations[name][other]) for other in names[: place + 1])
        rows.append(CorrelationRow(name, cells))
    return CorrelationTable(symbols, tuple(rows))


def _cell(value: float) -> Cell:
    if not math.isfinite(value):
        return Cell("–", "transparent")
    hue = "0, 114, 178" if value > 0 else "213, 94, 0"
    text = f"{value:.2f}".replace("-", "" if abs(value) < 0.005 else "−")
    return Cell(text, f"rgba({hue}, {0.6 * abs(value):.2f})")


def fit_rows(fit: Fit, fitted: Sequence[Mapping[str, Comparison]]) -> list[FitRow]:
    """How each output of each run was met by the fit, with the noise of its neighbouring readings."""
    rows = []
    for observation, comparisons in zip(fit.observations, fitted, strict=True):
        for output, comparison in comparisons.items():
            one = score(output, [comparison])
            quantity = CHANNELS[output]
            noise = noise_level(comparison.measured[comparison.used])
            samples = f"{one.samples}" + (f" ({one.left_out} left out)" if one.left_out else "")
            rows.append(
                FitRow(
                    observation.label,
                    quantity.name,
                    percent(one.fit_percent),
                    with_unit(one.rmse, quantity),
                    _of_range(one),
                    with_unit(noise, quantity),
                    samples,
                )
            )
    return rows


def _of_range(one: Score) -> str:
    return "–" if one.rmse_percent_of_range is None else f"{plain(one.rmse_percent_of_range, 2)}{NO_BREAK}%"


def metric_rows(metrics: Sequence[Metric]) -> list[MetricRow]:
    """The metrics of a record, in the units that people read."""
    rows = []
    for metric in metrics:
        quantity = next(
            (one for one in (CHANNELS.get(metric.channel), ANGLE) if one is not None and one.unit == metric.unit), None
        )
        shown: Callable[[float], float] = quantity.to_display if quantity else float
        unit = spelled_unit(quantity.display_unit if quantity else metric.unit)
        low, high = map(shown, metric.interval or (-math.inf, math.inf))
        rows.append(
            MetricRow(
                spoken(metric.name),
                metric.channel.replace("_", " "),
                estimate(shown(metric.value), (low, high), 4),
                unit,
                interval(low, high) if metric.interval else "–",
            )
        )
    return rows


def definitions(metrics: Iterable[Metric]) -> list[tuple[str, str]]:
    """Name and definition of every metric, each once."""
    return list(dict.fromkeys((spoken(metric.name), metric.definition) for metric in metrics))


def spoken(name: str) -> str:
    """A name of code as words.

    Examples
    --------
    >>> spoken("time_to_peak")
    'time to peak'
    """
    return name.replace("_", " ")


def fixed_rows(actuator: Actuator, free: Sequence[str]) -> list[ParameterRow]:
    """The parameters that were given, in the order of the actuator's file."""
    rows = []
    for name, parameter in actuator.parameters().items():
        if name in free:
            continue
        shown = parameter.quantity.to_display
        rows.append(
            ParameterRow(
                name,
                parameter.symbol,
                plain(shown(parameter.value), 6, trim=True),
                spelled_unit(parameter.quantity.display_unit),
                uncertainty=plain(shown(parameter.standard_uncertainty) or None, 2),
            )
        )
    return rows


def score_row(one: Score, *, run: str, model: str, pooled: bool = False, where_run: str = "") -> ScoreRow:
    """One row of the validation table."""
    quantity = CHANNELS[one.output]
    where = ""
    if one.max_error_time is not None:
        where = f"{plain(one.max_error_time, 4)}{NO_BREAK}s" + (f", {where_run}" if where_run else "")
    lags = one.lags_outside
    return ScoreRow(
        output=quantity.name,
        run=run,
        model=model,
        fit=percent(one.fit_percent),
        rmse=with_unit(one.rmse, quantity),
        of_range=_of_range(one),
        max_error=with_unit(one.max_error, quantity),
        where=where,
        lags="–" if lags is None else f"{100 * lags:.0f} %",
        inside="–" if one.inside_band is None else f"{100 * one.inside_band:.0f} %",
        samples=str(one.samples),
        remark=one.reason or (f"{one.left_out} rows left out" if one.left_out else ""),
        pooled=pooled,
    )


def score_rows(validations: Sequence[Validation], names: Sequence[str]) -> list[ScoreRow]:
    """Every output of every run, the models side by side, and all runs together where there are several."""
    rows: list[ScoreRow] = []
    first = validations[0]
    for output in first.scores:
        for place, run in enumerate(first.runs):
            if output not in run.scores:
                continue
            for name, validation in zip(names, validations, strict=True):
                rows.append(score_row(validation.runs[place].scores[output], run=run.label, model=name))
        if len(first.runs) > 1:
            for name, validation in zip(names, validations, strict=True):
                one = validation.scores[output]
                label = first.runs[one.max_error_run].label if one.max_error_run is not None else ""
                rows.append(score_row(one, run="all runs", model=name, pooled=True, where_run=label))
    return rows


def sample_of(actuator: Actuator, runs: Sequence[Run]) -> Sample | None:
    """The strip, from the actuator, or else from the first run that says."""
    return actuator.sample or next((run.metadata.sample for run in runs if run.metadata.sample), None)


def sample_facts(actuator: Actuator, runs: Sequence[Run]) -> list[tuple[str, str]]:
    """What the strip is, as name and value."""
    sample = sample_of(actuator, runs)
    facts = [("actuator", actuator.name)]
    if sample is not None:
        for name, value in sample.to_table().items():
            facts.append((name.replace("_", " "), value))
    for name, parameter in actuator.parameters().items():
        if name.startswith("geometry."):
            text = with_unit(parameter.value, parameter.quantity, 4, trim=True)
            facts.append((name.removeprefix("geometry.").replace("_", " "), text))
    return facts


def _water(about: RunMetadata) -> str | None:
    if about.water_content is None:
        return None
    return f"{about.water_content:.3g} for each sulfonate group ({about.water_content_origin or 'stated'})"


def run_facts(run: Run) -> list[tuple[str, str]]:
    """What a record says of itself, as name and value; what it does not say is left out."""
    about = run.metadata
    length = run.time[-1] - run.time[0]
    rate = f"{plain(run.rate, 4)} Hz" if run.is_uniform else f"{plain(run.rate, 4)} Hz on average, irregular"
    if not about.sampling_period_known:
        rate += " (assumed: the record does not say)"
    facts: list[tuple[str, str | None]] = [
        ("signal", about.signal),
        ("origin", about.origin),
        ("rows", f"{len(run)}, {plain(length, 4)} s at {rate}"),
        ("channels", ", ".join(name.replace("_", " ") for name in run.channels)),
        ("hold", run.hold),
        ("voltage sensed", about.voltage_sensed),
        ("shunt", f"{about.shunt_resistance:g} Ω" if about.shunt_resistance is not None else None),
        ("polarity", about.polarity),
        ("sample", about.sample.id if about.sample else None),
        ("mounting", about.mounting_id),
        ("run number", None if about.run_number is None else str(about.run_number)),
        ("out of water", _minutes(about.minutes_out_of_water)),
        ("in this environment", _minutes(about.minutes_in_environment)),
        ("temperature", None if about.temperature is None else f"{about.temperature:g} °C"),
        ("relative humidity", None if about.relative_humidity is None else f"{about.relative_humidity:g} %"),
        ("water content", _water(about)),
        ("clamp pressure", None if about.clamp_pressure is None else f"{about.clamp_pressure / 1e3:g} kPa"),
        ("chamber", about.chamber),
        ("bench", about.bench),
        ("recorded", about.recorded_at),
        ("source file", about.source_file),
        ("operator", about.operator),
        ("notes", about.notes),
    ]
    facts += [(f"mark at {plain(mark.time, 4)} s", mark.text) for mark in about.marks]
    return [(name, value) for name, value in facts if value]


def _minutes(value: float | None) -> str | None:
    return None if value is None else f"{value:g} min"
