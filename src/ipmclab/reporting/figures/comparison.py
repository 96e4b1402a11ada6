"""Figures of a comparison: metrics over what was varied, effects, frequency responses, strips and the next one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from ipmclab.comparison.compare import Comparison
from ipmclab.comparison.display import metric_label, quantity_of
from ipmclab.comparison.factors import FACTORS, Factor, levels_of
from ipmclab.comparison.metric_model import Effect, MetricModel
from ipmclab.comparison.table import RunRow
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.figures.panels import name_rows
from ipmclab.reporting.figures.strips import (
    Curve,
    Look,
    alike,
    joined,
    legend_room,
    mark_of,
    strips_in_order,
    strips_legend,
)
from ipmclab.reporting.style import COLOURS, LINES, SERIES, label_text, style
from ipmclab.reporting.wording import plain, spelled_unit, with_unit

COLUMNS: Final = 3
_MOST_PANELS: Final = 6
_MOST_POINTS: Final = 150
"""Runs of one panel that are drawn each; of more, what each strip has at each level."""

_CONDITIONS: Final = ("voltage", "frequency", "humidity", "temperature", "clamp_pressure")
"""Factors that belong to a run, and are held where another is looked at; a strip brings its own along."""

_OF_A_STRIP: Final = {"thickness": "loading", "loading": "thickness"}
"""Factors of which a strip has one level, each with the other one: strips that are alike in that are joined."""


@dataclass(frozen=True)
class ComparedFigure:
    """A figure and the numbers in it.

    Parameters
    ----------
    name : str
        Of its files: letters, digits and hyphens.
    title, caption : str
    draw : callable
        Draws the figure.
    columns : tuple of str
        Of its data, with SI units.
    data : tuple of rows
    """

    name: str
    title: str
    caption: str
    draw: Callable[[], Figure]
    columns: tuple[str, ...]
    data: tuple[tuple[Any, ...], ...]


def factor_figures(comparison: Comparison) -> list[ComparedFigure]:
    """Metrics over each factor, waveform by waveform: small multiples, one colour a strip, the rest held."""
    found = []
    for factor in comparison.by:
        for waveform in comparison.waveforms:
            rows = [row for row in comparison.rows if row.waveform == waveform and factor.name in row.values]
            rows, held = _held(rows, factor)
            if len(set(levels_of(factor, [row.values[factor.name] for row in rows]))) < 2:
                continue
            keys = [key for key in comparison.keys_of(waveform) if _varies(rows, key, factor)][:_MOST_PANELS]
            if keys:
                found.append(_factor_figure(comparison, factor, waveform, rows, keys, held))
    return found


def _held(rows: list[RunRow], factor: Factor) -> tuple[list[RunRow], str]:
    """The runs that differ in a factor and the strip alone: under the condition that has most of its levels."""
    others = [FACTORS[name] for name in _CONDITIONS if name != factor.name]
    columns = []
    for other in others:
        known = [row.values[other.name] for row in rows if other.name in row.values]
        levels = iter(levels_of(other, known) if known else [])
        columns.append([next(levels) if other.name in row.values else None for row in rows])
    along = levels_of(factor, [row.values[factor.name] for row in rows]) if rows else []
    groups: dict[tuple[float | None, ...], list[int]] = {}
    for place, condition in enumerate(zip(*columns, strict=True)):
        groups.setdefault(condition, []).append(place)
    if len(groups) < 2:
        return rows, ""
    best = max(groups, key=lambda one: (len({along[place] for place in groups[one]}), len(groups[one])))
    varied = [len(set(column)) > 1 for column in columns]
    labels = zip(others, best, varied, strict=True)
    held = ", ".join(
        f"{other.label} {with_unit(value, other.quantity, trim=True)}"
        for other, value, is_varied in labels
        if is_varied and value is not None
    )
    return [rows[place] for place in groups[best]], held


def _varies(rows: Sequence[RunRow], key: str, factor: Factor) -> bool:
    values = [row.values[factor.name] for row in rows if key in row.metrics]
    return len(set(levels_of(factor, values))) > 1


def _factor_figure(
    comparison: Comparison, factor: Factor, waveform: str, rows: list[RunRow], keys: list[str], held: str
) -> ComparedFigure:
    other = FACTORS[_OF_A_STRIP[factor.name]] if factor.name in _OF_A_STRIP else None
    data = tuple(
        (
            *(key, row.run, row.sample, row.mounting, row.values[factor.name], row.metrics[key].value),
            *([] if other is None else [row.values.get(other.name, "")]),
        )
        for key in keys
        for row in rows
        if key in row.metrics
    )
    line = "what one strip has" if other is None else f"the strips of one {other.label}"
    columns = ("metric", "run", "sample", "mounting", f"{factor.name} [{factor.quantity.unit}]", "value [SI]")
    return ComparedFigure(
        name=f"{factor.name}-{waveform}".replace(" ", "-").replace("_", "-"),
        title=f"{factor.label.capitalize()}, {waveform}",
        caption=(f"Runs at {held}. " if held else "")
        + f"A dot is a run, a line joins {line} at each level on the average."
        + ("" if all(row.sample for row in rows) else " Runs that name no sample are not joined."),
        draw=lambda: _draw_factor(factor, other, rows, keys, comparison.samples),
        columns=columns if other is None else (*columns, f"{other.name} [{other.quantity.unit}]"),
        data=data,
    )


def _draw_factor(
    factor: Factor, other: Factor | None, rows: list[RunRow], keys: list[str], every: Sequence[str]
) -> Figure:
    lines = math.ceil(len(keys) / COLUMNS)
    samples = list(dict.fromkeys(row.sample for row in rows))
    order = strips_in_order(every, samples)
    further = {} if other is None else _looks_of_groups(factor, other, rows)
    with style():
        bottom = legend_room(samples, order, list(further))
        margins = Margins(left=0.5, bottom=bottom, row_gap=0.75, column_gap=0.55)
        figure, grid = panel_grid([1.35] * lines, COLUMNS, margins=margins)
        for place, panel in enumerate(grid.flat):
            if place >= len(keys):
                panel.set_visible(False)
                continue
            shown_rows = [row for row in rows if keys[place] in row.metrics]
            quantity = quantity_of(shown_rows[0].metrics[keys[place]].unit)
            level = levels_of(factor, [row.values[factor.name] for row in shown_rows])
            curves: dict[str, Curve] = {sample: ([], []) for sample in samples}
            for row, at in zip(shown_rows, level, strict=True):
                curves[row.sample][0].append(factor.quantity.to_display(at))
                curves[row.sample][1].append(quantity.to_display(_shown(row, keys[place])))
            if other is not None:
                _join_groups(panel, _groups(other, shown_rows), curves, further)
            unnamed = curves.get("")
            for look, own in alike(curves, order):
                each = [part for curve in own for part in (_apart(curve) if curve is unnamed else [curve])]
                _draw_strips_over(panel, each, look, points=len(shown_rows) <= _MOST_POINTS)
            panel.set_title(
                f"{metric_label(keys[place])}{_in_unit(quantity.display_unit)}", fontsize=7.4, fontweight="normal"
            )
            panel.set_xlabel(f"{factor.label}{_in_unit(factor.quantity.display_unit)}")
            panel.yaxis.set_offset_position("right")  # a power of ten would stand in the title
            if factor.is_ratio:
                panel.set_xscale("log")
                few_ticks(panel)
            panel.margins(x=0.08, y=0.12)
        strips_legend(figure, samples, order, further)
    return figure


def _groups(other: Factor, rows: Sequence[RunRow]) -> dict[str, list[str]]:
    """Strips that are alike in a property, under its value."""
    there = [row for row in rows if other.name in row.values]
    found: dict[str, list[str]] = {}
    for row, level in zip(there, levels_of(other, [row.values[other.name] for row in there]), strict=True):
        of_level = found.setdefault(f"{other.label} {with_unit(level, other.quantity, trim=True)}", [])
        if row.sample and row.sample not in of_level:
            of_level.append(row.sample)
    return found


def _looks_of_groups(factor: Factor, other: Factor, rows: Sequence[RunRow]) -> dict[str, Look]:
    """A line pattern for each group of strips that has more than one level of a factor."""
    at = {row.sample: row.values[factor.name] for row in rows}
    groups = [
        name
        for name, strips in _groups(other, rows).items()
        if len(set(levels_of(factor, [at[one] for one in strips]))) > 1
    ]
    looks = {"color": COLOURS["muted"], "linewidth": 0.8}
    return {name: {**looks, "linestyle": LINES[place % len(LINES)]} for place, name in enumerate(groups)}


def _join_groups(
    panel: Axes, groups: Mapping[str, Sequence[str]], curves: Mapping[str, Curve], looks: Mapping[str, Look]
) -> None:
    """A line through the strips of each group: at each level the mean over strips of what each has on the average."""
    for name, look in looks.items():
        levels: dict[float, list[float]] = {}
        for strip in groups.get(name, ()):
            x, y = curves[strip]
            if x:
                levels.setdefault(x[0], []).append(float(np.mean(y)))
        if len(levels) > 1:
            at = sorted(levels)
            panel.plot(at, [float(np.mean(levels[one])) for one in at], zorder=1.5, **look)


def _apart(curve: Curve) -> list[Curve]:
    """Each run for itself, where none names its strip, which may be any."""
    return [([x], [y]) for x, y in zip(*curve, strict=True)]


def _shown(row: RunRow, key: str) -> float:
    """The value of a metric; of a peak its size, since a strip that was turned round reads the other way."""
    value = row.metrics[key].value
    return abs(value) if key.endswith((".largest", ".amplitude", ".strain")) else value


def _draw_strips_over(panel: Axes, curves: Sequence[Curve], look: Mapping[str, Any], *, points: bool) -> None:
    if points:
        every = [value for x, _ in curves for value in x], [value for _, y in curves for value in y]
        mark: dict[str, Any] = {"marker": mark_of(look), "markersize": 3.0, "markeredgewidth": 0}
        panel.plot(*every, linestyle="none", alpha=0.55, color=look["color"], **mark)
    means = []
    for x, y in curves:
        at = np.unique(x)
        means.append((at.tolist(), [float(np.mean(np.asarray(y)[np.asarray(x) == level])) for level in at]))
    panel.plot(*joined(means), linewidth=1.0, marker=None if points else ".", markersize=3.0, **look)


def _in_unit(unit: str) -> str:
    return f" ({spelled_unit(unit)})" if unit else ""


def few_ticks(panel: Axes) -> None:
    low, high = panel.get_xlim()
    marks = [one * 10.0**power for power in range(-4, 4) for one in (1.0, 2.0, 5.0)]
    inside = [mark for mark in marks if low <= mark <= high]
    panel.xaxis.set_major_locator(FixedLocator(inside[:: max(1, len(inside) // 6 + (len(inside) > 6))]))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: plain(value, 2, trim=True)))
    panel.xaxis.set_minor_locator(NullLocator())


def effects_figure(comparison: Comparison) -> ComparedFigure | None:
    """Effects on magnitudes with their intervals, a panel a factor; None where there is none."""
    by: dict[str, list[tuple[str, Any]]] = {}
    for model in comparison.models:
        for effect in model.effects():
            if model.is_ratio and effect.factor in comparison.by and math.isfinite(effect.value):
                by.setdefault(effect.factor.name, []).append((f"{model.waveform}: {model.label}", effect))
    if not by:
        return None
    data = tuple(
        (name, label, effect.low, effect.high, effect.value, *(effect.interval or ("", "")))
        for name, rows in by.items()
        for label, effect in rows
    )
    return ComparedFigure(
        name="effects",
        title="Effects, the others held",
        caption="By what factor a magnitude grows from the lowest level to the highest, with its 95 % interval. A "
        "circle without a line: these runs do not show how sure it is.",
        draw=lambda: _draw_effects(by),
        columns=("factor", "metric", "low [SI]", "high [SI]", "ratio", "ratio_low", "ratio_high"),
        data=data,
    )


def _draw_effects(by: Mapping[str, list[tuple[str, Any]]]) -> Figure:
    with style():
        commons = [_common(rows) for rows in by.values()]  # else each label has a line for its levels
        heights = [
            (0.19 if common else 0.3) * len(rows) + 0.12 for common, rows in zip(commons, by.values(), strict=True)
        ]
        figure, grid = panel_grid(heights, 1, margins=Margins(left=2.5, right=0.3, top=0.3, row_gap=0.62, bottom=0.5))
        for panel, rows, common in zip(grid[:, 0], by.values(), commons, strict=True):
            panel.set_xscale("log")
            panel.axvline(1.0, color=COLOURS["muted"], linewidth=0.6)
            for place, (_, effect) in enumerate(rows):
                is_known = effect.interval is not None
                if is_known:
                    panel.plot(effect.interval, [place, place], color=COLOURS["blue"], linewidth=1.4)
                face = COLOURS["blue"] if is_known else "none"
                panel.plot([effect.value], [place], "o", markersize=4, color=COLOURS["blue"], markerfacecolor=face)
            panel.set_title(f"{rows[0][1].factor.label}: {common or 'highest level over lowest'}")
            names = [
                label_text(label, longest=46) + ("" if common else f"\n{label_text(_levels(one))}")
                for label, one in rows
            ]
            name_rows(panel, names, beyond=0.6)
            _bound(panel, [one.value for _, one in rows], [end for _, one in rows for end in one.interval or ()])
        grid[-1, 0].set_xlabel("ratio")
    return figure


def _common(rows: Sequence[tuple[str, Any]]) -> str:
    """The levels of all effects; empty where they differ: metrics need not have been measured at the same ones."""
    levels = {_levels(effect) for _, effect in rows}
    return levels.pop() if len(levels) == 1 else ""


def _levels(effect: Effect) -> str:
    """The levels between which an effect is, such as "3 V over 1 V"."""
    high, low = (with_unit(end, effect.factor.quantity, trim=True) for end in (effect.high, effect.low))
    return f"{high} over {low}"


def _bound(panel: Axes, values: Sequence[float], ends: Sequence[float]) -> None:
    """Show every value whole, intervals as far as they help: one of two strips reaches beyond any paper."""
    least, most = min(*values, 1.0), max(*values, 1.0)
    low = max(min([least, *ends]), least / 20.0) / 1.15
    high = min(max([most, *ends]), most * 20.0) * 1.15
    panel.set_xlim(low, high)
    marks = [one * 10.0**power for power in range(-6, 7) for one in (1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 7.0)]
    inside = [mark for mark in marks if low <= mark <= high]
    wide = [mark for mark in inside if mark / 10.0 ** math.floor(math.log10(mark) + 1e-9) < 1.1]
    chosen = inside if len(inside) <= 8 else (wide if len(wide) > 2 else inside[:: math.ceil(len(inside) / 8)])
    panel.xaxis.set_major_locator(FixedLocator(chosen))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda value, _: plain(value, 2, trim=True)))
    panel.xaxis.set_minor_locator(NullLocator())


def strips_figures(comparison: Comparison) -> list[ComparedFigure]:
    """Each strip's runs side by side, with the interval of the next strip."""
    found = []
    for model in comparison.models:
        deviating = comparison.strip_deviations.get(f"{model.waveform}: {model.label}")
        if deviating is None:
            continue
        unlike = {one.sample for one in deviating if one.is_unlike}
        condition = _usual(model)
        next_one = model.next_strip(condition)
        rows = [row for row in model.rows if _is_under(row, condition, model.factors)]
        if next_one is None or len({row.sample for row in rows}) < 3:
            continue
        shown = ", ".join(with_unit(condition[factor.name], factor.quantity, trim=True) for factor in model.factors)
        key = model.key
        found.append(
            ComparedFigure(
                name=f"strips-{model.waveform}-{key}".replace(".", "-").replace("_", "-").replace(" ", "-"),
                title=f"Strip by strip: {model.label}, {model.waveform}",
                caption=f"Runs at {shown or 'one condition'}. Shaded: what a strip that was not measured will read, "
                "once, in 95 of 100 cases.",
                draw=lambda model=model, rows=rows, next_one=next_one, unlike=unlike: _draw_strips(  # type: ignore[misc]
                    model, rows, next_one[1], unlike
                ),
                columns=("sample", "mounting", "run", f"{key} [{model.metric.unit}]", "next_low", "next_high"),
                data=tuple((row.sample, row.mounting, row.run, _shown(row, key), *next_one[1]) for row in rows),
            )
        )
    return found


