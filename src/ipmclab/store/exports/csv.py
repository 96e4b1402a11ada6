"""A run as a text table: comment lines, a heading with units, then rows separated by commas."""

from __future__ import annotations

import csv
import itertools
from pathlib import Path

import numpy as np

from ipmclab.run import Run
from ipmclab.store.document import FORMAT, flat_attributes
from ipmclab.store.exports.table import heading, notes_of, run_of_table
from ipmclab.store.importers.csv import CsvFile, read, read_text

_TITLE = f"# {FORMAT}"
_DOCUMENT = "# metadata_json: "


def write(run: Run, document: str, path: Path) -> None:
    """Write the table; a missing reading is a blank cell."""
    arrays = run.arrays
    columns = [
        ["" if np.isnan(value) else repr(value) for value in values.tolist()]
        if values.dtype == np.float64
        else values.astype(str).tolist()
        for values in arrays.values()
    ]
    with path.open("w", encoding="utf-8", newline="") as stream:
        said = {**flat_attributes(run), **notes_of(run)}
        lines = [_TITLE, *(f"# {name}: {' '.join(text.split())}" for name, text in said.items())]
        stream.writelines(f"{line}\r\n" for line in (*lines, _DOCUMENT + document))
        table = csv.writer(stream)
        table.writerow(heading(name) for name in arrays)
        table.writerows(itertools.zip_longest(*columns, fillvalue=""))


def read_back(path: Path) -> Run | None:
    """The run of our own export; None for another text table."""
    text = read_text(path, "utf-8")
    if not text.startswith(_TITLE):
        return None
    document = next((line for line in text.split("\n") if line.startswith(_DOCUMENT)), "")
    return run_of_table(document.removeprefix(_DOCUMENT).strip(), read(path, CsvFile(format="csv", comment="#")))
