"""The life of a sample: when it was taken out of the water, clamped and driven, and how it changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from ipmclab.store.catalogue.query import CatalogueRow

Kind = Literal["out of water", "clamped", "run"]


@dataclass(frozen=True)
class Event:
    """Something in the life of a sample.

    Parameters
    ----------
    kind : "out of water", "clamped" or "run"
    time : float [s since 1970]
        When a strip was clamped is not recorded: it is at the first run of the mounting.
    row : CatalogueRow
        The run, or the one that shows it.
    """

    kind: Kind
    time: float
    row: CatalogueRow


@dataclass(frozen=True)
class Life:
    """What the catalogue knows of a sample.

    Parameters
    ----------
    sample : str
    events : tuple of Event
        In their order.
    undated : tuple of CatalogueRow
        Runs that do not say when they were recorded, such as simulated ones.
    """

    sample: str
    events: tuple[Event, ...]
    undated: tuple[CatalogueRow, ...]

    @property
    def runs(self) -> tuple[CatalogueRow, ...]:
        """The runs that have a date, the oldest first."""
        return tuple(event.row for event in self.events if event.kind == "run")

    @property
    def fingerprints(self) -> tuple[CatalogueRow, ...]:
        """The runs that give series resistance and capacitance."""
        return tuple(row for row in self.runs if row.series_resistance is not None or row.capacitance is not None)

    @property
    def mountings(self) -> tuple[str, ...]:
        """The ids of its mountings, in their order."""
        return tuple(dict.fromkeys(str(event.row.mounting) for event in self.events if event.kind == "clamped"))

    @property
    def driven(self) -> float:
        """How long [s] it was recorded in all."""
        return sum(row.duration or 0.0 for row in self.runs)


def life_of(sample: str, rows: Sequence[CatalogueRow]) -> Life:
    """Put the runs of a sample in order, and find from them when it was taken out of the water and clamped.

    Parameters
    ----------
    sample : str
    rows : sequence of CatalogueRow
        Its runs.

    Examples
    --------
    >>> life_of("S2", []).mountings
    ()
    """
    dated = sorted((row for row in rows if row.recorded is not None), key=lambda row: (row.recorded, row.id))
    events: list[Event] = []
    over = float("-inf")  # when the run before was
    clamped: str | None = None
    out: CatalogueRow | None = None
    for row in dated:
        assert row.recorded is not None
        if row.minutes_out_of_water is not None:
            taken_out = row.recorded - 60.0 * row.minutes_out_of_water
            # Less time out of the water than at an earlier run, or taken out after it: it was in the water in between.
            since = out.minutes_out_of_water if out is not None else None
            if since is None or row.minutes_out_of_water < since or taken_out > over:
                events.append(Event("out of water", min(max(taken_out, over), row.recorded), row))
            out = row
        if row.mounting is not None and row.mounting != clamped:
            events.append(Event("clamped", row.recorded, row))
            clamped = row.mounting
        events.append(Event("run", row.recorded, row))
        over = row.recorded + (row.duration or 0.0)
    return Life(sample, tuple(events), tuple(row for row in rows if row.recorded is None))
