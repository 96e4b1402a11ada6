"""An estimation before and after: the same runs beside a model with starting values and with those that were found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ipmclab.errors import InputError
from ipmclab.prediction.scores import score
from ipmclab.prediction.validate import RunValidation, validate
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.figures.panels import MEASURED, curve
from ipmclab.reporting.style import COLOURS, PAGE_WIDTH, label_text, style
from ipmclab.reporting.wording import spelled_unit, with_unit
from ipmclab.run import Run
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    from ipmclab.model import Actuator

_HEIGHT: Final = 1.35
_COLOURS: Final = ("vermillion", "blue")


def before_and_after(runs: Sequence[Run] | Run, before: Actuator, after: Actuator) -> Figure:
    """Draw what was measured beside a model before its estimation, at the left, and after it, at the right.

    Parameters
    ----------
    runs : Run or sequence of Run
    before, after : Actuator
        With starting values, and with those that were found.

    Returns
    -------
    figure : Figure
        A row for each output of each run, with the root mean square of what is left over.
        Write it with ``save_figure``.

    Raises
    ------
    InputError
        No run, or none with an output that the models have.

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate
    >>> strip = load_actuator("friend-2")
    >>> run = simulate(strip, "step 1 V", duration=20.0, rate=50.0)
    >>> start = strip.replace(**{"circuit.branches.1.permittivity": 0.1})
    >>> [panel.get_title() for panel in before_and_after(run, start, strip).axes[:2]]
    ['before: friend-2', 'after: friend-2']
    """
    drawn = [runs] if isinstance(runs, Run) else list(runs)
    pairs = list(zip(*(validate(model, drawn).runs for model in (before, after)), strict=True)) if drawn else []
    rows = [(pair, output) for pair in pairs for output in pair[0].comparisons]
    if not rows:
        raise InputError(
            "no run has a current, a displacement or a force to hold a model against",
            code="no-runs",
            where="runs",
            repair="give runs with their readings",
        )
    with style():
        figure, grid = panel_grid(
            [_HEIGHT] * len(rows),
            2,
            margins=Margins(left=0.68, top=0.45, bottom=0.72, row_gap=0.42),
            sharex="row",
            sharey="row",
        )
        for (pair, output), panels in zip(rows, grid, strict=True):
            _row(pair, output, panels)
        for panel, word, model in zip(grid[0], ("before", "after"), (before, after), strict=True):
            panel.set_title(f"{word}: {label_text(model.name)}", loc="center", pad=14.0)
        for panel in grid[-1]:
            panel.set_xlabel("time (s)")
        figure.legend(
            [grid[0, 0].lines[0], grid[0, 0].lines[1], grid[0, 1].lines[1]],
            ["measured", "model before", "model after"],
            loc="lower center",
            ncols=3,
        )
    return figure


def _row(pair: tuple[RunValidation, RunValidation], output: str, panels: Sequence[Axes]) -> None:
    quantity = CHANNELS[output]
    for one, panel, colour in zip(pair, panels, _COLOURS, strict=True):
        comparison = one.comparisons[output]
        curve(panel, output, comparison.time, comparison.measured, **MEASURED)
        curve(panel, output, comparison.time, comparison.predicted, color=COLOURS[colour])
        panel.margins(x=0.02, y=0.14)
        error = with_unit(score(output, [comparison]).rmse, quantity, 2)
        panel.text(1, 1.03, f"RMSE {error}", transform=panel.transAxes, ha="right", fontsize=7.5)
    panels[0].text(0, 1.03, label_text(pair[0].label), transform=panels[0].transAxes, fontsize=7.5)
    panels[0].set_ylabel(f"{quantity.name} ({spelled_unit(quantity.display_unit)})")
    panels[0].yaxis.set_label_coords(-0.48 / (panels[0].get_position().width * PAGE_WIDTH), 0.5)
