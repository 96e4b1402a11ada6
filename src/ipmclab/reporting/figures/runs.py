"""Records as they are: every channel over one time axis, several runs together, findings where they lie."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final, overload

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ipmclab.errors import InputError
from ipmclab.kinds import tell_kinds
from ipmclab.prediction.validate import run_labels
from ipmclab.quality import check
from ipmclab.reporting.figures.panels import (
    blocks,
    curve,
    held_curve,
    left_out_curve,
    legend_above,
    name_panel,
    series,
    shade,
    stacked,
)
from ipmclab.reporting.save import save_figure
from ipmclab.reporting.style import COLOURS, label_text, style
from ipmclab.run import Finding, Run
from ipmclab.units import CHANNELS

_DRAWN: Final = ("voltage", "applied_voltage", "current", "displacement", "force")

_EVERYWHERE: Final = 0.9
"""Share of a record that the mark of a finding fills at most; more says nothing of where it is."""


@overload
def plot(
    runs: Sequence[Run] | Run, path: None = None, *, labels: Sequence[str] | None = None, overwrite: bool = False
) -> Figure: ...
@overload
def plot(
    runs: Sequence[Run] | Run, path: str | Path, *, labels: Sequence[str] | None = None, overwrite: bool = False
) -> Path: ...
@tell_kinds
def plot(
    runs: Sequence[Run] | Run,
    path: str | Path | None = None,
    *,
    labels: Sequence[str] | None = None,
    overwrite: bool = False,
) -> Figure | Path:
    """Draw runs as a figure: voltage, current, displacement and force over a common time axis.

    Rows that a finding would leave out, or take as a bound, are shaded where they lie.

    Parameters
    ----------
    runs : Run or sequence of Run
    path : str or Path, optional
        Where the figure goes; its suffix (.svg, .png or .pdf) says which kind. Without it nothing is written.
    labels : sequence of str, optional
        A name for each run; otherwise its signal or source file.
    overwrite : bool
        Whether an existing file may be replaced.

    Returns
    -------
    figure : matplotlib Figure, or the path where it was written

    Raises
    ------
    InputError
        No run, another suffix, a folder that does not exist, or a file that does.

    Examples
    --------
    >>> import tempfile
    >>> run = Run.from_arrays(time=[0.0, 0.02, 0.04], voltage=[0.0, 1.0, 1.0], current=[0.0, 0.06, 0.05])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot(run, Path(folder) / "run.svg").name
    'run.svg'
    """
    drawn = [runs] if isinstance(runs, Run) else list(runs)
    names = labels or run_labels(drawn)

    def draw() -> Figure:
        return runs_figure(drawn, names, [check(run) for run in drawn])

    return draw() if path is None else save_figure(draw, path, overwrite=overwrite)


def runs_figure(runs: Sequence[Run], labels: Sequence[str], findings: Sequence[Sequence[Finding]]) -> Figure:
    """Stack the channels that any of the runs has.

    Parameters
    ----------
    runs : sequence of Run
    labels : sequence of str
        One for each run.
    findings : sequence of sequence of Finding
        Those of each run.

    Raises
    ------
    InputError
        When there is no run.
    """
    if len(labels) != len(runs):
        raise InputError(
            f"{len(labels)} labels for {len(runs)} runs",
            code="unequal-lengths",
            where="labels",
            repair="give one name for each run, or none at all",
        )
    if not runs:
        raise InputError("there is no run to draw", code="no-runs", where="runs", repair="give at least one run")
    channels = [name for name in _DRAWN if any(name in run.channels for run in runs)]
    with style():
        named = [len(_named(channel, findings)) for channel in channels]
        figure, panels = stacked(
            [0.75 if "voltage" in name else 1.3 for name in channels],
            named_above=max(len(runs), named[0]),
            named_in_each=max(named),
        )
        for panel, channel in zip(panels, channels, strict=True):
            for place, (run, label) in enumerate(zip(runs, labels, strict=True)):
                values = run.channels.get(channel)
                if values is None:
                    continue
                look = {**series(place), "linewidth": 1.1, "label": label_text(label)}
                if channel == "voltage":
                    held_curve(panel, run.time, values, run.hold, **look)
                    continue
                about = [finding for finding in findings[place] if finding.channel in (channel, None)]
                masked = _rows(run, [finding for finding in about if finding.effect == "mask"])
                curve(panel, channel, run.time, np.where(masked, np.nan, values), **look)
                colour = COLOURS["mask"] if len(runs) == 1 else str(look["color"])
                _mark(panel, run, about, colour, alone=len(runs) == 1)
                left_out_curve(panel, channel, run.time, np.where(masked, values, np.nan), color=colour)
            name_panel(panel, CHANNELS[channel].name, CHANNELS[channel])
        panels[0].set_xlim(min(run.time[0] for run in runs), max(run.time[-1] for run in runs))
        _legends(panels, len(runs))
    return figure


def _rows(run: Run, findings: Sequence[Finding]) -> npt.NDArray[np.bool_]:
    """The rows that any of the findings names."""
    rows = np.zeros(len(run), dtype=bool)
    for finding in findings:
        for start, stop in finding.samples:
            rows[start:stop] = True
    return rows


def _mark(panel: Axes, run: Run, findings: Sequence[Finding], colour: str, *, alone: bool) -> None:
    """Shade what findings leave out of a channel; where a run is alone, other warnings are a bar at its foot."""
    for finding in findings:
        if finding.effect != "none" and finding.samples:
            # What several runs have alike is named once.
            label = text if (text := _left_out(finding)) not in panel.get_legend_handles_labels()[1] else ""
            shade(panel, run.time, finding.samples, colour=colour, label=label)
    noted = [one for one in findings if one.effect == "none" and one.severity != "info" and one.samples]
    # What is said of all of a record, row by row or here and there, needs no place in it.
    span = float(run.time[-1] - run.time[0])
    noted = [
        one
        for one in noted
        if alone and sum(end - begin for begin, end in blocks(run.time, one.samples)) < _EVERYWHERE * span
    ]
    codes = f"noted: {', '.join(dict.fromkeys(one.code for one in noted))}"
    for place, finding in enumerate(noted):
        label = codes if place == 0 else ""
        shade(panel, run.time, finding.samples, colour=COLOURS["vermillion"], label=label, height=0.03)


def _left_out(finding: Finding) -> str:
    effect = {"mask": "left out", "lower_bound": "a lower bound", "upper_bound": "an upper bound"}[finding.effect]
    return f"{finding.code}: {effect}"


def _named(channel: str, findings: Sequence[Sequence[Finding]]) -> set[str]:
    """What the legend of a channel names of the findings of all runs."""
    ours = [one for of_run in findings for one in of_run if one.channel in (channel, None) and one.samples]
    return {_left_out(one) if one.effect != "none" else "noted" for one in ours}


def _legends(panels: Sequence[Axes], runs: int) -> None:
    """Name the runs once, above the first panel, and the shadings in the panel where they are."""
    for place, panel in enumerate(panels):
        for line in panel.lines:
            if place > 0 or runs == 1:
                line.set_label("_hidden")
        legend_above(panel)
