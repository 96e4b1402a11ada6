"""The characteristic of a strip: what it draws over what is applied."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from ipmclab.errors import InputError
from ipmclab.prediction.validate import run_labels
from ipmclab.quality import check
from ipmclab.quality.usable import usable
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.figures.panels import legend_above, name_panel, series
from ipmclab.reporting.style import COLOURS, label_text, style
from ipmclab.reporting.wording import spelled_unit
from ipmclab.run import Run
from ipmclab.units import CURRENT, VOLTAGE

_HEIGHT: Final = 3.4
_POINTS: Final = 5000
"""Of one curve: what more there is would not be visible."""


def characteristic(runs: Sequence[Run] | Run, *, labels: Sequence[str] | None = None) -> Figure:
    """Draw the current of each run over its voltage: a slope is a conductance, the width of a loop is stored charge.

    A leak bends the ends of the loop of a slow sine upwards; of a capacitor without loss it is an ellipse.
    Readings that a finding leaves out are not drawn.

    Parameters
    ----------
    runs : Run or sequence of Run
        With their current.
    labels : sequence of str, optional
        A name for each run; otherwise its signal or source file.

    Returns
    -------
    figure : Figure
        Write it with ``save_figure``.

    Raises
    ------
    InputError
        No run, or none with a current.

    Examples
    --------
    >>> from ipmclab import load_actuator, simulate
    >>> run = simulate(load_actuator("friend-2"), "sine 1 V 0.1 Hz", duration=20.0, rate=50.0)
    >>> characteristic(run).axes[0].get_xlabel()
    'voltage (V)'
    """
    drawn = [runs] if isinstance(runs, Run) else list(runs)
    names = labels or run_labels(drawn)
    if not any("current" in run.channels for run in drawn):
        raise InputError(
            "no run has a current, which is drawn over the voltage",
            code="no-channel",
            where="runs",
            repair="give runs with the channel current",
        )
    with style():
        figure, grid = panel_grid([_HEIGHT], margins=Margins(top=0.4))
        panel = grid[0, 0]
        panel.axhline(0.0, color=COLOURS["muted"], linewidth=0.5)
        panel.axvline(0.0, color=COLOURS["muted"], linewidth=0.5)
        for place, (run, label) in enumerate(zip(drawn, names, strict=True)):
            if "current" not in run.channels:
                continue
            # A gap where readings are left out: a line across it would be no reading.
            current = np.where(usable(run, check(run))["current"], run.channels["current"], np.nan)
            rows = slice(None, None, max(1, len(run) // _POINTS))
            shown = CURRENT.to_display(current[rows])
            panel.plot(run.voltage[rows], shown, label=label_text(label), linewidth=1.1, **series(place))
        name_panel(panel, CURRENT.name, CURRENT)
        panel.set_xlabel(f"{VOLTAGE.name} ({spelled_unit(VOLTAGE.display_unit)})")
        legend_above(panel)
    return figure
