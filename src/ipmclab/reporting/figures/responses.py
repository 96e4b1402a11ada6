"""Figures of frequency responses: of single sines, and of runs with a multisine with noise and distortion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator

from ipmclab.comparison.compare import Comparison
from ipmclab.comparison.frequency_response import FrequencyResponse
from ipmclab.confidence import NORMAL_95
from ipmclab.reporting.figures.comparison import ComparedFigure, few_ticks
from ipmclab.reporting.figures.layout import Margins, panel_grid
from ipmclab.reporting.figures.strips import Curve, alike, joined, legend_room, strips_in_order, strips_legend
from ipmclab.reporting.style import COLOURS, style
from ipmclab.reporting.wording import plain, power_of_ten, spelled_unit
from ipmclab.units import CHANNELS


def response_figures(comparison: Comparison) -> list[ComparedFigure]:
    """Gain and phase over frequency: of single sines, and of each run with a multisine."""
    found = []
    if comparison.sine_responses:
        found.append(_sine_figure(comparison))
    for run, responses in comparison.responses.items():
        data = [
            (one.channel, kind, *point)
            for one in responses
            for kind, points in (
                (
                    "driven",
                    zip(one.frequency, np.abs(one.response), np.angle(one.response), one.standard_error, strict=True),
                ),
                ("even", ((f, level, "", "") for f, level in zip(one.even_frequency, one.even, strict=True))),
                ("odd", ((f, level, "", "") for f, level in zip(one.odd_frequency, one.odd, strict=True))),
            )
            for point in points
        ]
        found.append(
            ComparedFigure(
                name=f"response-{len(found)}",
                title=f"Frequency response, {run}",
                caption="Above: the best linear approximation with its 95 % interval, by noise and distortion. Below: "
                "the output at the driven lines, its noise, and what appears at lines that are not driven (even and "
                "odd distortion).",
                draw=lambda responses=responses: _draw_responses(responses),  # type: ignore[misc]
                columns=("channel", "lines", "frequency [Hz]", "gain or level [SI]", "phase [rad]", "standard_error"),
                data=tuple(data),
            )
        )
    return found


def _sine_figure(comparison: Comparison) -> ComparedFigure:
    responses = comparison.sine_responses
    data = tuple(
        (one.sample, one.channel, one.conditions.get("voltage", ""), f, g, p, ge, pe)
        for one in responses
        for f, g, p, ge, pe in zip(one.frequency, one.gain, one.phase, one.gain_error, one.phase_error, strict=True)
    )
    return ComparedFigure(
        name="response-sines",
        title="Frequency response from single sines",
        caption="Gain and phase of the fundamental over the last whole period, one line a strip and condition.",
        draw=lambda: _draw_sines(comparison),
        columns=(
            "sample",
            "channel",
            "voltage [V]",
            "frequency [Hz]",
            "gain [SI per V]",
            "phase [rad]",
            "gain_error",
            "phase_error",
        ),
        data=data,
    )


def _draw_sines(comparison: Comparison) -> Figure:
    responses = comparison.sine_responses
    channels = [name for name in ("displacement", "force", "current") if any(one.channel == name for one in responses)]
    samples = list(dict.fromkeys(one.sample for one in responses))
    order = strips_in_order(comparison.samples, samples)
    with style():
        figure, grid = panel_grid(
            [1.5, 1.1],
            len(channels),
            margins=Margins(bottom=legend_room(samples, order), column_gap=0.6, row_gap=0.36),
            sharex="all",
        )
        for column, channel in enumerate(channels):
            own = [one for one in responses if one.channel == channel]
            for row in range(2):
                curves: dict[str, list[Curve]] = {sample: [] for sample in samples}
                for one in own:
                    heights = CHANNELS[channel].to_display(one.gain) if row == 0 else np.rad2deg(one.phase)
                    curves[one.sample].append((one.frequency.tolist(), heights.tolist()))
                for look, strips in alike({name: joined(each) for name, each in curves.items()}, order):
                    grid[row, column].plot(*joined(strips), marker="o", markersize=2.6, linewidth=0.9, **look)
            _log_axes(grid[0, column], grid[1, column], channel)
        strips_legend(figure, samples, order)
    return figure


def _log_axes(gain: Axes, phase: Axes, channel: str) -> None:
    quantity = CHANNELS[channel]
    gain.set_xscale("log")
    gain.set_yscale("log")
    gain.yaxis.set_minor_formatter(NullFormatter())
    gain.set_title(f"{quantity.name} ({spelled_unit(quantity.display_unit)}/V)")
    gain.yaxis.set_major_formatter(FuncFormatter(_bare))
    low, high = gain.get_ylim()
    if high / low < 30.0:
        steps = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0) if high / low < 4.0 else (1.0, 2.0, 5.0)
        marks = [one * 10.0**power for power in range(-9, 7) for one in steps]
        gain.yaxis.set_major_locator(FixedLocator([mark for mark in marks if low <= mark <= high]))
        gain.yaxis.set_minor_locator(NullLocator())
    phase.set_title("phase (deg)", fontweight="normal")
    phase.set_xlabel("frequency (Hz)")
    few_ticks(phase)


def _bare(value: float, _: int) -> str:
    """1.5, 0.1, 0.01, then 10⁻³ and less: short enough for an axis."""
    return plain(value, 2, trim=True) if value >= 0.01 else power_of_ten(value)


def _draw_responses(responses: Sequence[FrequencyResponse]) -> Figure:
    with style():
        figure, grid = panel_grid(
            [1.4, 1.0, 1.4],
            len(responses),
            margins=Margins(bottom=0.8, column_gap=0.6, row_gap=0.36),
            sharex="all",
        )
        for column, one in enumerate(responses):
            shown = CHANNELS[one.channel].to_display
            gain, phase, level = grid[:, column]
            size, reach = np.abs(one.response), NORMAL_95 * one.standard_error
            low = np.maximum(size - reach, 0.02 * size)
            gain.fill_between(
                one.frequency, shown(low), shown(size + reach), color=COLOURS["sky"], alpha=0.4, linewidth=0
            )
            gain.plot(one.frequency, shown(size), color=COLOURS["blue"], linewidth=1.0)
            phase.plot(
                one.frequency, np.rad2deg(np.unwrap(np.angle(one.response))), color=COLOURS["blue"], linewidth=1.0
            )
            level.plot(one.frequency, shown(one.output), ".", markersize=3, color=COLOURS["blue"], label="output")
            level.plot(one.frequency, shown(one.noise), color=COLOURS["muted"], linewidth=0.9, label="noise")
            if len(one.even):
                level.plot(one.even_frequency, shown(one.even), "v", markersize=2.4, markeredgewidth=0,
                           color=COLOURS["green"], label="even lines")  # fmt: skip
            if len(one.odd):
                level.plot(one.odd_frequency, shown(one.odd), "^", markersize=2.8, markeredgewidth=0,
                           color=COLOURS["vermillion"], label="odd lines, left out")  # fmt: skip
            level.set_yscale("log")
            level.yaxis.set_minor_formatter(NullFormatter())
            level.set_title(f"level ({spelled_unit(CHANNELS[one.channel].display_unit)})", fontweight="normal")
            level.yaxis.set_major_locator(LogLocator(numticks=6))
            level.yaxis.set_major_formatter(FuncFormatter(_bare))
            _log_axes(gain, phase, one.channel)
            phase.set_xlabel("")
            level.set_xlabel("frequency (Hz)")
        handles, names = grid[2, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="lower center", ncols=len(names))
    return figure
