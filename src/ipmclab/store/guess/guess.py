"""A foreign record becomes an import map: what can be found is taken and said, what cannot be known is asked."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from pydantic import TypeAdapter

from ipmclab.errors import InputError
from ipmclab.kinds import tell_kinds
from ipmclab.store.guess.channel_columns import find_channel, pair_indices
from ipmclab.store.guess.headings import read_heading
from ipmclab.store.guess.inquiry import Column, Inquiry
from ipmclab.store.guess.layout import sheet_layout, text_layout
from ipmclab.store.guess.question import Guess, Question
from ipmclab.store.guess.readings import Readings
from ipmclab.store.guess.time_column import find_time
from ipmclab.store.import_map import MAPPED
from ipmclab.store.importers import File, format_of_start, read_columns
from ipmclab.store.importers.columns import Columns
from ipmclab.store.importers.xlsx import XlsxFile, columns_of, read_sheets
from ipmclab.store.importing import check_source

_ASKED_CHANNELS: Final = tuple(name for name in MAPPED if name not in ("time", "applied_voltage"))


@tell_kinds
def guess_map(path: str | os.PathLike[str], answers: Mapping[str, str] | None = None) -> Guess:
    """What a foreign record seems to be.

    Parameters
    ----------
    path : str or path
    answers : mapping of str to str, optional
        To questions that an earlier guess asked, by their keys.

    Raises
    ------
    InputError
        No such file, one of a kind that no importer reads, or without a table of numbers.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "record.csv"
    ...     _ = file.write_text("Zeit [s];Spannung [V];Strom\\n0,00;0,0;0\\n0,02;1,0;60\\n")
    ...     guess = guess_map(file)
    ...     whole = guess_map(file, {"channels.current.unit": "mA"})
    >>> [question.key for question in guess.questions]
    ['channels.current.unit']
    >>> whole.map.channels["current"].unit
    'mA'
    """
    return _guess(Inquiry(Path(path), dict(answers or {})))


def guess_file(path: Path) -> dict[str, Any]:
    """How a file seems to be written: the ``[file]`` table of an import map."""
    return _find_file(Inquiry(path, {}))[0]


def guess_channels(path: Path, file: dict[str, Any], columns: Columns) -> list[str | None]:
    """What each column seems to be; None where that is not known."""
    inquiry = Inquiry(path, {})
    with contextlib.suppress(InputError):  # none can be the voltage: what was found before stays
        _read_columns(inquiry, file, columns, None)
    found = inquiry.table["channels"]
    return [next((name for name, keys in found.items() if keys["column"] == one.name), None) for one in inquiry.all]


def _guess(inquiry: Inquiry) -> Guess:
    check_source(inquiry.path)
    file, names = _find_file(inquiry)
    if inquiry.questions and inquiry.questions[-1].key.startswith("file."):
        return Guess({"file": file}, tuple(inquiry.taken), (), tuple(inquiry.questions))
    _read_columns(inquiry, file, _read(inquiry, file), names)
    spare = [column for column in inquiry.all if column.place not in inquiry.used]
    left_out = [f"left out: column {inquiry.label(column)}" for column in spare if not column.is_blank]
    unused = tuple(key for key in inquiry.answers if key not in inquiry.asked)
    return Guess(inquiry.table, tuple(inquiry.taken), tuple(left_out), tuple(inquiry.questions), unused)


def _read_columns(inquiry: Inquiry, file: dict[str, Any], columns: Columns, names: tuple[str, ...] | None) -> None:
    """Find what each column is; ``names`` are its headings where the table cannot name them."""
    inquiry.columns = columns if names is None else replace(columns, names=names)
    inquiry.table = {"file": file, "channels": {}}
    inquiry.all = [_column(inquiry, place, by_place=names is not None) for place in range(len(columns.cells))]
    inquiry.used = {column.place for column in inquiry.all if column.heading.is_row}
    find_time(inquiry)
    for channel in _ASKED_CHANNELS:
        find_channel(inquiry, channel)
    pair_indices(inquiry)


def _column(inquiry: Inquiry, place: int, *, by_place: bool) -> Column:
    name = inquiry.columns.names[place]
    below = inquiry.columns.units[place] if inquiry.columns.units else None
    said = name.partition("/")[2] if inquiry.table["file"]["format"] == "tdms" else name  # without its group
    heading = read_heading(said, below)
    unique = bool(name) and inquiry.columns.names.count(name) == 1 and not by_place
    return Column(place, name if unique else place, heading, Readings.of(inquiry.columns, place))


def _find_file(inquiry: Inquiry) -> tuple[dict[str, Any], tuple[str, ...] | None]:
    with inquiry.path.open("rb") as stream:
        kind = format_of_start(stream.read(32), str(inquiry.path))
    if kind == "xlsx":
        return _sheet(inquiry), None
    if kind:
        return {"format": kind}, None
    layout = text_layout(inquiry.path)
    file = layout.file
    if layout.open_decimal:
        shown = "a decimal comma" if file.get("decimal") == "," else "a decimal point"
        answer = inquiry.ask(
            Question(
                "file.decimal",
                f"the numbers may have {shown} or thousands marks: which mark is the decimal one?",
                (".", ","),
            )
        )
        if answer:
            file = {key: value for key, value in file.items() if key != "decimal"}
            file |= {"decimal": ","} if answer == "," else {}
    marks = {"\t": "tabs", " ": "blanks"}
    inquiry.take(
        f"text table: columns separated by {marks.get(file['separator'], repr(file['separator']))}, "
        f"decimal {'comma' if file.get('decimal') == ',' else 'point'}, {file.get('encoding', 'utf-8')}"
        + (f", after {file['skip_lines']} lines" if file.get("skip_lines") else "")
    )
    return file, layout.names


def _sheet(inquiry: Inquiry) -> dict[str, Any]:
    inquiry.sheets = read_sheets(inquiry.path)
    found = {name: layout for name, rows in inquiry.sheets.items() if (layout := sheet_layout(rows)) is not None}
    if not found:
        raise InputError(
            "no sheet has a table of numbers", code="no-table", where=str(inquiry.path), repair="see what was saved"
        )
    sheet = next(iter(found))
    if len(found) > 1:
        sheet = inquiry.ask(Question("file.sheet", "which sheet holds the record?", tuple(found))) or sheet
    named = {} if sheet == next(iter(inquiry.sheets)) else {"sheet": sheet}
    inquiry.take(f"workbook: sheet {sheet!r}")
    return {"format": "xlsx", **named, **found[sheet]}


def _read(inquiry: Inquiry, file: dict[str, Any]) -> Columns:
    options = TypeAdapter[Any](File).validate_python(file)
    if isinstance(options, XlsxFile):
        return columns_of(inquiry.sheets, options, str(inquiry.path))
    return read_columns(inquiry.path, options)
