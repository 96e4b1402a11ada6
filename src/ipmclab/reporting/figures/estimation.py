"""An estimation before and after: the same runs with a model with starting values and with those that were found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ipmclab.errors import InputError
from ipmclab.prediction.run_validation import RunValidation
from ipmclab.prediction.scores import score
from ipmclab.prediction.validate import validate
from ipmclab.reporting.drawn import drawn_outputs
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.figures.panels import MEASURED, curve, left_out_curve
from ipmclab.reporting.style import COLOURS, PAGE_WIDTH, label_text, style
from ipmclab.reporting.wording import spelled_unit, with_unit
from ipmclab.run import Run
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    from ipmclab.model import Actuator

_HEIGHT: Final = 1.35
_LINE: Final = 0.2  # inch, of a line of text at the foot
_COLOURS: Final = ("vermillion", "blue")


def before_and_after(runs: Sequence[Run] | Run, before: Actuator | None, after: Actuator) -> Figure:
    """Draw what was measured with a model before its estimation, at the left, and after it, at the right.

    Parameters
    ----------
    runs : Run or sequence of Run
    before : Actuator or None
        With starting values; without it, what was found is drawn alone.
    after : Actuator
        With the values that were found.

    Returns
    -------
    figure : Figure
        A row for each output of each run that the model after it identified, with the root mean square of what is
        left over; a line says what is not drawn.
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
    models = {"after": after} if before is None else {"before": before, "after": after}
    each = list(zip(*(validate(model, drawn).runs for model in models.values()), strict=True)) if drawn else []
    outputs_drawn = [drawn_outputs([after], compared[-1].comparisons) for compared in each]
    rows = [
        (compared, output) for compared, (outputs, _) in zip(each, outputs_drawn, strict=True) for output in outputs
    ]
    left_out = " ".join(dict.fromkeys(sentence for _, sentence in outputs_drawn if sentence))
    if not rows:
        raise InputError(
            "no run has a current, a displacement or a force to hold a model against",
            code="no-runs",
            where="runs",
            repair="give runs with their readings",
        )
    foot = _LINE if left_out else 0.0
    with style():
        figure, grid = panel_grid(
            [_HEIGHT] * len(rows),
            len(models),
            margins=Margins(left=0.68, top=0.45, bottom=0.72 + foot, row_gap=0.42),
            sharex="row",
            sharey="row",
        )
        for (compared, output), panels in zip(rows, grid, strict=True):
            _row(compared, output, panels)
        for panel, (word, model) in zip(grid[0], models.items(), strict=True):
            panel.set_title(f"{word}: {label_text(model.name)}", loc="center", pad=14.0)
        for panel in grid[-1]:
            panel.set_xlabel("time (s)")
        figure.legend(
            [grid[0, 0].lines[0], *(panel.lines[1] for panel in grid[0])],
            ["measured", *(f"model {word}" for word in models)],
            loc="lower center",
            bbox_to_anchor=(0.5, foot / figure.get_figheight()),
            ncols=3,
        )
        if left_out:
            figure.text(0.01, 0.05 / figure.get_figheight(), left_out, fontsize=7.5, color=COLOURS["muted"])
    return figure


def _row(compared: Sequence[RunValidation], output: str, panels: Sequence[Axes]) -> None:
    quantity = CHANNELS[output]
    for one, panel, colour in zip(compared, panels, _COLOURS[-len(compared) :], strict=True):
        comparison = one.comparisons[output]
        counted = comparison.used if comparison.used.any() else np.ones_like(comparison.used)
        curve(panel, output, comparison.time, np.where(counted, comparison.measured, np.nan), **MEASURED)
        curve(panel, output, comparison.time, comparison.predicted, color=COLOURS[colour])
        left_out_curve(panel, output, comparison.time, np.where(counted, np.nan, comparison.measured))
        panel.margins(x=0.02, y=0.14)
        error = with_unit(score(output, [comparison]).rmse, quantity, 2)
        panel.text(1, 1.03, f"RMSE {error}", transform=panel.transAxes, ha="right", fontsize=7.5)
    panels[0].text(0, 1.03, label_text(compared[0].label), transform=panels[0].transAxes, fontsize=7.5)
    panels[0].set_ylabel(f"{quantity.name} ({spelled_unit(quantity.display_unit)})")
    panels[0].yaxis.set_label_coords(-0.48 / (panels[0].get_position().width * PAGE_WIDTH), 0.5)
