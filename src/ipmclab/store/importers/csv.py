"""Records as text tables: separated by commas, semicolons, tabs, bars or blanks, also gzipped."""

from __future__ import annotations

import csv
import gzip
import io
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, get_args

from pydantic import Field

from ipmclab.errors import InputError
from ipmclab.store.importers.columns import Columns, open_error
from ipmclab.store.strict import Strict

if TYPE_CHECKING:
    from _csv import Reader


Encoding = Literal["utf-8", "utf-16", "cp1252", "cp1250", "latin-1", "cp850", "gbk", "shift_jis"]


class CsvFile(Strict):
    """How a text table is written.

    ``separator`` is between cells, ``decimal`` is the decimal mark; a blank as separator stands for any number
    of them. ``skip_lines`` lines come before the table; ``header`` says whether its first line names the columns,
    ``units_row`` whether the next one gives their units, and ``skip_rows`` how many more come before the numbers.
    Lines that start with ``comment`` are left out.
    """

    format: Literal["csv"]
    separator: Literal[",", ";", "\t", "|", " "] = ","
    decimal: Literal[".", ","] = "."
    skip_lines: Annotated[int, Field(ge=0)] = 0
    header: bool = True
    units_row: bool = False
    skip_rows: Annotated[int, Field(ge=0)] = 0
    comment: Literal["#", "%", "//"] | None = None
    encoding: Encoding = "utf-8"


def read_text(path: Path, encoding: str) -> str:
    """The text of a file, unpacked when it is gzipped."""
    content = path.read_bytes()
    if content[:2] == b"\x1f\x8b":
        try:
            content = gzip.decompress(content)
        except (OSError, EOFError, zlib.error) as error:
            raise open_error(path, error, "gzip") from error
    try:
        return content.decode("utf-8-sig" if encoding == "utf-8" else encoding)
    except UnicodeError as error:
        raise InputError(
            f"it is not text in {encoding}: {error}",
            code="bad-encoding",
            where=str(path),
            repair=f"give its encoding in the map ({', '.join(get_args(Encoding))})",
        ) from error


def split_rows(lines: Iterable[str], separator: str) -> Reader:
    """The cells of each line of a text; ``line_num`` of what this gives counts the lines."""
    if separator == " ":
        lines = (line.replace("\t", " ").strip() + "\n" for line in lines)
    # Blanks that follow a separator are no cell; where the separator is the blank, that makes any number of them one.
    return csv.reader(lines, delimiter=separator, strict=True, skipinitialspace=separator == " ")


def _is_blank(cells: list[str]) -> bool:
    return not any(cell.strip() for cell in cells)


def read(path: Path, options: CsvFile) -> Columns:
    """Read the cells of a text table.

    Raises
    ------
    InputError
        Not text, no rows, or a row with another number of cells.
    """
    text = io.StringIO(read_text(path, options.encoding), newline=None)
    # What is left out becomes a blank line, which the reader skips but counts: it may hold quotes of its own.
    table = (
        "\n" if number < options.skip_lines or (options.comment and line.startswith(options.comment)) else line
        for number, line in enumerate(text)
    )
    reader = split_rows(table, options.separator)
    rows: list[list[str]] = []
    lines: list[int] = []
    try:
        for cells in reader:
            # Below others, a row of blank cells is one of missing readings; a line without cells is none.
            if (rows and len(cells) > 1) or not _is_blank(cells):
                rows.append(cells)
                lines.append(reader.line_num)
    except csv.Error as error:
        raise open_error(f"{path}: line {reader.line_num}", error, "a text table") from error
    names = [name.strip() for name in rows.pop(0)] if options.header and rows else []
    units = [unit.strip(" ()[]") for unit in rows.pop(0)] if options.units_row and rows else None
    del rows[: options.skip_rows]
    while rows and _is_blank(rows[0]):
        del rows[0]
    lines = lines[len(lines) - len(rows) :]
    while rows and _is_blank(rows[-1]):
        del rows[-1], lines[-1]
    if not rows:
        raise InputError(
            "no rows of numbers in it",
            code="empty-file",
            where=str(path),
            repair="see that the record was saved, and header, skip_lines and comment in the map",
        )
    width = len(names or rows[0])
    for row in rows:
        while len(row) > width and not row[-1].strip():  # some loggers end each line with a separator
            del row[-1]
    for heading, given in (("units", units), *((f"line {line}", row) for line, row in zip(lines, rows, strict=True))):
        if given is not None and len(given) != width:
            raise InputError(
                f"{len(given)} cells, the lines before have {width}",
                code="ragged-row",
                where=f"{path}: {heading}",
                repair="see that the file is whole, and separator, header and skip_lines in the map",
            )
    return Columns(
        file=str(path),
        names=tuple(names) or ("",) * width,
        cells=tuple(zip(*rows, strict=True)),
        place=lambda row, _column: f"line {lines[row]}",
        units=tuple(units) if units is not None else None,
        decimal=options.decimal,
    )
