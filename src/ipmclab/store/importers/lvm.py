"""Records as LabVIEW measurement files (.lvm): a header for the file, one for its segment, then rows of text.

The tags are those of NI's "Specification for the LabVIEW Measurement File", version 2.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

from ipmclab.errors import InputError
from ipmclab.store.importers.columns import Clock, Columns
from ipmclab.store.importers.csv import read_text
from ipmclab.store.strict import Strict

_MAGIC: Final = "LabVIEW Measurement"
_END: Final = "***End_of_Header***"
_COMMENT: Final = "Comment"


class LvmFile(Strict):
    """A LabVIEW measurement file: it says itself how it is written.

    Its time is the column ``X_Value``; where it was saved without x values, its ``Delta_X``.
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
            clocks[column] = _clock(tags, channel, where)
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


def _clock(tags: dict[str, list[str]], channel: int, where: str) -> Clock:
    texts = (_nth(tags.get("X0", []), channel) or "0", _nth(tags.get("Delta_X", []), channel))
    try:
        start, period = (float(text.replace(",", ".")) for text in texts)
    except ValueError as error:
        raise _error(
            where, f"X0 and Delta_X of channel {channel} are {texts}, not two numbers", "save the record with x values"
        ) from error
    return Clock(start, period)


def _error(where: str, message: str, repair: str, *, code: str = "damaged-file") -> InputError:
    return InputError(message, code=code, where=where, repair=repair)
