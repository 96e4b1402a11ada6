"""The part of a report on what runs and mountings say of each other."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from markupsafe import Markup

from ipmclab.fit.mountings import NEXT_STRIP
from ipmclab.fit.state_rows import HEAD, state_rows
from ipmclab.identification.mountings.mountings import why_unknown
from ipmclab.prediction.remarks import left_out_remarks
from ipmclab.reporting.figures.mountings import fit_of_each, mountings_figure
from ipmclab.reporting.page_file import render
from ipmclab.reporting.svg import inline_svg
from ipmclab.reporting.wording import NO_BREAK, percent, plain, spelled_unit, with_unit
from ipmclab.units import CHANNELS

if TYPE_CHECKING:
    from ipmclab.fit.fit import Fit
    from ipmclab.fit.left_out import LeftOut


@dataclass(frozen=True)
class BetweenRow:
    """One parameter, as each mounting has it."""

    name: str
    between: str
    least: str
    most: str
    unit: str


@dataclass(frozen=True)
class LeftOutRow:
    """One output of a run that the others predict."""

    run: str
    output: str
    fit: str
    rmse: str
    inside: str
    change: str
    remark: str


def many_runs_part(fit: Fit) -> Markup:
    """A section of the report: of each mounting by itself, and of each run as the others predict it."""
    mountings = fit.mountings
    why = why_unknown(fit)
    left_out = left_out_rows(fit)
    return Markup(
        render(
            "many_runs.html.j2",
            why_unknown=f"{why[0].upper()}{why[1:]}; {NEXT_STRIP}." if why else "",
            mountings=len(mountings.each) if mountings else 0,
            names=", ".join(one.name for one in mountings.each) if mountings else "",
            between=_between(fit),
            spread=bool(mountings and mountings.between),
            picture=_picture(fit),
            unknown=[f"The next mounting's {name} {reason}." for name, reason in mountings.unknown.items()]
            if mountings and not why
            else [],
            state_head=HEAD,
            states=[row.cells for row in state_rows(fit)],
            left_out=left_out,
            remarks=any(row.remark for row in left_out),
        )
    )


def _between(fit: Fit) -> list[BetweenRow]:
    if fit.mountings is None:
        return []
    rows = []
    for name in fit.mountings.p_value:
        quantity = fit.actuator.parameters()[name].quantity
        values = [quantity.to_display(value) for value in fit_of_each(fit, name)[0]]
        rows.append(
            BetweenRow(
                name, _size(fit, name), plain(min(values)), plain(max(values)), spelled_unit(quantity.display_unit)
            )
        )
    return rows


def _picture(fit: Fit) -> Markup:
    mountings = fit.mountings
    names = [] if mountings is None else [name for name in mountings.p_value if name in mountings.logarithms]
    if not names:
        return Markup()
    return inline_svg(mountings_figure(fit, names), "mountings", "Each parameter as each mounting has it by itself")


def _size(fit: Fit, name: str) -> str:
    mountings = fit.mountings
    if mountings is None or name not in mountings.between:
        return "–"
    if name in mountings.logarithms:
        return f"×{NO_BREAK}{plain(math.exp(mountings.between[name]))}"
    return with_unit(mountings.between[name], fit.actuator.parameters()[name].quantity)


def left_out_rows(fit: Fit) -> list[LeftOutRow]:
    """Each output of each run, as the other runs predict it."""
    said = zip(fit.left_out, left_out_remarks(fit), strict=True)
    return [row for one, remark in said for row in _left_out(one, remark)]


def _left_out(one: LeftOut, remark: str) -> list[LeftOutRow]:
    most = max(one.shifts, key=lambda name: abs(one.shifts[name]), default=None)
    change = "–" if most is None else f"{most}: {plain(one.shifts[most], 2)} of its errors"
    if not one.rmse:
        return [LeftOutRow(one.label, "–", "–", "–", "–", change, remark)]
    return [
        LeftOutRow(
            run=one.label,
            output=CHANNELS[output].name,
            fit=percent(one.fit_percent.get(output)),
            rmse=with_unit(rmse, CHANNELS[output]),
            inside=f"{100.0 * one.inside[output]:.0f}{NO_BREAK}%" if output in one.inside else "–",
            change="" if number else change,
            remark="" if number else remark,
        )
        for number, (output, rmse) in enumerate(one.rmse.items())
    ]
