"""Which format a file name selects."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Final

from ipmclab.errors import InputError
from ipmclab.store.exports import csv, mat, xlsx

_FORMATS: Final = {".csv": csv, ".xlsx": xlsx, ".mat": mat}


def format_of(path: Path) -> ModuleType:
    """The export format that a file name selects by its ending.

    Raises
    ------
    InputError
        Another ending than .csv, .xlsx or .mat.
    """
    found = _FORMATS.get(path.suffix.lower())
    if found is None:
        raise InputError(
            f"the ending {path.suffix!r} is not one of {', '.join(_FORMATS)}",
            code="bad-ending",
            where=str(path),
            repair="give one of these endings",
        )
    return found
