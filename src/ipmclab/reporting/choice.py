"""The report of a choice between models: one HTML file, or its figure alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ipmclab.reporting.figures.choice import choice_figure
from ipmclab.reporting.page_file import render, write_page
from ipmclab.reporting.save import save_figure
from ipmclab.reporting.svg import inline_svg
from ipmclab.reporting.wording import NO_BREAK, plain, with_unit
from ipmclab.run import Run
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    from ipmclab.choosing.choice import Choice


@dataclass(frozen=True)
class ModelRow:
    """One model of the table."""

    name: str
    parameters: str
    difference: str
    verdict: str
    rmse: tuple[str, ...]
    aic: str
    bic: str


def plot_choice(choice: Choice, path: str | Path, *, overwrite: bool = False) -> Path:
    """Draw a choice as a figure: ranked differences with their errors.

    Parameters
    ----------
    choice : Choice
    path : str or Path
        Ending in .svg, .png or .pdf.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    InputError
        Another suffix, a folder that does not exist, or a file that does.
    """
    return save_figure(lambda: choice_figure(choice), path, overwrite=overwrite)


def report_choice(
    choice: Choice, path: str | Path, *, runs: Sequence[Run] = (), command: str = "", overwrite: bool = False
) -> Path:
    """Write one self-contained HTML file about a choice.

    Parameters
    ----------
    choice : Choice
        What ``choose`` returned.
    path : str or Path
        Ending in .html.
    runs : sequence of Run
        The runs, whose content hashes stand in the report.
    command : str
        How it was asked for, kept in it.
    overwrite : bool
        Whether an existing file may be replaced.

    Returns
    -------
    path : Path

    Raises
    ------
    InputError
        Another suffix, a folder that does not exist, or a file that does.
    """
    return write_page(lambda: choice_html(choice, runs, command=command), path, overwrite=overwrite)


def choice_html(choice: Choice, runs: Sequence[Run] = (), *, command: str = "") -> str:
    """The text of the report of a choice."""
    alike = [one.name for one in choice.ranked[1:] if not choice.differences[one.name, choice.best].is_distinguished]
    return render(
        "choice.html.j2",
        sentences=choice.sentences,
        doubt=bool(alike),
        outputs=[CHANNELS[output].name for output in choice.outputs],
        rows=[_row(choice, place) for place in range(len(choice.ranked))],
        failed=[one for one in choice.candidates if one.reason],
        figure=inline_svg(
            choice_figure(choice), "choice", "Models in the order of their predictive likelihood, with errors"
        ),
        pairs=[
            (str(difference), difference.is_distinguished)
            for place, first in enumerate(choice.ranked)
            for second in choice.ranked[place + 1 :]
            for difference in [choice.differences[first.name, second.name]]
        ],
        noises=[
            (one.name, CHANNELS[output].name, _noise(one.noise[output].parts))
            for one in choice.ranked
            for output in choice.outputs
        ],
        held_out="whole runs" if choice.held_out == "runs" else "blocks of time",
        blocks=choice.blocks,
        readings=choice.readings,
        effective=plain(choice.effective_readings, 2),
        labels=choice.labels,
        labelled=[(label, run.content_sha256) for label, run in zip(choice.labels, runs, strict=False)],
        command=command,
    )


def _row(choice: Choice, place: int) -> ModelRow:
    one = choice.ranked[place]
    difference = choice.to_best(one.name)
    words = (
        "best prediction"
        if difference is None
        else "worse"
        if difference.is_distinguished
        else "not distinguishable from the best"
    )
    return ModelRow(
        name=one.name,
        parameters=str(one.parameters),
        difference="0" if difference is None else f"{plain(difference.value)} ± {plain(difference.standard_error, 2)}",
        verdict=f"{words}; preferred" if one.name == choice.preferred else words,
        rmse=tuple(with_unit(one.rmse[output], CHANNELS[output]) for output in choice.outputs),
        aic=_above(one.aic, [other.aic for other in choice.ranked]),
        bic=_above(one.bic, [other.bic for other in choice.ranked]),
    )


def _above(value: float | None, values: Sequence[float | None]) -> str:
    """A criterion, counted from the smallest one."""
    known = [other for other in values if other is not None]
    return plain(None if value is None else value - min(known))


def _noise(parts: Sequence[tuple[float, float]]) -> str:
    if not parts:
        return "white"
    lines = [f"{plain(100.0 * size, 2)} % of range for {plain(time, 2)}{NO_BREAK}s" for size, time in parts]
    return f"white, and {' and '.join(lines)}"
