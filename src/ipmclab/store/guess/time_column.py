"""Which column of a foreign record is its time: seconds, dates, days since long ago, or none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from ipmclab.run import FloatArray
from ipmclab.store.guess.inquiry import Column, Inquiry
from ipmclab.store.guess.question import Question
from ipmclab.store.guess.readings import find_dates
from ipmclab.store.import_map import EXAMPLE_PERIOD, MAPPED

_FEW_DUPLICATES: Final = 0.05  # of the rows: more is a clock that is coarser than the rows
_DAYS: Final = (
    (20_000.0, 80_000.0),
    (690_000.0, 800_000.0),
)  # since 1900, as Excel counts, and since 0, as MATLAB does
_SINCE: Final = {"s": ((1e9, 4.5e9),), "ms": ((1e12, 4.5e12),)}  # since 1970 or 1904


def find_time(inquiry: Inquiry) -> None:
    """Find the time of the rows and put it into the map, or ask for it.

    Raises
    ------
    InputError
        An answer is none of those that can be given.
    """
    if inquiry.columns.clocks and any(inquiry.columns.clocks):
        inquiry.take("the file records its sampling period")
        return
    named = [column for column in inquiry.all if "time" in column.heading.channels and not column.heading.is_row]
    named = named or [column for column in inquiry.all if column.heading.of_unit == ("time",) and column.readings]
    rising = [column for column in named if column.readings and column.readings.rises]
    stated = [column for column in rising if column.heading.unit]
    chosen = _each_once(inquiry, stated or rising)
    if len(chosen) > 1:
        picked = inquiry.choose("time", chosen, "which column is the time?", optional=False)
        if picked is None:
            return
        chosen = [picked]
    if chosen:
        _numeric_time(inquiry, chosen[0])
    elif not _dates(inquiry, [column for column in inquiry.all if column.readings is None]):
        rising = [column for column in inquiry.all if _may_be_time(column)]
        picked = inquiry.choose("time", rising, "is one of these the time?", optional=True) if rising else None
        if picked is not None:
            _numeric_time(inquiry, picked)
        elif not inquiry.is_open("channels.time.column"):
            said = _where_it_falls(inquiry, named) or "the file does not say when its rows were read"
            _ask_period(inquiry, f"{said}: what is the time between two rows?")


def _each_once(inquiry: Inquiry, columns: Sequence[Column]) -> list[Column]:
    """Without columns that repeat the times of one before them: some programs write the time beside each channel."""
    found: list[Column] = []
    for column in columns:
        if any(column.heading.unit == other.heading.unit and _are_equal(column, other) for other in found):
            inquiry.used.add(column.place)
        else:
            found.append(column)
    return found


def _are_equal(one: Column, other: Column) -> bool:
    assert one.readings is not None
    assert other.readings is not None
    return np.array_equal(one.readings.values, other.readings.values, equal_nan=True)


def _where_it_falls(inquiry: Inquiry, named: Sequence[Column]) -> str:
    """Where the first column that is called time lacks one or does not rise; an empty text where that is nowhere."""
    column = next((column for column in named if column.readings is not None and column.readings.count), None)
    if column is None or column.readings is None:
        return ""
    missing = np.isnan(column.readings.values)
    steps = np.diff(column.readings.values)
    falls = steps < 0.0 if (steps < 0.0).any() else steps == 0.0  # a clock may be coarse
    rows = np.flatnonzero(missing) if missing.any() else np.flatnonzero(falls) + 1
    if not len(rows):
        return ""
    what = "are missing" if missing.any() else "do not rise"
    return f"the times in {inquiry.label(column)} {what} at {inquiry.columns.place(int(rows[0]), column.place)}"


def _may_be_time(column: Column) -> bool:
    return (
        column.readings is not None
        and column.readings.is_regular
        and not column.heading.is_row
        and not column.heading.channels
        and column.heading.of_unit in ((), ("time",))
        and not column.heading.foreign_unit
    )


def _ask_period(inquiry: Inquiry, text: str) -> None:
    answer = inquiry.ask(Question("sampling_period", text, example=EXAMPLE_PERIOD))
    if answer:
        inquiry.table["sampling_period"] = answer


def _numeric_time(inquiry: Inquiry, column: Column) -> None:
    readings = column.readings
    assert readings is not None
    unit, since = column.heading.unit if "time" in column.heading.of_unit else "", False
    step = float(np.median(np.diff(readings.present))) if readings.count > 1 else 0.0
    if not unit and step < 1e-2 and any(low < readings.present[0] < high for low, high in _DAYS):
        unit, since = "d", True
    for name, spans in _SINCE.items():
        if unit in ("", name) and any(low < readings.present[0] < high for low, high in spans):
            unit, since = name, True
    if not unit:
        unit = inquiry.ask(
            Question(
                "channels.time.unit",
                f"in which unit is the time {inquiry.label(column)}? It steps by {step:.6g}",
                tuple(MAPPED["time"].units),
            )
        )
    _place_time(inquiry, column, {"unit": unit} if unit else {}, readings.values, in_words=unit or "unit not known")
    if since and "time" in inquiry.table["channels"]:
        inquiry.table["channels"]["time"]["zero_rows"] = [0, 1]


def _dates(inquiry: Inquiry, texts: Sequence[Column]) -> bool:
    """Take one column of dates, or one with the date and one with the time of day, for the time."""
    found = find_dates([inquiry.columns.cells[column.place] for column in texts])
    if found is None:
        return False
    places, order, times = found
    keys: dict[str, Any] = {"dates": order}
    if len(places) > 1:
        keys["date_column"] = texts[places[0]].name
        inquiry.used.add(texts[places[0]].place)
    _place_time(inquiry, texts[places[-1]], keys, times, in_words=order)
    return True


def _place_time(inquiry: Inquiry, column: Column, keys: dict[str, Any], times: FloatArray, *, in_words: str) -> None:
    inquiry.used.add(column.place)
    steps = np.diff(times)
    again = np.flatnonzero(steps == 0.0)
    if len(again) > _FEW_DUPLICATES * len(times):
        _ask_period(
            inquiry,
            f"the times in {inquiry.label(column)} are coarser than the rows ({len(again)} rows have the time of the "
            "row before): what is the time between two rows?",
        )
        return
    if len(again):
        keys["duplicates"] = "drop"
        line = inquiry.columns.place(int(again[0]) + 1, column.place)
        inquiry.take(f"left out: rows with the time of the row before ({len(again)}, first at {line})")
    inquiry.table["channels"]["time"] = {"column": column.name, **keys}
    inquiry.take(f"time: column {inquiry.label(column)}, {in_words}")
