"""The part of a comparison's page that says what strips of one make do, by its posterior."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from ipmclab.comparison.display import quantity_of
from ipmclab.comparison.population_words import sentences
from ipmclab.reporting.figures.population import MOST_CONDITIONS, Interval, told_of
from ipmclab.reporting.wording import with_unit
from ipmclab.units import Quantity

if TYPE_CHECKING:
    from ipmclab.comparison.population import Population


@dataclass(frozen=True)
class PopulationPart:
    """One metric.

    Parameters
    ----------
    name : str
    rows : tuple of (condition, mean, middle, interval, interval of the mixed model)
    left : int
        Conditions that are in the data alone.
    sentences : tuple of str
    """

    name: str
    rows: tuple[tuple[str, str, str, str, str], ...]
    left: int
    sentences: tuple[str, ...]


def population_parts(populations: Mapping[str, Population]) -> list[PopulationPart]:
    """What a page shows of each metric that was sampled."""
    return [_part(name, one) for name, one in populations.items()]


def _part(name: str, one: Population) -> PopulationPart:
    quantity = quantity_of(one.model.metric.unit)
    told = told_of(one)
    rows = tuple(
        (
            each.condition,
            f"{with_unit(each.mean, quantity)} ({_ends(each.of_mean, quantity)})",
            with_unit(each.middle, quantity),
            _ends(each.interval, quantity),
            "–" if each.mixed is None else _ends(each.mixed[1], quantity),
        )
        for each in told[:MOST_CONDITIONS]
    )
    said = tuple(sentences(one, partial(with_unit, quantity=quantity)))
    return PopulationPart(name, rows, max(len(told) - MOST_CONDITIONS, 0), said)


def _ends(interval: Interval, quantity: Quantity) -> str:
    return f"{with_unit(interval[0], quantity)} to {with_unit(interval[1], quantity)}"
