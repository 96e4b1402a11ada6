"""Records as Excel workbooks, for example with a pair of (row number, value) columns for each channel."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field

from ipmclab.errors import InputError
from ipmclab.store.importers.columns import Columns, open_error
from ipmclab.store.importers.nesting import refuse_nested
from ipmclab.store.strict import Strict

_MOST_CELLS: Final = 2**24
"""Of a sheet: all the rows that it can have, with 16 columns."""


class XlsxFile(Strict):
    """How a workbook is laid out.

    ``sheet`` is its name, the first sheet when left out; ``skip_lines``, ``header``, ``units_row``, ``skip_rows`` and,
    for numbers that are texts, ``decimal`` as for a text table.
    """

    format: Literal["xlsx"]
    sheet: str | None = None
    decimal: Literal[".", ","] = "."
    skip_lines: Annotated[int, Field(ge=0)] = 0
    header: bool = True
    units_row: bool = False
    skip_rows: Annotated[int, Field(ge=0)] = 0


def read_sheets(path: Path) -> dict[str, list[tuple[Any, ...]]]:
    """The cells of every sheet, row by row.

    Raises
    ------
    InputError
        The file is not a workbook, a sheet is too wide for its rows, or its parts are nested too deep.
    """
    import openpyxl

    refuse_nested(path)
    try:
        # The file is opened here: openpyxl leaves one that it cannot read open, and nobody could replace it on Windows.
        with path.open("rb") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about styles and validation that openpyxl leaves out
            book = openpyxl.load_workbook(file, read_only=True, data_only=True)
            sheets: dict[str, list[tuple[Any, ...]]] = {}
            for sheet in book.worksheets:
                sheet.reset_dimensions()  # some programs write a wrong size
                rows = sheets.setdefault(str(sheet.title), [])
                width = 1
                for row in sheet.iter_rows(values_only=True):
                    rows.append(row)
                    width = max(width, len(row))
                    _refuse_wide(width * len(rows), path)
            return sheets
    except InputError:
        raise
    except Exception as error:  # a damaged workbook raises whatever its zip and XML parsers raise
        raise open_error(path, error, "an Excel workbook (.xlsx)") from error


def _refuse_wide(cells: int, path: Path) -> None:
    """Refuse what would fill the memory: a cell far to the right makes every row as wide, however small the file is."""
    if cells > _MOST_CELLS:
        raise InputError(
            f"its rows and columns make more than {_MOST_CELLS} cells",
            code="too-large",
            where=str(path),
            repair="delete what is far to the right or below of the table, or save the table as .csv",
        )


def read(path: Path, options: XlsxFile) -> Columns:
    """Read the cells of one sheet.

    Raises
    ------
    InputError
        Not a workbook, no such sheet, or no rows in it.
    """
    return columns_of(read_sheets(path), options, str(path))


def columns_of(sheets: dict[str, list[tuple[Any, ...]]], options: XlsxFile, where: str) -> Columns:
    """The columns of one sheet."""
    if options.sheet is not None and options.sheet not in sheets:
        raise InputError(
            f"no sheet {options.sheet!r}",
            code="unknown-sheet",
            where=where,
            repair="its sheets: " + ", ".join(repr(name) for name in sheets),
        )
    sheet = options.sheet if options.sheet is not None else next(iter(sheets), "")
    rows = sheets.get(sheet, [])[options.skip_lines :]
    names = list(rows.pop(0)) if options.header and rows else []
    units = list(rows.pop(0)) if options.units_row and rows else []
    del rows[: options.skip_rows]
    while rows and all(cell is None for cell in rows[-1]):
        rows.pop()
    if not rows:
        raise InputError(
            f"no rows of numbers in sheet {sheet!r}",
            code="empty-file",
            where=where,
            repair="see that the record was saved, and sheet, header and skip_lines in the map",
        )
    width = max(len(row) for row in [names, *rows])
    first = 1 + options.skip_lines + options.header + options.units_row + options.skip_rows
    return Columns(
        file=where,
        names=tuple(str(name).strip() if name is not None else "" for name in _pad(names, width)),
        cells=tuple(zip(*(_pad(row, width) for row in rows), strict=True)),
        place=lambda row, column: f"sheet {sheet!r}, cell {_letters(column)}{first + row}",
        units=tuple(str(unit or "").strip(" ()[]") for unit in _pad(units, width)) if options.units_row else None,
        decimal=options.decimal,
    )


def _pad(row: list[Any] | tuple[Any, ...], width: int) -> list[Any]:
    return [*row, *[None] * (width - len(row))]


def _letters(column: int) -> str:
    from openpyxl.utils import get_column_letter

    return str(get_column_letter(column + 1))
