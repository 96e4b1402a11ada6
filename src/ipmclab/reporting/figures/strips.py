"""How strips look in the figures of a comparison: each has one colour, line and mark on the whole page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ipmclab.reporting.figures.panels import series
from ipmclab.reporting.style import COLOURS, LINES, label_text

MOST_STRIPS: Final = 12
"""Strips that have a colour and a line pattern of their own."""

_MARKS: Final = ("o", "s", "^", "D")
"""A dot has no line pattern: strips of one colour differ by their mark."""

_LEGEND_COLUMNS: Final = 6

Curve = tuple[list[float], list[float]]
"""Places and heights."""

Look = dict[str, Any]


def strips_in_order(every: Sequence[str], shown: Sequence[str]) -> tuple[str, ...]:
    """The strips by whose order looks are given: all of a comparison, so that a strip looks the same in each figure.

    Of more than have a look of their own it is those that a figure shows.

    Examples
    --------
    >>> strips_in_order(["a", "b", "c"], ["b", "c"])
    ('a', 'b', 'c')
    """
    return tuple(every) if len(every) <= MOST_STRIPS else tuple(shown)


def alike(curves: Mapping[str, Curve], order: Sequence[str]) -> list[tuple[Look, list[Curve]]]:
    """The curves of strips by their look: one each, or of many strips one for all, which no colour could distinguish.

    Examples
    --------
    >>> [look["color"] == COLOURS["vermillion"] for look, _ in alike({"b": ([1.0], [2.0])}, ["a", "b"])]
    [True]
    """
    there = {sample: curve for sample, curve in curves.items() if curve[0]}
    if len(order) <= MOST_STRIPS:
        return [(series(order.index(sample)), [curve]) for sample, curve in there.items()]
    return [({"color": COLOURS["blue"], "alpha": 0.35, "linestyle": "-"}, list(there.values()))]


def mark_of(look: Mapping[str, Any]) -> str:
    """The mark of a dot, for a colour and line pattern."""
    return _MARKS[LINES.index(look["linestyle"])]


def joined(curves: Sequence[Curve]) -> Curve:
    """Curves as one, with a gap between each two: many lines of one look are drawn at once."""
    x: list[float] = []
    y: list[float] = []
    for one in curves:
        x += [*one[0], math.nan]
        y += [*one[1], math.nan]
    return x, y


def strips_legend(
    figure: Figure, shown: Sequence[str], order: Sequence[str], further: Mapping[str, Look] | None = None
) -> None:
    """Name the strips of a figure below its panels, and what else is drawn."""
    more = further or {}
    named = shown if len(shown) > 1 and len(order) <= MOST_STRIPS else ()
    looks = [series(order.index(sample)) for sample in named]
    handles = [Line2D([], [], marker=mark_of(look), markersize=3.4, **look) for look in looks]
    handles += [Line2D([], [], **look) for look in more.values()]
    names = [label_text(name, longest=30) for name in (*(sample or "no sample named" for sample in named), *more)]
    if handles:
        figure.legend(handles, names, loc="lower center", ncols=min(len(names), _columns(more)))


def legend_room(shown: Sequence[str], order: Sequence[str], further: Sequence[str] = ()) -> float:
    """Height under the panels for their labels and a legend of the strips, and what else it names [inch]."""
    count = (len(shown) if len(shown) > 1 and len(order) <= MOST_STRIPS else 0) + len(further)
    lines = math.ceil(count / _columns(further))
    return 0.55 + (0.1 + 0.19 * lines if lines else 0.0)


def _columns(further: Mapping[str, Look] | Sequence[str]) -> int:
    """Names of other things than strips are longer."""
    return _LEGEND_COLUMNS // 2 if further else _LEGEND_COLUMNS
