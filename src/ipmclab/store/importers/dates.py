"""Times that a file writes as dates: on which day and at what time of it each row was read."""

from __future__ import annotations

import datetime
import re
import unicodedata
from collections.abc import Iterable
from typing import Any, Final, Literal, get_args

DateOrder = Literal["year-month-day", "day-month-year", "month-day-year", "time of day"]
"""How a date is written; a time of day without a date continues at midnight."""

DATE_ORDERS: Final[tuple[DateOrder, ...]] = get_args(DateOrder)

_SECOND: Final = 1_000_000_000  # ns
_DAY: Final = 86_400 * _SECOND

_TIME: Final = re.compile(
    r"(?P<hour>[0-9]{1,2}):(?P<minute>[0-9]{2})(?::(?P<second>[0-9]{2})(?:[.,:](?P<part>[0-9]{1,9}))?)?"
    r"\s*(?P<half>[ap]\.?m\.?)?\s*(?P<zone>z|utc|gmt|[+-][0-9]{2}:?[0-9]{2})?$"
)
_COMPACT: Final = re.compile(r"([0-9]{8})[t ]?([0-9]{2})([0-9]{2})([0-9]{2})((?:[.,][0-9]{1,9})?)$")
_WEEKDAY: Final = re.compile(
    r"^(?:mon|tue|wed|thu|fri|sat|sun|montag|dienstag|mittwoch|donnerstag|freitag|samstag|sonntag)[a-z]*[.,]?\s+"
)
_MONTHS: Final = (
    ("jan", "ene", "gen", "янв"),
    ("feb", "fev", "fév", "фев"),
    ("mar", "mär", "mrz", "maer", "maa", "мар"),
    ("apr", "avr", "abr", "апр"),
    ("may", "mai", "mag", "mei", "мая", "май"),
    ("jun", "juin", "giu", "июн"),
    ("jul", "juil", "lug", "июл"),
    ("aug", "aou", "aoû", "ago", "авг"),
    ("sep", "set", "сен"),
    ("oct", "okt", "out", "ott", "окт"),
    ("nov", "ноя"),
    ("dec", "dez", "dic", "dis", "déc", "дек"),
)
"""How the names of the months begin, in the languages of the laboratories that we know of."""


def read_dates(cells: Iterable[Any], order: DateOrder) -> list[int | None]:
    """When each cell says that it was read [ns]; None for a blank one.

    Raises
    ------
    ValueError
        Holds the number of the first row that is no date.

    Examples
    --------
    >>> first, second = read_dates(("3. März 2026 12:00:00,25", "3. März 2026 12:00:00,5"), "day-month-year")
    >>> second - first
    250000000
    """
    found: list[int | None] = []
    days, before = 0, None
    for row, cell in enumerate(cells):
        time = _read(cell, order)
        if time is None and not (cell is None or (isinstance(cell, str) and not cell.strip())):
            raise ValueError(row)
        if time is not None and order == "time of day":
            # Half a day backwards is a new day, less is a clock that was set.
            days += before is not None and time < before - _DAY // 2
            before = time
            time += days * _DAY
        found.append(time)
    return found


def is_date(cell: Any) -> bool:
    """Whether a cell is a date, a time of day or both, in any order."""
    return any(_read(cell, order) is not None for order in DATE_ORDERS)


def _read(cell: Any, order: DateOrder) -> int | None:
    if isinstance(cell, datetime.datetime):
        since = cell.replace(tzinfo=None) - datetime.datetime(1970, 1, 1)
        return (since.days * 86_400 + since.seconds) * _SECOND + since.microseconds * 1000
    if isinstance(cell, datetime.time):
        return ((cell.hour * 60 + cell.minute) * 60 + cell.second) * _SECOND + cell.microsecond * 1000
    if isinstance(cell, datetime.timedelta):
        return (cell.days * 86_400 + cell.seconds) * _SECOND + cell.microseconds * 1000
    return _read_text(cell, order) if isinstance(cell, str) else None


def _read_text(text: str, order: DateOrder) -> int | None:
    written = " ".join(unicodedata.normalize("NFC", text).lower().split())
    written = re.sub(r"([年月])\s*", "/", written).replace("日", " ")
    written = written.replace("时", ":").replace("時", ":").replace("分", ":").replace("秒", "").strip()
    compact = _COMPACT.fullmatch(written)
    if compact:
        day, hour, minute, second, part = compact.groups()
        written = f"{day} {hour}:{minute}:{second}{part}"
    time = _TIME.search(written)
    within = _time_of_day(time) if time else 0
    date = (written[: time.start()] if time else written).rstrip(" t,;-_")
    if within is None:
        return None
    if order == "time of day":
        return within if time and not time.start() else None
    day_number = _day(_WEEKDAY.sub("", date), order)
    return None if day_number is None else day_number * _DAY + within


def _time_of_day(found: re.Match[str]) -> int | None:
    hour, minute, second = int(found["hour"]), int(found["minute"]), int(found["second"] or 0)
    if found["half"]:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + 12 * (found["half"][0] == "p")
    if (hour, minute, second) > (24, 0, 0) or minute > 59 or second > 60:
        return None
    zone = found["zone"] or ""
    ahead = 0
    if zone[:1] in ("+", "-") and zone:
        ahead = (int(zone[1:3]) * 60 + int(zone[-2:])) * (1 if zone[0] == "+" else -1)
    part = int((found["part"] or "0").ljust(9, "0"))
    return (((hour * 60 + minute - ahead) * 60) + second) * _SECOND + part


def _day(date: str, order: DateOrder) -> int | None:
    """The day counted from 1970-01-01."""
    if re.fullmatch("[0-9]{8}", date):
        date = (
            f"{date[:4]}-{date[4:6]}-{date[6:]}" if order == "year-month-day" else f"{date[:2]}-{date[2:4]}-{date[4:]}"
        )
    parts = [
        part for part in re.split(r"(?:st|nd|rd|th)?[\s./,-]+|(?<=[0-9])(?=[^0-9])|(?<=[^0-9])(?=[0-9])", date) if part
    ]
    parts = [part for part in parts if part not in ("de", "of", "of,")]
    if len(parts) != 3:
        return None
    places = dict(zip(order.split("-"), parts, strict=True))
    named = [part for part in parts if not part.isdecimal()]
    if named:
        month = next((k for k, starts in enumerate(_MONTHS, 1) if named[0].startswith(starts)), None)
        numbers = [part for part in parts if part.isdecimal()]
        if month is None or len(numbers) != 2:
            return None
        is_first = len(numbers[0]) == 4 or (len(numbers[1]) < 4 and order == "year-month-day")
        year, day = numbers if is_first else reversed(numbers)
        places = {"year": year, "month": str(month), "day": day}
    if len(places["year"]) not in (2, 4) or len(places["month"]) > 2 or len(places["day"]) > 2:
        return None
    year_number = int(places["year"]) + (0 if len(places["year"]) == 4 else 2000)
    try:
        return datetime.date(year_number, int(places["month"]), int(places["day"])).toordinal() - 719_163
    except ValueError:
        return None
