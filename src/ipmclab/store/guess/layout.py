"""Where the table of numbers is in a file, and how it is written: separator, decimal mark, encoding, headings."""

from __future__ import annotations

import csv
import datetime
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from ipmclab.errors import InputError
from ipmclab.store.guess.headings import known_unit, read_heading
from ipmclab.store.importers.columns import is_missing
from ipmclab.store.importers.csv import read_text, split_rows
from ipmclab.store.importers.dates import is_date

_HEAD: Final = 1000
"""Lines that are looked at."""

_SEPARATORS: Final = ("\t", ";", "|", ",", " ")
_COMMENTS: Final = ("#", "%", "//")
_MOST_HEADINGS: Final = 5

_COMMA: Final = re.compile(r"[+-]?[0-9]*,[0-9]+(?:[eE][+-]?[0-9]+)?|[+-]?[0-9]+,")
_POINT: Final = re.compile(r"[+-]?[0-9]*\.[0-9]+(?:[eE][+-]?[0-9]+)?|[+-]?[0-9]+\.")
_WHOLE: Final = re.compile(r"[+-]?[0-9]+(?:[eE][+-]?[0-9]+)?")
_MAYBE_THOUSANDS: Final = re.compile(r"[+-]?[1-9][0-9]{0,2}[.,][0-9]{3}")
_GROUPED: Final = re.compile(r"[+-]?[0-9]{1,3}(?:[.,'’ \xa0\u202f][0-9]{3})+(?:[.,][0-9]+)?")


@dataclass(frozen=True)
class Layout:
    """How a table seems to be written.

    Parameters
    ----------
    file : mapping
        The ``[file]`` table of an import map.
    names : tuple of str, optional
        The headings, where the table cannot name them.
    open_decimal : bool
        The decimal mark may as well be a thousands mark.
    """

    file: dict[str, Any]
    names: tuple[str, ...] | None = None
    open_decimal: bool = False


@dataclass(frozen=True)
class _Region:
    """The rows of numbers among the rows of a file: where they begin, how many, and the row that names the columns."""

    first: int
    count: int
    width: int
    rows: list[list[Any]] = field(repr=False)
    header: int | None = None
    has_units: bool = False
    recognised: int = 0

    @property
    def rank(self) -> tuple[int, ...]:
        """The most rows, then those that have a heading for each column, then the widest."""
        return (self.count, int(self.header is not None), self.recognised, self.width)

    def describe(self, numbers: Sequence[int]) -> dict[str, Any]:
        """The keys of ``[file]`` for it; ``numbers`` are the lines of the rows, counted from 0."""
        begin = self.first if self.header is None else self.header
        after = 0 if self.header is None else self.first - self.header - 1 - self.has_units
        layout = {
            "skip_lines": numbers[begin],
            "header": self.header is not None,
            "units_row": self.has_units,
            "skip_rows": after,
        }
        usual = {"skip_lines": 0, "header": True, "units_row": False, "skip_rows": 0}
        return {key: value for key, value in layout.items() if value != usual[key]}


def text_layout(path: Path) -> Layout:
    """How a text table seems to be written.

    Raises
    ------
    InputError
        No text, or no table of numbers in it.
    """
    best: tuple[tuple[int, ...], Layout] | None = None
    for encoding in _encodings(path):
        lines = read_text(path, encoding).splitlines()[: 10 * _HEAD]
        rank, layout = _of_lines(lines, path)
        if encoding != "utf-8":
            layout.file["encoding"] = encoding
        if best is None or rank > best[0]:
            best = rank, layout
    assert best is not None
    return best[1]


def _encodings(path: Path) -> list[str]:
    """The encodings in which the file is text, the surest first."""
    found = []
    for encoding in ("utf-8", "utf-16", "cp1252", "cp1250", "gbk", "shift_jis", "cp850", "latin-1"):
        try:
            text = read_text(path, encoding)
        except InputError as error:
            if error.code != "bad-encoding":
                raise
            continue
        if "\0" in text[:2000] or (encoding == "utf-16" and not _is_utf_16(path)):
            continue
        found.append(encoding)
        if encoding in ("utf-8", "utf-16"):
            return found
    if not found or not any(character.isprintable() for character in read_text(path, found[0])[:100]):
        raise InputError(
            "this is no text, and its first bytes do not say what it is",
            code="unknown-format",
            where=str(path),
            repair="write a map that describes it: docs/files.md, Import maps",
        )
    return found


def _is_utf_16(path: Path) -> bool:
    with path.open("rb") as stream:
        return stream.read(2) in (b"\xff\xfe", b"\xfe\xff")


