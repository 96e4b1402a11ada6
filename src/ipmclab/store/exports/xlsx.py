"""A run as an Excel workbook: the table on one sheet, the metadata on another."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from typing import Any, Final

import numpy as np

from ipmclab.errors import InputError
from ipmclab.run import Run
from ipmclab.store.document import flat_attributes
from ipmclab.store.exports.table import heading, notes_of, run_of_table
from ipmclab.store.importers.xlsx import XlsxFile, columns_of, read_sheets

_MAX_ROWS: Final = 1_048_576 - 1  # of a sheet, less the heading
_MAX_TEXT: Final = 32_000  # a cell holds 32,767 characters
_NOT_IN_XML: Final = re.compile(r"[^\t\n -\uD7FF\uE000-\uFFFD\U00010000-\U0010FFFF]")


def write(run: Run, document: str, path: Path) -> None:
    """Write the workbook; a missing reading is an empty cell.

    Raises
    ------
    InputError
        More rows than a sheet holds.
    """
    arrays = run.arrays
    longest = max(len(values) for values in arrays.values())
    if longest > _MAX_ROWS:
        raise InputError(
            f"{longest} rows, a sheet holds {_MAX_ROWS}",
            code="too-long",
            where=str(path),
            repair="export to .csv or .mat, or a part of the run",
        )
    import openpyxl
    from openpyxl.cell import WriteOnlyCell

    book = openpyxl.Workbook(write_only=True)
    table = book.create_sheet("run")
    table.append([heading(name) for name in arrays])

    def cell(value: float) -> Any:
        # openpyxl writes 16 digits of a number; as text marked "number" all 17 arrive.
        exact = WriteOnlyCell(table, value=repr(value))
        exact.data_type = "n"
        return exact

    columns = [
        [None if value != value else cell(value) for value in values.tolist()]
        if values.dtype == np.float64
        else values.tolist()
        for values in arrays.values()
    ]
    for row in itertools.zip_longest(*columns):
        table.append(row)
    notes = book.create_sheet("metadata")
    for name, text in flat_attributes(run).items():
        notes.append(
            [name, "'" * text.startswith("=") + _NOT_IN_XML.sub("\N{REPLACEMENT CHARACTER}", text)[:_MAX_TEXT]]
        )
    for note in notes_of(run).items():
        notes.append(note)
    for start in range(0, len(document), _MAX_TEXT):
        piece = WriteOnlyCell(notes, value=document[start : start + _MAX_TEXT])
        piece.data_type = "s"  # one that begins with "=" is no formula
        notes.append(["metadata_json", piece])
    book.save(path)


def read_back(path: Path) -> Run | None:
    """The run of our own export; None for another workbook."""
    sheets = read_sheets(path)
    pieces = [str(row[1]) for row in sheets.get("metadata", []) if len(row) > 1 and row[0] == "metadata_json"]
    if not pieces or "run" not in sheets:
        return None
    return run_of_table("".join(pieces), columns_of(sheets, XlsxFile(format="xlsx", sheet="run"), str(path)))
