"""Measured against model: each output of a run, with what is left over below it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from ipmclab.prediction.scores import Comparison
from ipmclab.quality.record import ranges_of
from ipmclab.reporting.figures.panels import (
    MEASURED,
    band,
    curve,
    held_curve,
    left_out_curve,
    legend_above,
    model_series,
    name_panel,
    scale_to_lines,
    shade,
    stacked,
)
from ipmclab.reporting.style import COLOURS, label_text, style
from ipmclab.run import Run
from ipmclab.units import CHANNELS, VOLTAGE

FloatArray = npt.NDArray[np.float64]


def prediction_figure(run: Run, models: Mapping[str, Mapping[str, Comparison]]) -> Figure:
    """Draw measured and modelled outputs of one run over time, each with its residual.

    Parameters
    ----------
    run : Run
        Gives time, voltage and hold.
    models : mapping of model name to (mapping of output to Comparison)
        One or several models over the same outputs; rows that do not count are shaded and do not set the scale, and
        an output of which none count is not drawn with others.

    Returns
    -------
    figure : Figure
    """
    each = next(iter(models.values()))
    # A channel of noise alone says nothing of the model, and would take the room of those that do.
    outputs = [output for output, one in each.items() if one.used.any()] or list(each)
    with style():
        figure, panels = stacked([0.3, *(height for _ in outputs for height in (0.95, 0.36))])
        held_curve(panels[0], run.time, run.voltage, run.hold, color=COLOURS["ink"], linewidth=1.0)
        name_panel(panels[0], "voltage", VOLTAGE, ticks=2)
        for place, output in enumerate(outputs):
            above, below = panels[1 + 2 * place], panels[2 + 2 * place]
            quantity = CHANNELS[output]
            for index, (name, comparisons) in enumerate(models.items()):
                one = comparisons[output]
                counts = one.used if one.used.any() else np.ones_like(one.used)
                if index == 0:
                    counted = np.where(counts, one.measured, np.nan)
                    curve(above, output, one.time, counted, label="measured", **MEASURED)
                    left_out = ranges_of(np.flatnonzero(~one.used))
                    shade(above, one.time, left_out, colour=COLOURS["mask"], label="left out")
                    shade(below, one.time, left_out, colour=COLOURS["mask"])
                if index == 0 and one.reach is not None:
                    band(above, output, one.time, one.predicted, one.reach, label="95 % band")
                    band(below, output, one.time, np.zeros_like(one.reach), one.reach)
                curve(above, output, one.time, one.predicted, label=label_text(name), **model_series(index))
                left = np.where(counts, one.error, np.nan)
                curve(below, output, one.time, left, linewidth=0.8, color=model_series(index)["color"])
            name_panel(above, quantity.name, quantity, ticks=5)
            name_panel(below, "measured − model", quantity, ticks=2, bold=False)
            below.axhline(0.0, color=COLOURS["muted"], linewidth=0.5)
            # A band that is far wider than the record would flatten it: the caption says how wide it is.
            scale_to_lines(above)
            scale_to_lines(below)
            first = each[output]
            if first.used.any():
                left_out_curve(above, output, first.time, np.where(first.used, np.nan, first.measured))
            legend_above(above)
    return figure
