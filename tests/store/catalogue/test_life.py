"""What runs tell of the life of their sample."""

from __future__ import annotations

from typing import Any

import pytest

from ipmclab.store.catalogue.life import life_of
from ipmclab.store.catalogue.query import CatalogueRow

NOTHING = dict.fromkeys(CatalogueRow._fields) | {"id": 0, "version": 1, "duration": 60.0}


def rows(*given: dict[str, Any]) -> list[CatalogueRow]:
    return [CatalogueRow(**NOTHING | {"id": place} | one) for place, one in enumerate(given, 1)]


@pytest.mark.parametrize(
    ("second", "taken_out"),
    [
        ({"recorded": 600.0, "minutes_out_of_water": 11.0}, None),  # it was out of the water all the time
        ({"recorded": 600.0, "minutes_out_of_water": 1.0}, 540.0),
        ({"recorded": 600.0, "minutes_out_of_water": 0.5}, 570.0),
        ({"recorded": 600.0, "minutes_out_of_water": 9.5}, None),  # taken out while the run before went on
        ({"recorded": 900.0, "minutes_out_of_water": 9.0}, 360.0),  # longer than before, but since after that run
        ({"recorded": 310.0, "minutes_out_of_water": 0.2}, 300.0),  # not before the end of the run before
        ({"recorded": 200.0, "minutes_out_of_water": 0.2}, 200.0),  # which overlaps by its clock: not after itself
        ({"recorded": 600.0}, None),
    ],
)
def test_when_it_was_taken_out_of_the_water(second: dict[str, Any], taken_out: float | None) -> None:
    first = {"recorded": 0.0, "minutes_out_of_water": 1.0, "duration": 300.0}
    if second.get("minutes_out_of_water") == 9.5:
        first["duration"] = 60.0
    events = [one for one in life_of("S", rows(first, second)).events if one.kind == "out of water"]
    assert [(one.time, one.row.id) for one in events] == [
        (-60.0, 1),
        *([] if taken_out is None else [(taken_out, 2)]),
    ]


def test_its_mountings_runs_and_fingerprints_in_their_order() -> None:
    life = life_of(
        "S",
        rows(
            {"recorded": 900.0, "mounting": "b", "series_resistance": 16.0},
            {"recorded": None, "mounting": "c"},
            {"recorded": 0.0, "mounting": "a", "capacitance": 5e-3, "duration": None},
            {"recorded": 300.0, "mounting": "a"},
            {"recorded": 600.0},
            {"recorded": 1200.0, "mounting": "a"},
        ),
    )
    assert [(one.kind, one.row.id) for one in life.events] == [
        ("clamped", 3),
        ("run", 3),
        ("run", 4),
        ("run", 5),
        ("clamped", 1),
        ("run", 1),
        ("clamped", 6),
        ("run", 6),
    ]
    assert life.mountings == ("a", "b")
    assert [row.id for row in life.fingerprints] == [3, 1]
    assert [row.id for row in life.undated] == [2]
    assert life.driven == 240.0
