"""The report of a comparison: one HTML file, and its numbers as CSV files."""

from __future__ import annotations

import base64
import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from ipmclab.comparison.compare import Comparison
from ipmclab.comparison.display import metric_label, quantity_of
from ipmclab.comparison.factors import FACTORS
from ipmclab.comparison.metric_model import Effect, MetricModel
from ipmclab.comparison.mixed import RESIDUAL
from ipmclab.comparison.table import RunRow, table_csv, write_csv
from ipmclab.kinds import tell_kinds
from ipmclab.reporting.figures.comparison import ComparedFigure, effects_figure, factor_figures, strips_figures
from ipmclab.reporting.figures.population import population_figures
from ipmclab.reporting.figures.responses import response_figures
from ipmclab.reporting.page_file import render, write_page
from ipmclab.reporting.population import population_parts
from ipmclab.reporting.save import save_figure
from ipmclab.reporting.svg import inline_svg
from ipmclab.reporting.wording import plain, spelled_unit, with_unit
from ipmclab.units import DISPLACEMENT, FORCE, Quantity

if TYPE_CHECKING:
    from ipmclab.comparison.population import Population

_ROWS_SHOWN = 200
"""Runs in the table of the page; all of them are in its data."""


Populations: TypeAlias = "tuple[Mapping[str, Population], Mapping[str, str]]"
"""What ``populations_of`` found of some metrics, and why nothing is reported of others."""


@dataclass(frozen=True)
class _Shown:
    """A figure as the page has it."""

    title: str
    caption: str
    svg: str
    file: str
    link: str


def comparison_figures(comparison: Comparison, posterior: Populations | None = None) -> list[ComparedFigure]:
    """Every figure of a comparison, each with its data.

    Examples
    --------
    >>> from ipmclab import compare, load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> runs = [simulate(strip, f"step {volt} V", duration=20.0, rate=20.0) for volt in (1, 2, 3, 4)]
    >>> [figure.title for figure in comparison_figures(compare(runs))]
    ['Effects, the others held', 'Voltage, step']
    """
    effects = effects_figure(comparison)
    return [
        *([effects] if effects else []),
        *factor_figures(comparison),
        *strips_figures(comparison),
        *(population_figures(posterior[0]) if posterior else []),
        *response_figures(comparison),
    ]


@tell_kinds
def write_comparison(
    comparison: Comparison,
    path: str | Path,
    *,
    posterior: Populations | None = None,
    command: str = "",
    overwrite: bool = False,
) -> Path:
    """Write one self-contained HTML file of a comparison; its tables and the data of its figures are in it.

    Parameters
    ----------
    comparison : Comparison
        What ``compare`` returned.
    path : str or Path
        Ending in .html.
    posterior : tuple, optional
        What ``populations_of`` returned.
    command : str
        How it was asked for, kept in it.
    overwrite : bool
        Whether an existing file may be replaced.

    Returns
    -------
    path : Path

    Raises
    ------
    InputError
        Another suffix, a folder that does not exist, or a file that does.
    """
    return write_page(
        lambda: comparison_html(comparison, posterior=posterior, command=command), path, overwrite=overwrite
    )


@tell_kinds
def write_comparison_data(
    comparison: Comparison, folder: str | Path, *, posterior: Populations | None = None, overwrite: bool = False
) -> list[Path]:
    """Write the table of a comparison and every figure, each as CSV and as SVG, into a folder.

    Parameters
    ----------
    comparison : Comparison
    folder : str or Path
        One that is there.
    posterior : tuple, optional
        What ``populations_of`` returned.
    overwrite : bool
        Whether existing files may be replaced.

    Returns
    -------
    paths : list of Path

    Raises
    ------
    InputError
        A folder that does not exist, or a file that does.
    """
    place = Path(folder)
    paths = [write_csv(table_csv(comparison.rows), place / "runs.csv", overwrite=overwrite)]
    for figure in comparison_figures(comparison, posterior):
        paths.append(write_csv(figure_csv(figure), place / f"{figure.name}.csv", overwrite=overwrite))
        paths.append(save_figure(figure.draw, place / f"{figure.name}.svg", overwrite=overwrite))
    return paths


