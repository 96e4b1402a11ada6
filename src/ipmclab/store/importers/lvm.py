"""Records as LabVIEW measurement files (.lvm): a header for the file, one for its segment, then rows of text.

The tags are those of NI's "Specification for the LabVIEW Measurement File", version 2.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final, Literal

from ipmclab.errors import InputError
from ipmclab.store.importers.columns import Clock, Columns, clocks_from
from ipmclab.store.importers.csv import read_text
from ipmclab.store.importers.dates import read_dates
from ipmclab.store.strict import Strict

_MAGIC: Final = "LabVIEW Measurement"
_END: Final = "***End_of_Header***"
_COMMENT: Final = "Comment"
_DECIMALS: Final = re.compile(r"[.,]([0-9]{1,9})[0-9]*$")


class LvmFile(Strict):
    """A LabVIEW measurement file: it says itself how it is written.

    Its time is the column ``X_Value``; where it was saved without x values, its ``Delta_X``, from the ``Date`` and
    ``Time`` of each channel on.
    """

    format: Literal["lvm"]
    encoding: Literal["utf-8", "latin-1", "gbk", "shift_jis"] = "utf-8"


def read(path: Path, options: LvmFile) -> Columns:
    """Read the cells of a LabVIEW measurement file.

    Raises
    ------
    InputError
        Not such a file, a header that does not end, several segments, fewer rows than the header
        promises, a row with another number of cells.
    """
    where = str(path)
    lines = [line.rstrip("\r") for line in read_text(path, options.encoding).split("\n")]
    if not lines[0].startswith(_MAGIC):
        raise _error(where, f"it does not start with {_MAGIC!r}", "see the format in the map")
    ends = [number for number, line in enumerate(lines) if line.startswith(_END)]
    if len(ends) != 2:
        raise _error(
            where,
            f"{len(ends)} lines {_END!r}; one run has two, of the file and of its only segment",
            "save the record with one header, or copy the file again when it is cut short",
        )
    separator = next((line[9:10] for line in lines if line.startswith("Separator")), "") or "\t"
    file_tags = _tags(lines[1 : ends[0]], separator)
    tags = _tags(lines[ends[0] + 1 : ends[1]], separator)
    if any(dimension not in ("Time", "") for dimension in tags.get("X_Dimension", [])):
        raise _error(where, f"X_Dimension is {tags['X_Dimension']}, not Time", "save the record over time")
    body = [(number, line.split(separator)) for number, line in enumerate(lines[ends[1] + 1 :], ends[1] + 2) if line]
    names = [name.strip() for name in body.pop(0)[1]] if body else []
    least = len(names) - (names[-1:] == [_COMMENT])
    for number, row in body:
        if not least <= len(row) <= len(names):
            raise _error(
                f"{where}: line {number}",
                f"{len(row)} cells, the columns are {len(names)}",
                "see that the file is whole",
                code="ragged-row",
            )
    promised = max((int(count) for count in tags.get("Samples", []) if count.isdecimal()), default=0)
    if not body or len(body) < promised:
        raise _error(
            where,
            f"{len(body)} rows, the header promises {promised}",
            "copy the file again from where it was recorded",
            code="truncated-file" if body else "empty-file",
        )
    x_columns = (file_tags.get("X_Columns") or ["One"])[0]
    step = 2 if x_columns == "Multi" else 1
    units = [""] * len(names)
    clocks: list[Clock | None] = [None] * len(names)
    channels = range(1, least, step)
    # With times for each channel, LabVIEW writes the values of a tag above the readings: each second is blank.
    is_spaced = any(len(tags.get(tag, [])) > len(channels) for tag in ("Samples", "Y_Unit_Label"))
    for channel, column in enumerate(channels):
        units[column] = _nth(tags.get("Y_Unit_Label", []), column - 1 if is_spaced else channel)
    if x_columns == "No":
        is_absolute = file_tags.get("Time_Pref") == ["Absolute"]  # then X0 says it all
        clocks[1:least] = _clocks(tags, len(channels), where, is_absolute=is_absolute)
    return Columns(
        file=where,
        names=tuple(names),
        cells=tuple(zip(*([*row, *[""] * (len(names) - len(row))] for _, row in body), strict=True)),
        place=lambda row, _column: f"line {body[row][0]}",
        clocks=tuple(clocks),
        units=tuple(units),
        decimal=(file_tags.get("Decimal_Separator") or ["."])[0],
        times=tuple(column // 2 * 2 for column in range(len(names))) if x_columns == "Multi" else None,
    )


def _tags(lines: list[str], separator: str) -> dict[str, list[str]]:
    """The tags of a header; special blocks, which belong to other programs, are left out."""
    tags: dict[str, list[str]] = {}
    special = False
    for line in lines:
        tag, *values = line.split(separator)
        if tag in ("***Start_Special***", "***End_Special***"):
            special = tag == "***Start_Special***"
        elif not special:
            found = tags[tag.strip()] = [value.strip() for value in values]  # a blank is a channel that lacks it
            while found and not found[-1]:
                del found[-1]
    return tags


def _nth(values: list[str], number: int) -> str:
    return values[number] if number < len(values) else ""


def _clocks(tags: dict[str, list[str]], channels: int, where: str, *, is_absolute: bool) -> list[Clock]:
    """The clock of each channel, from the tags of its segment."""
    numbers = []
    for channel in range(channels):
        texts = (_nth(tags.get("X0", []), channel) or "0", _nth(tags.get("Delta_X", []), channel))
        try:
            numbers.append([float(text.replace(",", ".")) for text in texts])
        except ValueError as error:
            raise _error(
                where,
                f"X0 and Delta_X of channel {channel} are {texts}, not two numbers",
                "save the record with x values",
            ) from error
    starts, periods = zip(*numbers, strict=True) if numbers else ((), ())
    moments = [None] * channels if is_absolute else _moments(tags, channels, where)
    return clocks_from(starts, periods, moments)


def _moments(tags: dict[str, list[str]], channels: int, where: str) -> list[float | None]:
    """When each channel started [s]; None where its tag is blank or was never set, and where all say the same."""
    days, times = ([_nth(tags.get(tag, []), channel) for channel in range(channels)] for tag in ("Date", "Time"))
    if len({pair for pair in zip(days, times, strict=True) if pair[1]}) < 2:
        return [None] * channels
    is_dated = all(day for day, time in zip(days, times, strict=True) if time)
    # LabVIEW writes more decimals of a second than anything is distinguished by.
    times = [_DECIMALS.sub(".\\1", time) for time in times]
    cells = [time and f"{day} {time}" if is_dated else time for day, time in zip(days, times, strict=True)]
    try:
        read = read_dates(cells, "year-month-day" if is_dated else "time of day")
    except ValueError as error:
        channel = int(error.args[0])
        raise _error(
            where,
            f"Date and Time of channel {channel} are {cells[channel]!r}, not a date and a time of day",
            "save the record with x values",
        ) from error
    # A time stamp that was never set is LabVIEW's zero, in 1904.
    return [None if moment is None or moment < 0 else moment / 1e9 for moment in read]


def _error(where: str, message: str, repair: str, *, code: str = "damaged-file") -> InputError:
    return InputError(message, code=code, where=where, repair=repair)
