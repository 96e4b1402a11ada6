"""The part of a comparison's page that says what strips of one make do, by its posterior."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from ipmclab.comparison.display import quantity_of
from ipmclab.comparison.population_words import sentences
from ipmclab.reporting.figures.population import MOST_CONDITIONS, Interval, condition_text
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
    conditions = one.conditions()
    rows = tuple(
        (
            condition_text(one, each),
            f"{with_unit(each.mean[0], quantity)} ({_ends(each.mean[1], quantity)})",
            with_unit(each.next_strip[0], quantity),
            _ends(each.next_strip[1], quantity),
            "–" if each.by_mixed_model is None else _ends(each.by_mixed_model[1], quantity),
        )
        for each in conditions[:MOST_CONDITIONS]
    )
    said = tuple(sentences(one, partial(with_unit, quantity=quantity)))
    return PopulationPart(name, rows, max(len(conditions) - MOST_CONDITIONS, 0), said)


def _ends(interval: Interval, quantity: Quantity) -> str:
    return f"{with_unit(interval[0], quantity)} to {with_unit(interval[1], quantity)}"
