"""CSV files that people write: the cells of their lines, and what a heading says."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any, Final, NamedTuple

from ipmclab.errors import InputError
from ipmclab.toml_file import read_text

_HEADING: Final = re.compile(r"\s*(.*?)\s*(?:[(\[]\s*(.*?)\s*[)\]])?\s*")


class Line(NamedTuple):
    """A line with its number in the file, from 1."""

    number: int
    text: str
    cells: list[str]


def read_lines(path: Path, *, missing: InputError) -> list[Line]:
    """The lines of a file, without those that are empty or start with ``#``.

    Cells are separated by semicolons or tabs where the first line has one, else by commas; they may be in quotes.
    Blank ones at the end of a line are no cells: spreadsheets fill lines up with them.

    Parameters
    ----------
    path : Path
    missing : InputError
        What is said where there is no such file.

    Raises
    ------
    InputError
        No such file, a folder, no text, or a quote that does not end.
    """
    text = read_text(path, kind="a table", missing=missing, repair="save it as CSV in UTF-8")
    numbered = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and line.lstrip()[0] != "#"]
    delimiter = next((mark for mark in (";", "\t") if numbered and mark in numbered[0][1]), ",")
    lines = [Line(k, line, _split(line, delimiter, where=f"{path}, line {k}")) for k, line in numbered]
    return [line for line in lines if line.cells]


def split_heading(cell: str) -> tuple[str, str]:
    """The name of a column, and its unit in brackets; an empty text where it has none.

    Examples
    --------
    >>> split_heading("time (ms)"), split_heading("beam.modulus[GPa]"), split_heading("voltage")
    (('time', 'ms'), ('beam.modulus', 'GPa'), ('voltage', ''))
    """
    match: Any = _HEADING.fullmatch(" ".join(cell.split()))
    return match[1], match[2] or ""


def _split(line: str, delimiter: str, *, where: str) -> list[str]:
    try:
        cells = next(csv.reader([line], delimiter=delimiter, strict=True, skipinitialspace=True))
    except csv.Error as error:
        raise InputError(
            f"it cannot be read as cells: {error}", code="bad-columns", where=where, repair="correct this line"
        ) from error
    while cells and not cells[-1].strip():
        cells.pop()
    return cells
