"""Frequency response of actuators: gain and phase of each output against the applied voltage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter

from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.figures.panels import model_series
from ipmclab.reporting.style import COLOURS, label_text, style
from ipmclab.reporting.wording import plain, power_of_ten, spelled_unit
from ipmclab.units import CHANNELS


def frequency_figure(
    frequency: npt.NDArray[np.float64],
    models: Mapping[str, Mapping[str, npt.NDArray[np.complex128]]],
    *,
    covered: tuple[float, float] | None = None,
) -> Figure:
    """Draw gain and phase of each output over frequency.

    Parameters
    ----------
    frequency : float array, shape (n_frequency,) [Hz]
    models : mapping of model name to (mapping of output to complex array) [SI unit per V]
    covered : tuple of float [Hz], optional
        Lowest and highest frequency that the runs of the fit could show; the rest is shaded.

    Returns
    -------
    figure : Figure
    """
    outputs: Sequence[str] = list(next(iter(models.values())))
    with style():
        figure, grid = panel_grid([1.5, 1.1], len(outputs), margins=Margins(bottom=0.72, column_gap=0.62), sharex="all")
        handles: dict[str, Any] = {}
        for place, output in enumerate(outputs):
            gain, phase = grid[0, place], grid[1, place]
            quantity = CHANNELS[output]
            for index, (name, responses) in enumerate(models.items()):
                response = responses[output]
                gain.plot(frequency, quantity.to_display(np.abs(response)), **model_series(index))
                phase.plot(frequency, np.rad2deg(np.unwrap(np.angle(response))), **model_series(index))
                handles[label_text(name)] = gain.lines[-1]
            gain.set_xscale("log")
            gain.set_yscale("log")
            gain.set_title(f"{quantity.name} ({spelled_unit(quantity.display_unit)}/V)")
            phase.set_title("phase (deg)", fontweight="normal")
            phase.yaxis.set_major_locator(_degrees(phase))
            phase.set_xlabel("frequency (Hz)")
            phase.set_xlim(frequency[0], frequency[-1])
            for panel in (gain, phase):
                panel.xaxis.set_minor_formatter(NullFormatter())
                panel.xaxis.set_major_locator(LogLocator(numticks=7))
                panel.xaxis.set_major_formatter(FuncFormatter(_bare))
                if covered is not None:
                    handles["not covered by the runs of the fit"] = panel.axvspan(
                        frequency[0], max(covered[0], frequency[0]), color=COLOURS["rule"], alpha=0.45, linewidth=0
                    )
                    panel.axvspan(
                        min(covered[1], frequency[-1]), frequency[-1], color=COLOURS["rule"], alpha=0.45, linewidth=0
                    )
            gain.yaxis.set_major_formatter(FuncFormatter(_bare))
            gain.yaxis.set_minor_formatter(NullFormatter())
            _readable_decades(gain)
        if len(handles) > 1:
            figure.legend(handles.values(), handles.keys(), loc="lower center", ncols=len(handles))
    return figure


def _bare(value: float, _: int) -> str:
    """1, 0.1, 0.01, then 10⁻³ and less: short enough for an axis."""
    return plain(value, 1) if value >= 0.01 else power_of_ten(value)


def _degrees(panel: Axes) -> FixedLocator:
    low, high = panel.get_ylim()
    step = next(step for step in (5, 10, 15, 30, 45, 90, 180, 360) if (high - low) / step <= 5)
    return FixedLocator(list(np.arange(np.floor(low / step), np.ceil(high / step) + 1) * step))


def _readable_decades(panel: Axes) -> None:
    """A gain that changes little gets ticks at 1, 2, 5 as well: a log axis without a number says nothing."""
    low, high = panel.get_ylim()
    if high / low < 30:
        panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
