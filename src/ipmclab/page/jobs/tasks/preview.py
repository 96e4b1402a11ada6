"""The first rows of a foreign record, and what its columns seem to be."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ipmclab.page.jobs.frames import Frame
from ipmclab.page.jobs.tasks.room import refuse_large_here

if TYPE_CHECKING:
    from ipmclab.page.jobs.tasks import Progress

_SHOWN: Final = 12


def run(arguments: dict[str, Any], progress: Progress) -> Frame:
    """Read the file ``path`` as the table ``file`` of an import map says, or as it seems to be.

    The document has the layout that was used, the names, the first rows as text, and for each column what it seems to
    be.

    Raises
    ------
    InputError
        It cannot be read so, or holds too much.
    """
    from pydantic import TypeAdapter, ValidationError

    from ipmclab.store.guess.guess import guess_channels, guess_file
    from ipmclab.store.importers import File, read_columns
    from ipmclab.store.strict import as_input_error

    progress("reading the file")
    path = Path(arguments["path"])
    refuse_large_here(path)
    layout = arguments.get("file") or guess_file(path)
    try:
        file = TypeAdapter(File).validate_python(layout)
    except ValidationError as error:
        raise as_input_error(error, layout, where="file.") from error
    columns = read_columns(path, file)
    count = max(len(cells) for cells in columns.cells)
    rows = [[_cell(cells, row) for cells in columns.cells] for row in range(min(_SHOWN, count))]
    document = {
        "file": layout,
        "names": list(columns.names),
        "rows": rows,
        "count": count,
        "guesses": guess_channels(path, layout, columns),
    }
    return Frame(document, {})


def _cell(cells: Any, row: int) -> str:
    if row >= len(cells):
        return ""
    value = cells[row]
    if isinstance(value, float | np.floating):
        return f"{value:.8g}"
    return "" if value is None else str(value)[:40]
