"""What is left of a journal whose header is lost, and every copy of it: its rows as numbered columns."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ipmclab.store.journal.frames import DATA, Damage, read_frames


def salvage(stream: BinaryIO, beside: Path) -> Path:
    """Write the rows of all whole frames as CSV, and what else the journal says as JSON.

    Parameters
    ----------
    stream : binary file
        The journal.
    beside : path
        Where the journal goes: the files stand there under its name, with ``.csv`` and ``.json``.

    Returns
    -------
    path : path
        Of the CSV: ``row``, then ``column 1`` and so on as they were read. Whether a column is a quantity in SI units,
        bits of quality or volts is not known.
    """
    table, notes = beside.with_suffix(".csv"), beside.with_suffix(".json")
    said: list[Any] = []
    with table.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        columns = 0
        for frame in read_frames(stream):
            if isinstance(frame, Damage):
                continue
            if frame.kind != DATA:
                said.append(json.loads(frame.payload))
                continue
            if not columns:
                columns = frame.columns
                writer.writerow(["row", *(f"column {number + 1}" for number in range(columns))])
            values = np.frombuffer(frame.payload, dtype="<f8").reshape(frame.rows, frame.columns).tolist()
            writer.writerows([frame.first_row + number, *row] for number, row in enumerate(values))
    notes.write_text(json.dumps({"frames": said}, indent=1), encoding="utf-8")
    return table
