"""The air around the strip: averaged second by second, whatever the blocks are, and kept with its run."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from ipmclab import RunMetadata
from ipmclab.rig.recording.keeping import InJournal, InMemory, Rows
from ipmclab.rig.recording.slow import Air, AirMean
from ipmclab.run import Mark
from tests.rig.toy_bench import ToyBench, done, kept

HUMIDITY, TEMPERATURE = "relative_humidity", "temperature"


@pytest.mark.parametrize("block", [1, 3, 4, 5, 11, 40])
@pytest.mark.parametrize("first", [0, 2, 9])
def test_every_second_has_the_mean_of_its_own_rows_however_they_are_cut(block: int, first: int) -> None:
    rate, rows = 4.0, np.arange(first, 31)
    values = 40.0 + rows**2 / 7.0
    values[rows % 5 == 0] = np.nan
    mean, told = AirMean((HUMIDITY,), rate), list[Air]()
    for start in range(first, 31, block):
        part = values[start - first : start - first + block]
        told += mean.add(start, {HUMIDITY: part}, len(part))
    told += mean.rest()
    seconds = sorted(set((rows // 4).tolist()))
    assert [air.time for air in told] == [(4 * second + min(4 * second + 4, 31)) / 8 for second in seconds]
    expected = [np.nanmean(values[rows // 4 == second]) for second in seconds]
    assert [air.values[HUMIDITY] for air in told] == pytest.approx(expected)


def test_a_slow_instrument_counts_where_its_rows_begin_and_what_has_no_reading_has_none() -> None:
    mean = AirMean((TEMPERATURE, HUMIDITY), 4.0)
    told = list(mean.add(3, {TEMPERATURE: np.array([20.0, 22.0, np.nan])}, 8))
    assert [(air.time, air.values[TEMPERATURE]) for air in told] == [(0.5, 21.0)]
    assert math.isnan(told[0].values[HUMIDITY])
    assert list(mean.rest()) == []  # nothing was read in the second that is not over


def test_below_a_row_a_second_each_row_is_a_reading() -> None:
    mean = AirMean((HUMIDITY,), 0.25)
    told = [*mean.add(0, {HUMIDITY: np.array([40.0, 50.0])}, 2), *mean.rest()]
    assert [(air.time, air.values[HUMIDITY]) for air in told] == [(2.0, 40.0), (6.0, 50.0)]


def test_seconds_that_were_lost_have_no_reading() -> None:
    mean = AirMean((HUMIDITY,), 2.0)
    told = list(mean.add(0, {HUMIDITY: np.array([40.0])}, 1))
    told += mean.add(7, {HUMIDITY: np.array([50.0])}, 1)
    told += mean.rest()
    assert [(air.time, air.values[HUMIDITY]) for air in told] == [(0.5, 40.0), (3.5, 50.0)]


def rows(first: int, *values: float) -> Rows:
    volts = np.array(values)
    bits = (volts > 2.0).astype(np.uint8)
    return Rows(first, {"voltage": volts / 10}, {"voltage": bits}, {"voltage": volts, "output": volts})


class Noted:
    """A journal that notes what it is told."""

    columns = ("voltage", "voltage_quality", "voltage_raw", "output_raw")

    def __init__(self) -> None:
        self.told: list[Any] = []

    def append(self, first_row: int, columns: Any) -> None:
        self.told.append((first_row, np.asarray(columns).tolist()))

    def event(self, kind: str, time: float, text: str = "", **values: Any) -> None:
        self.told.append((kind, time, text, values))

    def end(self, state: str, reason: str = "", metadata: Any = None) -> None:
        self.told.append((state, reason, metadata))


def test_a_journal_is_told_rows_air_and_marks_in_their_order_but_no_gaps() -> None:
    journal, about = Noted(), RunMetadata()
    keeper = InJournal(journal, journal)  # type: ignore[arg-type]
    keeper.rows(rows(4, 1.0, 3.0))
    keeper.mark(Mark(0.5, "2 rows were lost", "gap"))
    keeper.mark(Mark(0.75, "fan on", "note"))
    keeper.air(Air(0.5, {TEMPERATURE: 21.0, HUMIDITY: math.nan}))
    keeper.end("aborted", "it smells", about)
    assert journal.told == [
        (4, [[0.1, 0.0, 1.0, 1.0], [0.3, 1.0, 3.0, 3.0]]),
        ("note", 0.75, "fan on", {}),
        ("environment", 0.5, "", {TEMPERATURE: 21.0}),
        ("aborted", "it smells", about),
    ]


def test_a_run_in_memory_has_what_it_was_given() -> None:
    keeper = InMemory(4.0)
    keeper.rows(rows(2, 1.0))
    keeper.end("complete", "", RunMetadata())
    assert keeper.run is None  # of one row
    keeper.rows(rows(5, 3.0))
    keeper.mark(Mark(0.75, "fan on", "note"))
    keeper.air(Air(0.5, {TEMPERATURE: 21.0, HUMIDITY: math.nan}))
    keeper.air(Air(1.0, {TEMPERATURE: math.nan, HUMIDITY: math.nan}))
    keeper.end("complete", "", RunMetadata(marks=(Mark(0.0, "before it all", "note"),)))
    run = keeper.run
    assert run is not None
    assert run.time.tolist() == [0.5, 1.25]
    assert run.quality["voltage"].tolist() == [0, 1]
    assert [mark.text for mark in run.metadata.marks] == ["before it all", "fan on"]
    assert (run.metadata.state, run.metadata.state_reason) == ("complete", None)
    assert run.temperature is not None
    np.testing.assert_array_equal(run.temperature, [21.0, np.nan])
    assert run.relative_humidity is None


def test_the_air_of_a_run_is_the_mean_over_it_and_what_was_known_stays_where_nothing_was_read() -> None:
    bench = ToyBench({HUMIDITY: lambda rows, _: 40.0 + (rows >= 10 + 50)})  # 10 rows are those at rest
    outcome = done(bench, metadata=RunMetadata(temperature=25.0))
    assert outcome.metadata.relative_humidity == 40.5
    assert outcome.metadata.temperature == 25.0
    assert kept(outcome).temperature is None
    both = {TEMPERATURE: np.array([21.0004]), "chamber_temperature": np.array([30.0])}
    assert done(slow=lambda: both).metadata.temperature == 21.0  # at the strip
