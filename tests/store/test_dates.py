"""Times that a file writes as dates."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ipmclab.errors import InputError
from ipmclab.store.import_map import ImportMap
from ipmclab.store.importers.dates import DateOrder, is_date, read_dates
from ipmclab.store.importing import import_run

NOON = 12 * 3600 * 10**9
DAY = 2 * NOON
THIRD_OF_MARCH = 20_515 * DAY  # 2026-03-03, counted from 1970-01-01


@pytest.mark.parametrize(
    ("cell", "order", "when"),
    [
        ("2026-03-03 12:00:00", "year-month-day", NOON),
        ("3.3.2026 12:00", "day-month-year", NOON),
        ("03/03/26 12:00:00.000000001", "month-day-year", NOON + 1),
        ("2026-03-03T12:00:00,5", "year-month-day", NOON + 5 * 10**8),
        ("2026-03-03_12:00:01:25", "year-month-day", NOON + 125 * 10**7),
        ("20260303 120000.5", "year-month-day", NOON + 5 * 10**8),
        ("03032026 120000", "day-month-year", NOON),
        ("2026年3月3日 12时00分00秒", "year-month-day", NOON),
        ("Tue, 3rd of March 2026, 12:00:00 pm", "day-month-year", NOON),
        ("Dienstag 3. März 2026 0:00", "day-month-year", 0),
        ("March 3 2026 12:00 a.m.", "month-day-year", 0),
        ("2026-Mar-03 1:00 PM", "year-month-day", NOON + 3600 * 10**9),
        ("26-Mar-03", "year-month-day", 0),
        ("03-Mar-26", "day-month-year", 0),
        ("03-Mar-2026", "year-month-day", 0),
        ("3mar2026", "day-month-year", 0),
        ("2026-03-03 14:30:00+02:30", "year-month-day", NOON),
        ("2026-03-03 22:00:00+10:00", "year-month-day", NOON),
        ("2026-03-03 09:30:00-0230", "year-month-day", NOON),
        ("2026-03-03 12:00:00Z", "year-month-day", NOON),
        ("2026-03-02 24:00:00", "year-month-day", 0),
        ("2026-03-03 11:59:60", "year-month-day", NOON),
        (datetime.datetime(2026, 3, 3, 12, 0, 0, 250), "day-month-year", NOON + 250_000),
    ],
)
def test_a_date_is_one_instant(cell: Any, order: DateOrder, when: int) -> None:
    assert read_dates([cell], order) == [THIRD_OF_MARCH + when]
    assert is_date(cell)


@pytest.mark.parametrize(
    ("cell", "order"),
    [
        ("2026-03-03 24:00:01", "year-month-day"),
        ("2026-03-03 24:30", "year-month-day"),
        ("2026-03-03 25:00", "year-month-day"),
        ("2026-03-03 12:60", "year-month-day"),
        ("2026-03-03 12:00:61", "year-month-day"),
        ("2026-03-03 13:00 pm", "year-month-day"),
        ("2026-03-03 0:00 am", "year-month-day"),
        ("2026-02-29", "year-month-day"),
        ("13/13/2026", "month-day-year"),
        ("2026-03", "year-month-day"),
        ("3 Brumaire 2026", "day-month-year"),
        ("March of May 2026", "day-month-year"),
        ("202-03-03", "year-month-day"),
        ("2026-003-03", "year-month-day"),
        ("2026-03-003", "year-month-day"),
        ("²²-03-03", "year-month-day"),
        ("12:00:00", "year-month-day"),
        ("2026-03-03", "time of day"),
        ("2026-03-03 12:00", "time of day"),
        ("-00:00:01", "time of day"),
        (46_084.5, "year-month-day"),
        (True, "time of day"),
    ],
)
def test_what_is_no_date_in_this_order_is_named_by_its_row(cell: Any, order: DateOrder) -> None:
    with pytest.raises(ValueError, match=r"^1$"):
        read_dates([None, cell], order)


@pytest.mark.parametrize(
    ("cells", "seconds"),
    [
        (["23:59:59", "0:00:01", "23:59:59", "0:00:00"], [86_399, 86_401, 172_799, 172_800]),
        (["13:00", "1:00"], [46_800, 3600]),  # half a day back is a clock that was set, more is a new day
        (["13:00:01", "1:00"], [46_801, 90_000]),
        ([" ", "1:00", None, "2:00"], [None, 3600, None, 7200]),
        ([datetime.time(23, 59, 59, 500_000), datetime.time(0, 1)], [86_399.5, 86_460]),
        ([datetime.timedelta(days=1, seconds=1, microseconds=500_000)], [86_401.5]),
    ],
)
def test_a_time_of_day_goes_on_at_midnight(cells: list[Any], seconds: list[float | None]) -> None:
    assert read_dates(cells, "time of day") == [None if time is None else time * 10**9 for time in seconds]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["2026-03-03,,0", "2026-03-03,09:00:00,1"], "line 2: the row has no time"),  # not read as its midnight
        (["2026-03-03,09:00:00,0", "2026-03-03,,1"], "line 3: the row has no time"),
        (["2026-03-03,09:00:00,0", ",09:00:01,1"], "line 3: the row has no time"),
        (["2026-03-03,09:00:00,0", "2026-03-03,09:00,1"], r"line 3: the time 0 s is that .* \(1 such rows in all\)"),
        (["2026-03-03,09:00:00,0", "2026-03-03,9h,1"], "line 3: '2026-03-03 9h' is no date written as year-month-day"),
    ],
)
def test_a_row_without_its_day_or_its_time_has_none(rows: list[str], message: str, tmp_path: Path) -> None:
    path = tmp_path / "record.csv"
    time = {"column": "T", "date_column": "D", "dates": "year-month-day"}
    table = {"file": {"format": "csv"}, "channels": {"time": time, "voltage": {"column": "U", "unit": "V"}}}
    path.write_text("D,T,U\n2026-03-02,23:59:59.5,0\n 2026-03-03 , 00:00:00.25 ,1\n")
    np.testing.assert_array_equal(import_run(path, ImportMap.from_table(table)).time, [0.0, 0.75])
    path.write_text("\n".join(["D,T,U", *rows]))
    with pytest.raises(InputError, match=message):
        import_run(path, ImportMap.from_table(table))