def _of_lines(lines: list[str], path: Path) -> tuple[tuple[int, ...], Layout]:
    numbers = [number for number, line in enumerate(lines) if line.strip()][:_HEAD]
    best: tuple[tuple[int, ...], str, _Region] | None = None
    looked_at: list[list[list[str]]] = []
    for separator in _SEPARATORS:
        rows = [_split(lines[number], separator) for number in numbers]
        if rows in looked_at:  # such as whole lines, where two separators do not occur
            continue
        looked_at.append(rows)
        region = find_region(rows)
        if region is not None and (best is None or region.rank > best[0]):
            best = region.rank, separator, region
    if best is None:
        raise InputError(
            "no table of numbers in it",
            code="no-table",
            where=str(path),
            repair="write a map that describes it: docs/files.md, Import maps",
        )
    rank, separator, region = best
    begin = region.first if region.header is None else region.header
    names = None
    file: dict[str, Any] = {"format": "csv", "separator": separator}
    if separator == " " and region.header is None and region.first:
        # Headings of two words ("time (s)") are more cells than columns.
        separate = re.findall(r"[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?", lines[numbers[region.first - 1]].lstrip("#% "))
        names = tuple(separate) if len(separate) == region.width else None
    cells = [str(cell).strip() for row in region.rows for cell in row]
    commas = [cell for cell in cells if _COMMA.fullmatch(cell)]
    points = [cell for cell in cells if _POINT.fullmatch(cell)]
    marked = commas or points
    # "1,234" is a number above one with a decimal comma, or above one thousand with a thousands mark.
    is_open = bool(marked) and all(_MAYBE_THOUSANDS.fullmatch(cell) for cell in marked) and separator != ","
    if commas and not (points and len(points) > len(commas)):
        file["decimal"] = ","
    file |= region.describe(numbers)
    mark = next((mark for line in lines[numbers[begin] + 1 :] for mark in _COMMENTS if line.startswith(mark)), None)
    if mark is not None:
        file["comment"] = mark
    return rank, Layout(file, names, open_decimal=is_open)


def _split(line: str, separator: str) -> list[str]:
    try:
        return next(iter(split_rows(io.StringIO(line), separator)), [])
    except csv.Error:  # a quote that does not end, in what comes before the table
        return [line]


def sheet_layout(rows: Sequence[Sequence[Any]]) -> dict[str, Any] | None:
    """The keys of ``[file]`` for a sheet of a workbook; None where it has no table of numbers."""
    head = [list(row) for row in rows[:_HEAD]]
    width = max((len(row) for row in head), default=0)
    region = find_region([[*row, *[None] * (width - len(row))] for row in head])
    return None if region is None else region.describe(range(len(head)))


def find_region(rows: list[list[Any]]) -> _Region | None:
    """The longest run of rows of numbers that are as wide, and the row above that names them."""
    best: tuple[int, int] | None = None
    start = None
    for place in range(len(rows) + 1):
        joins = place < len(rows) and _is_data(rows[place])
        if start is not None and (not joins or len(rows[place]) != len(rows[start])):
            if best is None or place - start > best[1] - best[0]:
                best = start, place
            start = None
        if joins and start is None:
            start = place
    if best is None:
        return None
    first, stop = best
    width = len(rows[first])
    while width > 1 and all(is_blank(row[width - 1]) for row in rows[first:stop]):
        width -= 1  # lines that end with a separator
    region = _Region(first, stop - first, width, rows[first:stop])
    return _named(region, rows)


def _named(region: _Region, rows: list[list[Any]]) -> _Region:
    """The region with the row that names its columns, among the rows above it."""
    best: tuple[int, int, bool, int] | None = None
    for place in range(region.first - 1, max(region.first - 1 - _MOST_HEADINGS, -1), -1):
        row = rows[place]
        full = row[: region.width]
        if len(full) < region.width or any(not is_blank(cell) for cell in row[region.width :]):
            break
        if sum(not is_blank(cell) for cell in full) * 2 < region.width or (_is_units(full) and place > 0):
            continue
        has_units = place + 1 < region.first and _is_units(rows[place + 1][: region.width])
        headings = [read_heading(str(cell or "")) for cell in full]
        recognised = sum(bool(heading.channels) + bool(heading.unit) for heading in headings)
        if best is None or recognised > best[0]:
            best = recognised, place, has_units, region.width
    above = rows[region.first - 1][: region.width] if region.first else []
    if best is None and len(above) == region.width and _is_units(above):
        best = len(above), region.first - 1, False, region.width  # units alone say what the columns are
    if best is None:
        return region
    recognised, place, has_units, width = best
    return _Region(region.first, region.count, width, region.rows, place, has_units, recognised)


def _is_units(row: Sequence[Any]) -> bool:
    texts = [str(cell or "").strip() for cell in row]
    units = [known_unit(text) for text in texts]
    others = [text for text, unit in zip(texts, units, strict=True) if text.strip("-[]() ") and not unit]
    bracketed = all(text.startswith(("[", "(")) for text in others)
    return (
        any(units)
        and (len(others) * 2 < len([text for text in texts if text]) or bracketed)
        and not (sum(bool(read_heading(text).channels) for text in texts) > sum(map(bool, units)))
    )


def is_blank(cell: Any) -> bool:
    """Whether a cell is empty."""
    return cell is None or (isinstance(cell, str) and not cell.strip())


def _is_data(row: Sequence[Any]) -> bool:
    values = texts = 0
    for cell in row:
        if is_blank(cell):
            continue
        if _is_value(cell):
            values += 1
        elif (text := str(cell)) and any(map(str.isdigit, text)) and not any(map(str.isalpha, text)):
            return False  # numbers with another separator between them
        else:
            texts += 1
    return values > 0 and values >= texts


def _is_value(cell: Any) -> bool:
    if isinstance(cell, int | float | datetime.datetime | datetime.time | datetime.timedelta):
        return True
    text = str(cell).strip()
    number = any(kind.fullmatch(text) for kind in (_WHOLE, _POINT, _COMMA, _GROUPED))
    return (
        number
        or (is_missing(text) and any(map(str.isalpha, text)))
        or (any(letter.isdigit() for letter in text) and is_date(text))
    )
