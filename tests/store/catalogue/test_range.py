"""Ranges and dates of a query: read as written, or refused with a reason."""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime, timedelta, timezone

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.errors import InputError
from ipmclab.store.catalogue.range import Range, parse_moment, parse_range, seconds_of
from ipmclab.units import CHANNELS, FREQUENCY, RELATIVE_HUMIDITY, VOLTAGE, format_quantity

numbers = st.floats(allow_nan=False, allow_infinity=False)


@given(numbers, numbers, st.sampled_from([*CHANNELS.values(), FREQUENCY]))
def test_a_written_range_reads_back(one: float, other: float, quantity) -> None:
    low, high = sorted((one, other))
    written = [format_quantity(value, quantity) for value in (low, high)]
    assert parse_range("..".join(written), quantity, where="x") == Range(low, high)
    assert parse_range(" .. ".join(written), quantity, where="x") == Range(low, high)
    assert parse_range(f"{written[0]}..", quantity, where="x") == Range(low, math.inf)
    assert parse_range(f"..{written[1]}", quantity, where="x") == Range(-math.inf, high)
    assert parse_range(f"{low!r}..{written[1]}", quantity, where="x") == Range(low, high)  # one unit for both


@given(numbers, numbers, numbers)
def test_a_range_holds_what_lies_between(one: float, other: float, value: float) -> None:
    low, high = sorted((one, other))
    if low <= value <= high:
        assert value in Range(low, high)
    slack = 2e-9 * max(abs(low), abs(high))
    if value < low - slack or value > high + slack:
        assert value not in Range(low, high)


def test_rounding_is_no_reason_to_leave_a_run_out() -> None:
    assert 0.1 + 0.2 in Range(0.3, 0.3)
    assert 0.3000001 not in Range(0.3, 0.3)


@given(st.text(alphabet="0123456789.-+eE Vm%,inf") | st.text())
def test_any_other_text_is_refused_in_our_words(text: str) -> None:
    refusal, found = None, Range(0.0, 0.0)
    try:
        found = parse_range(text, VOLTAGE, where="--amplitude", single=True)
    except InputError as error:
        refusal = error
    assert refusal is None or (refusal.where == "--amplitude" and refusal.repair)
    assert found.low <= found.high
    assert math.isfinite(found.low) or math.isfinite(found.high)


@pytest.mark.parametrize(
    ("text", "code", "says"),
    [
        ("0.9..1.1", "missing-unit", "has no unit"),
        ("1.1 V..0.9 V", "bad-range", "write '0.9 V..1.1 V'"),
        ("..", "bad-range", "two dots"),
        ("1...2 V", "bad-range", "two dots"),
        ("1 V..2 V..3 V", "bad-range", "two dots"),
        ("0.9 A..1.1 V", "bad-unit", "not a voltage"),
        ("0,9 V..1,1 V", "decimal-comma", "decimal point"),
        ("", "bad-number", "number"),
    ],
)
def test_what_is_no_range(text: str, code: str, says: str) -> None:
    with pytest.raises(InputError, match=re.escape(says)) as caught:
        parse_range(text, VOLTAGE, where="--amplitude")
    assert caught.value.code == code


def test_one_value_is_enough_for_what_was_commanded_not_for_what_was_measured() -> None:
    assert parse_range("1 V", VOLTAGE, where="x", single=True) == Range(1.0, 1.0)
    with pytest.raises(InputError, match="never exactly that"):
        parse_range("80 percent", RELATIVE_HUMIDITY, where="--humidity")


offsets = st.integers(-23, 23).map(lambda hours: timezone(timedelta(hours=hours)))
moments = st.datetimes(datetime(1975, 1, 1), datetime(2100, 1, 1), timezones=offsets)


@given(moments)
def test_a_date_with_an_offset_means_the_same_everywhere(moment: datetime) -> None:
    expected = (moment - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds()
    assert parse_moment(moment.isoformat(), where="x") == pytest.approx(expected, abs=1e-6)
    assert seconds_of(moment.isoformat()) == pytest.approx(expected, abs=1e-6)


@given(st.dates(datetime(1975, 1, 1).date(), datetime(2100, 1, 1).date()))
def test_until_a_day_means_to_its_end(day) -> None:
    late = datetime(day.year, day.month, day.day, 23, 59, 59)
    assert parse_moment(day.isoformat(), where="x", end=True) > late.timestamp()
    tomorrow = day + timedelta(days=1)
    assert parse_moment(day.isoformat(), where="x", end=True) < parse_moment(tomorrow.isoformat(), where="x")
    assert parse_moment(f"{day} 00:00", where="x", end=True) == parse_moment(day.isoformat(), where="x")


@given(st.text())
def test_any_text_is_a_date_or_refused(text: str) -> None:
    code = "bad-date"
    try:
        parse_moment(text, where="--since")
    except InputError as error:
        code = error.code
    assert code == "bad-date"
    assert seconds_of(text) is None or isinstance(seconds_of(text), float)


@pytest.mark.parametrize("text", ["2026-11-21 00:00", "2026-11-21T00", "2026-11-21T00:00"])
def test_a_midnight_that_is_written_is_no_end_of_a_day(text: str) -> None:
    assert parse_moment(text, where="x", end=True) == parse_moment("2026-11-21", where="x")
