"""How deep and how wide the parts of a workbook are: looked at before its reader builds them in memory."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import Final
from xml.parsers import expat

from ipmclab.errors import InputError

_DEEPEST: Final = 64
"""Elements inside one another; a workbook has about ten."""

_MOST_AT_ONCE: Final = 500_000
"""Elements that a reader holds at once: those of a row of 16384 cells, or all of a part without rows."""

_FREED: Final = ("row", "si")
"""Elements that the reader of a sheet, and of its texts, forgets when they end."""


def refuse_nested(path: Path) -> None:
    """Refuse a workbook whose parts would fill the memory, however small its file is.

    Raises
    ------
    InputError
        Elements nested deeper, or more of them at once, than a table has.
    """
    try:
        with zipfile.ZipFile(path) as book:
            for part in book.infolist():
                if part.filename.lower().endswith((".xml", ".rels", ".vml")):
                    with book.open(part) as stream:
                        _Scan(path, part.filename).read(stream)
    except (zipfile.BadZipFile, zlib.error, expat.ExpatError, OSError, EOFError, NotImplementedError, RuntimeError):
        return  # what is damaged is reported by the reader


class _Scan:
    def __init__(self, path: Path, part: str) -> None:
        self._where = f"{path}: {part}"
        self._depth = 0
        self._held = 0

    def read(self, stream: object) -> None:
        parser = expat.ParserCreate()
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.ParseFile(stream)  # type: ignore[arg-type]  # what a zip gives can be read

    def _start(self, _name: str, _attributes: dict[str, str]) -> None:
        self._depth += 1
        self._held += 1
        if self._depth > _DEEPEST or self._held > _MOST_AT_ONCE:
            raise InputError(
                "its elements are nested deeper than those of a table"
                if self._depth > _DEEPEST
                else "it has more elements at once than a table can have",
                code="too-large",
                where=self._where,
                repair="save the table as .csv",
            )

    def _end(self, name: str) -> None:
        self._depth -= 1
        if name.rpartition(":")[2] in _FREED:
            self._held = 0
