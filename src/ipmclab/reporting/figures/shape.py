"""The shape of a strip that bends far, at some times, and where a laser reads it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from ipmclab.model.curvature import curvature
from ipmclab.model.shape import shape
from ipmclab.model.stages.laser import Laser
from ipmclab.reporting.style import COLOURS, PAGE_WIDTH, SERIES, style
from ipmclab.run import Run
from ipmclab.units import LENGTH

if TYPE_CHECKING:
    from ipmclab.model import Actuator

FloatArray = npt.NDArray[np.float64]

_SEGMENTS: Final = 60
_PARTS: Final = (1.0 / 3.0, 2.0 / 3.0, 1.0)
_LOWEST: Final = 1.2  # height of the panel [inch]
_HIGHEST: Final = 4.5


def shape_figure(actuator: Actuator, run: Run, times: Sequence[float] | None = None) -> Figure:
    """Draw a strip from the side at some times, to scale, as its actuator bends under the voltage of a run from rest.

    Parameters
    ----------
    actuator : Actuator
    run : Run
        Gives voltage, times and hold.
    times : sequence of float [s], optional
        The rows nearest to them; where it is left out those at which a third, two thirds and all of the largest bending
        is reached, that of the largest bending to the other side, and the last.

    Returns
    -------
    figure : Figure
    """
    length, laser_at = actuator["geometry.free_length"], actuator["geometry.sensing_length"]
    bent = curvature(actuator, run, (np.arange(_SEGMENTS) + 0.5) * length / _SEGMENTS)
    rows = _rows(bent.mean(axis=0)) if times is None else [int(np.abs(run.time - t).argmin()) for t in times]
    shapes = [shape(bent[:, row], length) for row in rows]
    highest = LENGTH.to_display(1.15 * max(0.08 * length, *(float(one.y.max()) for one in shapes)))
    lowest = LENGTH.to_display(1.15 * min(-0.04 * length, *(float(one.y.min()) for one in shapes)))
    left, right = -0.07 * LENGTH.to_display(length), 1.06 * LENGTH.to_display(length)
    left_margin, right_margin, top, bottom = 0.6, 1.9, 0.27, 0.42
    wide = PAGE_WIDTH - left_margin - right_margin
    high = float(np.clip(wide * (highest - lowest) / (right - left), _LOWEST, _HIGHEST))
    with style():
        figure = Figure(figsize=(PAGE_WIDTH, high + top + bottom))
        total = high + top + bottom
        panel = figure.add_axes((left_margin / PAGE_WIDTH, bottom / total, wide / PAGE_WIDTH, high / total))
        panel.add_patch(Rectangle((left, lowest), -left, highest - lowest, color=COLOURS["rule"], linewidth=0))
        panel.axhline(0.0, color=COLOURS["muted"], linewidth=0.5)
        panel.axvline(
            LENGTH.to_display(laser_at), color=COLOURS["muted"], linewidth=0.8, linestyle=(0, (4, 2)), label="laser"
        )
        reach = Laser().last_reading(actuator.parameter_values) if actuator.structure.laser else np.inf
        for place, (row, one) in enumerate(zip(rows, shapes, strict=True)):
            colour = COLOURS[SERIES[place % len(SERIES)]]
            height = one.height_at(laser_at)
            lost = not abs(height) <= reach * (1.0 + 1e-9)
            label = f"{run.time[row]:.4g} s" + (", lost by the laser" if lost else "")
            x, y = LENGTH.to_display(one.x), LENGTH.to_display(one.y)
            panel.plot(x, y, color=colour, linewidth=1.8, linestyle=(0, (3, 1.5)) if lost else "-", label=label)
            if not lost:
                at = LENGTH.to_display(laser_at), LENGTH.to_display(height)
                panel.plot(*at, marker="o", markersize=4, color=colour, linestyle="none")
        panel.set_xlim(left, right)
        panel.set_ylim(lowest, highest)
        panel.set_aspect("equal", adjustable="box", anchor="W")
        panel.set_title("the strip from the side (mm)")
        panel.set_xlabel("from the clamp (mm)")
        panel.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure


def _rows(bending: FloatArray) -> list[int]:
    size = np.abs(bending)
    largest = int(size.argmax())
    side = np.sign(bending[largest])
    found = {int(np.argmax(size >= part * size[largest])) for part in _PARTS}
    other = -side * bending
    if other.max() > 0.1 * size[largest]:
        found.add(int(other.argmax()))
    return sorted(found | {len(bending) - 1})
