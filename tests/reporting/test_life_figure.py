"""The time line of a sample's life: in order, cut at pauses, complete."""

from __future__ import annotations

import itertools
from datetime import datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.errors import InputError
from ipmclab.reporting.figures import life as figures
from ipmclab.store.catalogue.life import Life, life_of
from ipmclab.store.catalogue.query import CatalogueRow

START = 1795000000.0
HOUR = 3600.0


def row(number: int, recorded: float | None, **facts) -> CatalogueRow:
    nothing = dict.fromkeys(CatalogueRow._fields)
    return CatalogueRow(**(nothing | {"id": number, "recorded": recorded, "duration": 50.0} | facts))


def life(*starts: float, **facts) -> Life:
    return life_of("S1", [row(number, START + start, **facts) for number, start in enumerate(starts)])


def test_events_stand_in_their_order() -> None:
    rows = [
        row(1, START, mounting="m1", minutes_out_of_water=10.0),
        row(2, START + 60.0, mounting="m1", minutes_out_of_water=11.0),
        row(3, START + HOUR, mounting="m1", minutes_out_of_water=5.0),  # into the water without taking it off the clamp
        row(4, START + 2 * HOUR, mounting="m2", minutes_out_of_water=65.0),  # re-clamped in the air
        row(5, START + 3 * HOUR, mounting="m1"),
        row(6, None),
    ]
    found = life_of("S1", rows[::-1])
    assert [(event.kind, event.time - START) for event in found.events] == [
        ("out of water", -600.0),
        ("clamped", 0.0),
        ("run", 0.0),
        ("run", 60.0),
        ("out of water", HOUR - 300.0),
        ("run", HOUR),
        ("clamped", 2 * HOUR),
        ("run", 2 * HOUR),
        ("clamped", 3 * HOUR),
        ("run", 3 * HOUR),
    ]
    assert found.mountings == ("m1", "m2")
    assert [one.id for one in found.undated] == [6]
    assert found.driven == 250.0


@given(st.lists(st.floats(0.0, 1e8), min_size=1, max_size=60))
def test_the_time_line_keeps_the_order_and_has_room_for_every_stretch(starts: list[float]) -> None:
    drawn = life(*starts)
    stretches = figures._stretches(drawn)
    assert 1 <= len(stretches) <= figures._MOST_STRETCHES
    assert stretches[0].left == 0.0
    assert stretches[-1].right == pytest.approx(1.0)
    for one, other in itertools.pairwise(stretches):
        assert one.stop < other.start
        assert other.left - one.right == pytest.approx(figures._CUT)
    assert all(one.right - one.left > 0.015 for one in stretches)
    place = figures._places(stretches)
    places = [place(one.recorded or 0.0) for one in drawn.runs]
    assert places == sorted(places)
    assert all(0.0 <= one <= 1.0 for one in places)


def test_what_is_not_known_has_no_panel() -> None:
    assert [panel.get_title(loc="left") for panel in figures.life_figure(life(0.0)).axes] == ["voltage (V)"]
    known = life(0.0, HOUR, series_resistance=10.0, capacitance=0.02, minutes_out_of_water=5.0, relative_humidity=80.0)
    titles = [panel.get_title(loc="left") for panel in figures.life_figure(known).axes]
    assert titles[1:] == [
        "series resistance (Ω)",
        "capacitance (mF)",
        "out of the water (min)",
        "relative humidity (%)",
    ]
    (line,) = figures.life_figure(known).axes[2].lines
    assert list(line.get_ydata()) == [20.0, 20.0]  # mF


def test_numbers_are_joined_within_a_mounting_only() -> None:
    rows = [
        row(number, START + number * HOUR, mounting=mounting, series_resistance=10.0 + number)
        for number, mounting in enumerate(["m1", "m1", "m2", "m2", "m2"])
    ]
    lines = figures.life_figure(life_of("S1", rows)).axes[1].lines
    assert [len(line.get_xdata()) for line in lines] == [2, 3]


def test_mountings_without_a_time_of_their_own() -> None:
    rows = [row(number, START, mounting=f"m{number}") for number in range(3)]
    assert life_of("S1", rows).mountings == ("m0", "m1", "m2")
    figures.life_figure(life_of("S1", rows))


def test_without_a_date_there_is_no_time_line() -> None:
    with pytest.raises(InputError, match="when it was recorded"):
        figures.life_figure(life_of("S1", [row(1, None)]))


def test_the_day_of_the_last_run_is_not_cut_off() -> None:
    before_midnight = datetime(2026, 11, 22, 23, 0).timestamp()
    figure = figures.life_figure(life_of("S1", [row(1, before_midnight), row(2, before_midnight + 1.5 * HOUR)]))
    figure.canvas.draw()
    last = figure.axes[-1].get_xticklabels()[-1]
    assert "\n23 Nov 2026" in last.get_text()
    assert last.get_window_extent().x1 <= figure.bbox.x1
