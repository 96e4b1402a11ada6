"""The first rows of a foreign record, and what its columns seem to be."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ipmclab.errors import InputError
from ipmclab.page.jobs.frames import Frame
from ipmclab.page.jobs.tasks.unpacked import refuse_large
from ipmclab.page.wire import FloatArray

if TYPE_CHECKING:
    from ipmclab.page.jobs.tasks import Progress
    from ipmclab.store.importers.columns import Columns

_SHOWN: Final = 12
_POINTS: Final = 400
_HEAD: Final = 200  # lines from which the layout of a text is guessed

_WORDS: Final[dict[str, tuple[str, ...]]] = {
    "time": ("time", "zeit", "seconds", "t"),
    "voltage": ("voltage", "volt", "spannung", "u", "v"),
    "current": ("current", "strom", "amp", "i"),
    "displacement": ("displacement", "laser", "weg", "deflection", "tip", "delta", "position"),
    "force": ("force", "kraft", "load", "f"),
    "temperature": ("temperature", "temp"),
    "relative_humidity": ("humidity", "feuchte", "rh"),
}
"""Words of headings, in lower case; one letter must stand alone."""


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Read the file ``path`` as the table ``file`` of an import map says, or as it seems to be.

    The document has the layout that was used, the names, the first rows as text, and for each column what it seems to
    be; arrays ``0``, ``1`` ... hold up to some hundred numbers of each column that has numbers.

    Raises
    ------
    InputError
        It cannot be read so, or holds too much.
    """
    from pydantic import TypeAdapter, ValidationError

    from ipmclab.store.importers import File, read_columns
    from ipmclab.store.strict import as_input_error

    progress("reading the file")
    path = Path(arguments["path"])
    refuse_large(path)
    layout = arguments.get("file") or guess_layout(path)
    try:
        file = TypeAdapter(File).validate_python(layout)
    except ValidationError as error:
        raise as_input_error(error, layout, where="file.") from error
    columns = read_columns(path, file)
    arrays: dict[str, FloatArray] = {}
    for place in range(len(columns.cells)):
        numbers = _numbers(columns, place)
        if numbers is not None and len(numbers):
            arrays[str(place)] = numbers[np.unique(np.linspace(0, len(numbers) - 1, _POINTS).astype(int))]
    count = max(len(cells) for cells in columns.cells)
    rows = [[_cell(cells, row) for cells in columns.cells] for row in range(min(_SHOWN, count))]
    document = {
        "file": layout,
        "names": list(columns.names),
        "units": list(columns.units) if columns.units else None,
        "rows": rows,
        "count": count,
        "has_clock": bool(columns.clocks and any(columns.clocks)),
        "guesses": guess_channels(columns.names, numeric=[str(place) in arrays for place in range(len(columns.names))]),
    }
    return Frame(document, arrays)


def guess_layout(path: Path) -> dict[str, Any]:
    """How a file seems to be written, by its ending and its first lines.

    Raises
    ------
    InputError
        A binary file that only its user can describe.
    """
    suffixes = [suffix.lower() for suffix in path.suffixes]
    for suffix, kind in ((".xlsx", "xlsx"), (".mat", "mat"), (".tdms", "tdms"), (".lvm", "lvm")):
        if suffixes and suffixes[-1] == suffix:
            return {"format": kind}
    from ipmclab.store.importers.csv import read_text

    try:
        text = read_text(path, "utf-8")
        encoding = "utf-8"
    except InputError:
        text, encoding = read_text(path, "latin-1"), "latin-1"
    if "\0" in text[:1000]:
        raise InputError(
            "this is no text, and its ending does not say what it is",
            code="unknown-format",
            where=path.name,
            repair="import it with ipmclab import and a map that describes it: docs, Import maps",
        )
    numbered = list(enumerate(text.splitlines()[:_HEAD]))
    comment = next((mark for mark in ("#", "%", "//") if text.startswith(mark)), None)
    numbered = [(at, line) for at, line in numbered if line.strip() and not (comment and line.startswith(comment))]
    lines = [line for _, line in numbered]
    separator = max(";\t,", key=lambda mark: _regular(lines, mark))
    table = list(csv.reader(lines, delimiter=separator))
    width = len(table[-1]) if table else 0
    first = next((at for at, row in enumerate(table) if len(row) == width), 0)
    # A comment is left out by its mark; what else stands before the table is counted.
    skip = numbered[first][0] if first else 0
    rows = table[first:]
    last = " ".join(rows[-1]) if rows else ""
    layout: dict[str, Any] = {"format": "csv", "separator": separator}
    if separator != "," and re.search(r"\d,\d", last):
        layout["decimal"] = ","
    if skip:
        layout["skip_lines"] = skip
    if rows and all(_is_number(cell) for cell in rows[0]):
        layout["header"] = False
    elif len(rows) > 1 and not any(_is_number(cell) for cell in rows[1]) and any(cell.strip() for cell in rows[1]):
        layout["units_row"] = True
    if comment:
        layout["comment"] = comment
    if encoding != "utf-8":
        layout["encoding"] = encoding
    return layout


def guess_channels(names: tuple[str, ...], *, numeric: list[bool]) -> list[str | None]:
    """What each column seems to be, by its heading; each channel once, None where nothing is known.

    Examples
    --------
    >>> guess_channels(("sample_index", "current_A", "voltage_V", "laser_mm"), numeric=[True] * 4)
    [None, 'current', 'voltage', 'displacement']
    """
    found: list[str | None] = [None] * len(names)
    for long in (True, False):  # a whole word says more than a letter
        for place, name in enumerate(names):
            if found[place] is not None or not numeric[place]:
                continue
            words = re.findall(r"[a-z]+", re.split(r"[\[(/]", name.lower())[0])
            words = words if len(words) < 2 else [word for word in words if len(word) > 1]
            for channel, known in _WORDS.items():
                if channel in found:
                    continue
                fits = any(
                    (len(one) > 2 and any(word.startswith(one) for word in words)) if long else one in words
                    for one in known
                )
                if fits:
                    found[place] = channel
                    break
    return found


def _regular(lines: list[str], mark: str) -> tuple[int, int]:
    counts = [line.count(mark) for line in lines[-20:]]
    same = bool(counts) and min(counts) == max(counts) and counts[0] > 0
    return (int(same), counts[-1] if counts else 0)


def _is_number(text: str) -> bool:
    try:
        float(text.strip().replace(",", "."))
    except ValueError:
        return False
    return True


def _numbers(columns: Columns, place: int) -> FloatArray | None:
    try:
        return columns.numbers(place)
    except InputError:
        return None


def _cell(cells: Any, row: int) -> str:
    if row >= len(cells):
        return ""
    value = cells[row]
    if isinstance(value, float | np.floating):
        return f"{value:.8g}"
    return "" if value is None else str(value)[:40]
