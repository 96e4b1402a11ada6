"""One picture of a fit: a column for each run, a row for each output, measured against model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ipmclab.identification.problem.record import READ_OUTPUTS
from ipmclab.prediction.fitted import fitted_outputs
from ipmclab.prediction.scores import Comparison, score
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.figures.panels import MEASURED, curve
from ipmclab.reporting.style import COLOURS, PAGE_WIDTH, label_text, style
from ipmclab.reporting.wording import spelled_unit, with_unit
from ipmclab.run import Run
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit
    from ipmclab.prediction.validate import Validation

_LEGEND = {"identified from": "model, fitted to this run", "predicted": "model, given only the voltage"}


@dataclass(frozen=True)
class Column:
    """One run of an overview.

    Parameters
    ----------
    title : str
        What was applied, for example ``"1 V step"``.
    role : "identified from" or "predicted"
    comparisons : mapping of output to Comparison
    """

    title: str
    role: Literal["identified from", "predicted"]
    comparisons: Mapping[str, Comparison]


def overview(fit: Fit, runs: Sequence[Run], validation: Validation | None = None) -> Figure:
    """One picture of a fit: what it was identified from, and what it predicts, measured against model.

    Parameters
    ----------
    fit : Fit
    runs : sequence of Run
        Those of the fit, in the order of ``identify``.
    validation : Validation, optional
        Of ``fit.actuator``, against other runs.

    Returns
    -------
    figure : Figure
        Write it with ``save_figure``.
    """
    columns = []
    for place, run in enumerate(runs):
        comparisons = fitted_outputs(fit, run, place)
        columns.append(Column(fit.observations[place].label, "identified from", comparisons))
    for one in validation.runs if validation else ():
        columns.append(Column(one.label, "predicted", one.comparisons))
    outputs = [name for name in READ_OUTPUTS if any(name in column.comparisons for column in columns)]
    return overview_figure(columns, outputs)


def overview_figure(columns: Sequence[Column], outputs: Sequence[str]) -> Figure:
    """Draw runs side by side.

    Parameters
    ----------
    columns : sequence of Column
        Runs that were identified from first; predicted ones are drawn in the second colour.
    outputs : sequence of str
        The rows.

    Returns
    -------
    figure : Figure
    """
    with style():
        figure, grid = panel_grid(
            [1.45] * len(outputs),
            len(columns),
            margins=Margins(left=0.68, top=0.48, bottom=0.72),
            sharex="col",
            sharey="row",
        )
        handles = {}
        for place, column in enumerate(columns):
            colour = COLOURS["blue" if column.role == "identified from" else "vermillion"]
            for row, output in enumerate(outputs):
                panel = grid[row, place]
                quantity = CHANNELS[output]
                panel.yaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 2.5, 5, 10]))
                if place == 0:
                    panel.set_ylabel(f"{quantity.name} ({spelled_unit(quantity.display_unit)})")
                    # Both labels on one line, however wide the numbers are.
                    panel.yaxis.set_label_coords(-0.48 / (panel.get_position().width * PAGE_WIDTH), 0.5)
                if row == 0:
                    panel.set_title(f"{label_text(column.title, longest=28)}\n", pad=5.0)
                    panel.text(0, 1.04, column.role, transform=panel.transAxes, color=colour, fontsize=8.0)
                one = column.comparisons.get(output)
                if one is None:
                    panel.set_visible(False)
                    continue
                curve(panel, output, one.time, one.measured, **MEASURED)
                curve(panel, output, one.time, one.predicted, color=colour)
                panel.margins(x=0.02, y=0.14)
                handles["measured"] = panel.lines[0]
                handles[_LEGEND[column.role]] = panel.lines[1]
                error = with_unit(score(output, [one]).rmse, quantity, 2)
                panel.text(1, 1.03, f"RMSE {error}", transform=panel.transAxes, ha="right", fontsize=7.5)
            grid[-1, place].set_xlabel("time (s)")
        figure.legend(handles.values(), handles.keys(), loc="lower center", ncols=len(handles))
    return figure
