"""Samples of parameters, each by itself and each pair: how wide they are, and how they are correlated."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from ipmclab.fit.fit import Fit
from ipmclab.posterior.posterior import Posterior, SampledParameter
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.style import COLOURS, PAGE_WIDTH, style
from ipmclab.reporting.wording import power_of_ten

FloatArray = npt.NDArray[np.float64]

_WIDE: Final = 30.0  # ratio of the ends of an interval from which an axis is logarithmic
_SHOWN: Final = (0.001, 0.999)
_BINS: Final = 48
_PARTS: Final = (0.95, 0.68)
"""Parts of the samples inside the two outlines, the wide one first."""


def pairs_figure(posterior: Posterior, fit: Fit | None = None) -> Figure:
    """Draw the samples of a posterior.

    On the diagonal how often each value was drawn, with the fit's value and 95 % interval above it; below it the
    smallest regions that hold 68 % and 95 % of each pair.

    Parameters
    ----------
    posterior : Posterior
    fit : Fit, optional
        Whose values and intervals are to be shown with the samples.

    Returns
    -------
    figure : Figure
    """
    ones = list(posterior.parameters.values())
    axes = [_Axis(one, posterior.samples[one.name].ravel()) for one in ones]
    size = (PAGE_WIDTH - 0.9) / len(ones) - 0.08
    with style():
        figure, panels = panel_grid(
            [min(size, 1.6)] * len(ones),
            len(ones),
            margins=Margins(left=0.75, right=0.15, top=0.35, bottom=0.8, row_gap=0.08, column_gap=0.08),
        )
        for row, column in np.ndindex(panels.shape):
            panel = panels[row, column]
            if column > row:
                panel.set_visible(False)
                continue
            if row == column:
                _alone(panel, axes[row], fit)
            else:
                _together(panel, axes[column], axes[row])
            _label(panel, axes[column], axes[row], row=row, column=column, last=len(ones) - 1)
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="upper right", ncols=1, bbox_to_anchor=(1.0 - 0.1 / PAGE_WIDTH, 1.0), borderaxespad=0.6
        )
    return figure


class _Axis:
    """One parameter on paper: in the unit that people read, logarithmic where it spans that much."""

    def __init__(self, one: SampledParameter, samples: FloatArray) -> None:
        self.one = one
        self.factor = one.quantity.to_display(1.0) if one.quantity is not None else 1.0
        self.values = samples * self.factor
        low, high = one.interval
        self.log = bool(low > 0.0 and high / low > _WIDE)
        self.ends = tuple(float(end) for end in np.quantile(self.values, _SHOWN))
        if not self.log:
            margin = 0.04 * (self.ends[1] - self.ends[0])
            self.ends = self.ends[0] - margin, self.ends[1] + margin
        unit = one.quantity.display_unit if one.quantity is not None else one.unit
        run = one.name.partition("[")[2].rstrip("]")
        name = f"{one.symbol} (run {run})" if run else one.symbol
        self.label = f"{name}\n{unit}" if unit else name

    @property
    def positions(self) -> FloatArray:
        """The samples where they stand along the axis."""
        return np.log10(self.values) if self.log else self.values

    @property
    def edges(self) -> FloatArray:
        """Of the cells along the axis, in positions."""
        low, high = np.log10(self.ends) if self.log else self.ends
        return np.linspace(low, high, _BINS + 1)

    def values_at(self, positions: FloatArray) -> FloatArray:
        """Values at positions."""
        return np.asarray(10.0**positions if self.log else positions)


def _alone(panel: Any, axis: _Axis, fit: Fit | None) -> None:
    counts, edges = np.histogram(axis.positions, axis.edges, density=True)
    panel.stairs(counts, axis.values_at(edges), fill=True, color=COLOURS["sky"], alpha=0.6, label="samples")
    top = 1.25 * float(counts.max())
    panel.set_ylim(0.0, top)
    fitted = None if fit is None else fit.parameters.get(axis.one.name)
    if fitted is not None:
        ends = np.clip(axis.factor * np.array(fitted.interval), axis.ends[0], axis.ends[1])
        panel.plot(ends, [0.93 * top] * 2, color=COLOURS["vermillion"], linewidth=1.4, label="fit, 95 %")
        panel.plot([fitted.value * axis.factor], [0.93 * top], "o", color=COLOURS["vermillion"], markersize=3.0)


def _together(panel: Any, across: _Axis, up: _Axis) -> None:
    from scipy.ndimage import gaussian_filter

    counts, _, _ = np.histogram2d(across.positions, up.positions, (across.edges, up.edges))
    smooth = gaussian_filter(counts, 1.2).T
    ordered = np.sort(smooth.ravel())
    mass = np.cumsum(ordered) / smooth.sum()
    levels = [float(ordered[int(np.searchsorted(mass, 1.0 - part))]) for part in _PARTS]
    middles = [axis.values_at(0.5 * (axis.edges[1:] + axis.edges[:-1])) for axis in (across, up)]
    if levels[0] < levels[1] < smooth.max():
        colours = (COLOURS["sky"], COLOURS["blue"])
        panel.contourf(*middles, smooth, [*levels, float(smooth.max())], colors=colours, alpha=0.75)


def _power(value: float, _place: int | None = None) -> str:
    return power_of_ten(value)


def _label(panel: Any, across: _Axis, up: _Axis, *, row: int, column: int, last: int) -> None:
    panel.grid(visible=False)
    panel.set_xscale("log" if across.log else "linear")
    panel.set_xlim(*across.ends)
    if not across.log:
        panel.xaxis.set_major_locator(MaxNLocator(2))
        panel.ticklabel_format(axis="x", useOffset=False)
    else:
        panel.xaxis.set_major_locator(LogLocator(numticks=4))
        panel.xaxis.set_major_formatter(FuncFormatter(_power))
    panel.xaxis.set_minor_formatter(NullFormatter())
    panel.yaxis.set_minor_formatter(NullFormatter())
    panel.tick_params(labelbottom=row == last, labelleft=column == 0 and row > 0)
    panel.tick_params(axis="x", labelrotation=45, labelsize=6.5)
    panel.tick_params(axis="y", labelsize=6.5, left=row != column)
    if row != column:
        panel.set_yscale("log" if up.log else "linear")
        panel.set_ylim(*up.ends)
        if not up.log:
            panel.yaxis.set_major_locator(MaxNLocator(2))
            panel.ticklabel_format(axis="y", useOffset=False)
        else:
            panel.yaxis.set_major_locator(LogLocator(numticks=4))
            panel.yaxis.set_major_formatter(FuncFormatter(_power))
    if row == last:
        panel.set_xlabel(across.label, fontsize=7.5)
    if column == 0 and row > 0:
        panel.set_ylabel(up.label, fontsize=7.5)
    if row == column:
        panel.spines["left"].set_visible(False)