def _usual(model: MetricModel) -> dict[str, float]:
    """The condition under which most runs were recorded."""
    columns = [levels_of(factor, [row.values[factor.name] for row in model.rows]) for factor in model.factors]
    every = list(zip(*columns, strict=True)) or [()]
    most = max(dict.fromkeys(every), key=every.count)
    return dict(zip([factor.name for factor in model.factors], most, strict=True))


def _is_under(row: RunRow, condition: Mapping[str, float], factors: Sequence[Factor]) -> bool:
    return all(
        abs(factor.coordinate(row.values[factor.name]) - factor.coordinate(condition[factor.name]))
        <= 2.0 * factor.tolerance
        for factor in factors
    )


def _draw_strips(
    model: MetricModel, rows: Sequence[RunRow], interval: tuple[float, float], deviating: set[str]
) -> Figure:
    samples = list(dict.fromkeys(row.sample for row in rows))
    quantity = quantity_of(model.metric.unit)
    with style():
        figure, grid = panel_grid([max(0.2 * len(samples), 0.8)], 1, margins=Margins(left=1.6, top=0.15))
        panel = grid[0, 0]
        panel.axvspan(*(quantity.to_display(end) for end in interval), color=COLOURS["sky"], alpha=0.3, linewidth=0)
        for place, sample in enumerate(samples):
            values = [quantity.to_display(_shown(row, model.key)) for row in rows if row.sample == sample]
            colour = COLOURS["vermillion" if sample in deviating else SERIES[0]]
            panel.plot(values, [place] * len(values), "o", markersize=3.4, alpha=0.7, markeredgewidth=0, color=colour)
        names = [label_text(sample, longest=26) + (" (unlike)" if sample in deviating else "") for sample in samples]
        name_rows(panel, names, beyond=0.6)
        panel.set_xlim(left=0.0)
        panel.set_xlabel(f"{model.label}{_in_unit(quantity.display_unit)}")
    return figure
