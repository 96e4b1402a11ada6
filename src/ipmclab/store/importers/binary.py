"""Records as bare float64 numbers, row after row, as MATLAB's ``fwrite(file, data, 'double')`` leaves them.

The layout is that of Friend's data acquisition script (appendix A.2): ``fread(file, [4, inf], 'double')``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ipmclab.errors import InputError
from ipmclab.store.importers.columns import Columns
from ipmclab.store.strict import Strict


class BinaryFile(Strict):
    """How a bare binary file is laid out: the names of the numbers of one row, in order."""

    format: Literal["binary"]
    columns: Annotated[tuple[str, ...], Field(strict=False, min_length=1)]
    byte_order: Literal["little", "big"] = "little"


def read(path: Path, options: BinaryFile) -> Columns:
    """Read the columns of a bare binary file.

    Raises
    ------
    InputError
        The file does not end with a whole row.
    """
    content = path.read_bytes()
    row_bytes = 8 * len(options.columns)
    whole, rest = divmod(len(content), row_bytes)
    if rest:
        raise InputError(
            f"{len(content)} bytes are {whole} rows of {row_bytes} bytes and {rest} bytes more",
            code="truncated-file",
            where=str(path),
            repair="copy the file again, or see that the map names every column of a row",
        )
    table = np.frombuffer(content, dtype="<f8" if options.byte_order == "little" else ">f8").reshape(whole, -1)
    return Columns(
        file=str(path),
        names=options.columns,
        cells=tuple(table.T),
        place=lambda row, _column: f"row {row}",
    )
