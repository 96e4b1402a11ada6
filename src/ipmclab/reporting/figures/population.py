"""The next strip by its posterior: what one will read, and what strips of this make read on the average."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

from matplotlib.figure import Figure

from ipmclab.comparison.display import quantity_of
from ipmclab.reporting.figures.comparison import ComparedFigure
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.figures.panels import name_rows
from ipmclab.reporting.style import COLOURS, label_text, style
from ipmclab.reporting.wording import spelled_unit, with_unit

if TYPE_CHECKING:
    from ipmclab.comparison.population import Known, OfCondition, Population

MOST_CONDITIONS: Final = 12
"""That are drawn, and stand in the table; all of them are in the data."""

Interval = tuple[float, float]


def condition_text(one: Population, condition: OfCondition) -> str:
    """A condition as people read it."""
    shown = (with_unit(condition.condition[each.name], each.quantity, trim=True) for each in one.model.factors)
    return ", ".join(shown) or "as measured"


def population_figures(populations: Mapping[str, Population]) -> list[ComparedFigure]:
    """A figure of the next strip for each metric that was sampled."""
    return [_figure(one, one.conditions()) for one in populations.values()]


def _figure(one: Population, conditions: Sequence[OfCondition]) -> ComparedFigure:
    model = one.model
    factors = (f"{each.name} [{each.quantity.unit}]" for each in model.factors)
    ends = ("mean", "mean_low", "mean_high", "next", "next_low", "next_high", "mixed", "mixed_low", "mixed_high")
    rows = (
        (*(each.condition[factor.name] for factor in model.factors), *_cells(each.mean, each.next_strip), *_mixed(each))
        for each in conditions
    )
    return ComparedFigure(
        name=f"posterior-{model.waveform}-{model.key}".replace(".", "-").replace("_", "-").replace(" ", "-"),
        title=f"The next strip by its posterior: {model.label}, {model.waveform}",
        caption="Thin: what a strip of this make that was not measured will read, once, in 95 of 100 cases. Thick: the "
        "mean of such strips, with 95 %. Grey: the next strip by the mixed model.",
        draw=lambda: _draw(one, conditions[:MOST_CONDITIONS]),
        columns=(*factors, *(f"{end} [{model.metric.unit}]" if model.metric.unit else end for end in ends)),
        data=tuple(rows),
    )


def _cells(*known: Known) -> list[float]:
    return [cell for value, interval in known for cell in (value, *interval)]


def _mixed(condition: OfCondition) -> Sequence[float | str]:
    return ("", "", "") if condition.by_mixed_model is None else _cells(condition.by_mixed_model)


def _draw(one: Population, conditions: Sequence[OfCondition]) -> Figure:
    quantity = quantity_of(one.model.metric.unit)

    def shown(interval: Interval) -> list[float]:
        return [quantity.to_display(end) for end in interval]

    with style():
        figure, grid = panel_grid([max(0.28 * len(conditions), 0.6)], 1, margins=Margins(left=2.2, top=0.15))
        panel = grid[0, 0]
        for place, each in enumerate(conditions):
            if each.by_mixed_model is not None:
                panel.plot(shown(each.by_mixed_model[1]), [place + 0.22] * 2, color=COLOURS["muted"], linewidth=1.0)
            panel.plot(shown(each.next_strip[1]), [place] * 2, color=COLOURS["blue"], linewidth=1.0)
            panel.plot(shown(each.mean[1]), [place] * 2, color=COLOURS["blue"], linewidth=3.2)
            panel.plot(shown((each.next_strip[0],) * 2), [place] * 2, "o", markersize=3.6, color=COLOURS["blue"])
        name_rows(panel, [label_text(condition_text(one, each), longest=40) for each in conditions], beyond=0.6)
        if one.model.is_ratio:
            panel.set_xlim(left=0.0)
        unit = spelled_unit(quantity.display_unit)
        panel.set_xlabel(f"{one.model.label} ({unit})" if unit else one.model.label)
    return figure