def figure_csv(figure: ComparedFigure) -> str:
    """The numbers of a figure as CSV text."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(figure.columns)
    writer.writerows([float(cell) if hasattr(cell, "dtype") else cell for cell in row] for row in figure.data)
    return stream.getvalue()


def comparison_html(comparison: Comparison, *, posterior: Populations | None = None, command: str = "") -> str:
    """The text of the report of a comparison."""
    shown = [
        _Shown(
            title=one.title,
            caption=one.caption,
            svg=inline_svg(one.draw(), re.sub(r"[^A-Za-z0-9-]", "-", one.name), one.title),
            file=f"{one.name}.csv",
            link=_link(figure_csv(one)),
        )
        for one in comparison_figures(comparison, posterior)
    ]
    rows = comparison.rows
    return render(
        "comparison.html.j2",
        runs=len(rows),
        strips=len({row.strip for row in rows}),
        nameless=comparison.nameless,
        mountings=len({(row.strip, row.mounting) for row in rows}),
        factors=[factor.label for factor in comparison.by],
        figures=shown,
        effects=[_effect_rows(model, comparison) for model in comparison.models if model.factors],
        trends=[
            (
                f"{trend.waveform}: {metric_label(trend.key)}",
                trend.factor.label,
                len(trend.levels),
                trend.runs,
                [(one.law, plain(one.aicc, 2), plain(one.change), plain(one.held_out, 2)) for one in trend.laws],
                str(trend),
            )
            for trend in comparison.trends
        ],
        apart=[
            (name, [one for one in strips if one.is_unlike], len(strips))
            for name, strips in comparison.strip_deviations.items()
        ],
        following=[row for model in comparison.models for row in _next_rows(model)],
        populations=population_parts(posterior[0]) if posterior else [],
        unknown=list(posterior[1].items()) if posterior else [],
        performances=[
            (
                one.sample or "–",
                one.signal,
                _under(one.conditions),
                _mean_of_runs(one.free_of_runs, DISPLACEMENT),
                _mean_of_runs(one.blocked_of_runs, FORCE),
                f"{plain(1e6 * one.work)} µJ",
                "–" if one.work_density is None else f"{plain(one.work_density)} J/m³",
                "–" if one.efficiency is None else f"{plain(1e6 * one.efficiency)} × 10⁻⁶",
            )
            for one in comparison.performances
        ],
        bandwidths=[
            (
                one.sample or "–",
                one.channel,
                _under(one.conditions),
                len(one.frequency),
                "–" if one.bandwidth is None else f"{plain(one.bandwidth)} Hz",
            )
            for one in comparison.sine_responses
        ],
        definitions=_definitions(comparison),
        head=_table_head(rows),
        table=[_table_row(row, _table_keys(rows)) for row in rows[:_ROWS_SHOWN]],
        left=max(len(rows) - _ROWS_SHOWN, 0),
        table_link=_link(table_csv(rows)),
        doubtful=list(comparison.doubtful.items()),
        unread=comparison.unread,
        noise=comparison.only_noise,
        why_no_effects=comparison.why_no_effects,
        command=command,
    )


def _under(conditions: Mapping[str, float]) -> str:
    """Conditions as people read them; a dash where none is known."""
    return ", ".join(with_unit(value, FACTORS[name].quantity, trim=True) for name, value in conditions.items()) or "–"


def _mean_of_runs(values: Sequence[float], quantity: Quantity) -> str:
    """A mean with what it is the mean of, so that two unlike runs are not taken for one value."""
    mean = with_unit(sum(values) / len(values), quantity)
    if len(values) == 1:
        return mean
    return (
        f"{mean} (mean of {len(values)} runs, {with_unit(min(values), quantity)} to {with_unit(max(values), quantity)})"
    )


def _link(text: str) -> str:
    return "data:text/csv;base64," + base64.b64encode(text.encode()).decode()


def _effect_rows(model: MetricModel, comparison: Comparison) -> dict[str, object]:
    effect_rows = [_effect_row(effect, model) for effect in model.effects() if effect.factor in comparison.by]
    scatter = {}
    for name, size in model.fit.variances.items():
        deviation = max(size, 0.0) ** 0.5
        word = {RESIDUAL: "repeats", "strip": "strips", "mounting": "mountings"}[name]
        scatter[word] = (
            f"{plain(100.0 * deviation, 2)} %"
            if model.is_ratio
            else with_unit(deviation, quantity_of(model.metric.unit), 2)
        )
    return {
        "label": f"{model.waveform}: {model.label}",
        "runs": len(model.rows),
        "strips": len({row.strip for row in model.rows}),
        "scatter": ", ".join(f"{word} {size}" for word, size in scatter.items()),
        "rows": effect_rows,
        "together": [f"{name} changes together with {' and '.join(others)}" for name, others in model.together.items()],
    }


def _effect_row(effect: Effect, model: MetricModel) -> tuple[str, str, str, str]:
    def show(value: float) -> str:
        return f"× {plain(value)}" if model.is_ratio else with_unit(value, quantity_of(model.metric.unit))

    interval = "–" if effect.interval is None else f"{show(effect.interval[0])} to {show(effect.interval[1])}"
    low, high = (with_unit(end, effect.factor.quantity, trim=True) for end in (effect.low, effect.high))
    levels = f"{effect.factor.label}, {low} to {high}"
    chance = effect.reason if effect.p_value is None else f"p = {plain(effect.p_value, 2)}"
    return levels, show(effect.value), interval, chance


def _next_rows(model: MetricModel) -> list[tuple[str, str, str, str]]:
    found = []
    for condition in model.conditions()[:12]:
        next_one = model.next_strip(condition)
        if next_one is None:
            return []
        quantity = quantity_of(model.metric.unit)
        shown = ", ".join(with_unit(condition[factor.name], factor.quantity, trim=True) for factor in model.factors)
        found.append(
            (
                f"{model.waveform}: {model.label}",
                shown or "one condition",
                with_unit(next_one[0], quantity),
                f"{with_unit(next_one[1][0], quantity)} to {with_unit(next_one[1][1], quantity)}",
            )
        )
    return found


def _table_keys(rows: Sequence[RunRow]) -> list[str]:
    wanted = (
        "displacement.largest",
        "displacement.amplitude",
        "displacement.back_relaxation",
        "force.largest",
        "force.amplitude",
        "current.largest",
        "current.charge",
    )
    return [key for key in wanted if any(key in row.metrics for row in rows)]


def _table_head(rows: Sequence[RunRow]) -> list[str]:
    head = []
    for key in _table_keys(rows):
        unit = next(row.metrics[key].unit for row in rows if key in row.metrics)
        shown = quantity_of(unit).display_unit
        head.append(metric_label(key) + (f" ({spelled_unit(shown)})" if shown else ""))
    return head


def _table_row(row: RunRow, keys: Sequence[str]) -> list[str]:
    numbers = [
        plain(float(quantity_of(row.metrics[key].unit).to_display(row.metrics[key].value)))
        if key in row.metrics
        else ""
        for key in keys
    ]
    humidity, temperature = (
        plain(row.values[name], 3) if name in row.values else "" for name in ("humidity", "temperature")
    )
    return [
        row.run,
        row.sample,
        row.mounting,
        row.date[:10],
        row.signal or row.waveform,
        humidity,
        temperature,
        *numbers,
    ]


def _definitions(comparison: Comparison) -> list[tuple[str, str]]:
    found: dict[str, str] = {}
    keys = {key for waveform in comparison.waveforms for key in comparison.keys_of(waveform)}
    for row in comparison.rows:
        for key, metric in row.metrics.items():
            if key in keys:
                found.setdefault(metric_label(key), metric.definition)
    return sorted(found.items())
