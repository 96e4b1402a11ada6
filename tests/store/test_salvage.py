"""What is left of a journal that lost its header: every whole row under its number, and every word."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np

from ipmclab.store.journal.frames import DATA, END, EVENT, Frame
from ipmclab.store.journal.salvage import salvage


def test_every_whole_row_stands_in_a_table_and_every_word_beside_it(tmp_path: Path) -> None:
    notes = [{"kind": "note", "time": 0.1, "text": "touched the bench"}, {"state": "aborted", "reason": "a limit"}]

    def rows(sequence: int, first: int, table: list[list[float]]) -> bytes:
        payload = np.array(table, dtype="<f8").tobytes()
        return Frame(DATA, payload, sequence, len(table[0]), len(table), first).encode()

    content = (
        b"what was a header"
        + rows(1, 5, [[1.0, 0.25], [2.0, 0.5], [-3.0, 1e-300]])
        + Frame(EVENT, json.dumps(notes[0]).encode(), 2).encode()
        + rows(3, 8, [[9.0, 9.0]])[:-1]
        + rows(4, 10, [[4.0, 0.1]])
        + Frame(END, json.dumps(notes[1]).encode(), 5).encode()
    )
    table = salvage(io.BytesIO(content), tmp_path / "lost.runj")
    assert table == tmp_path / "lost.csv"
    assert table.read_text().splitlines() == [
        "row,column 1,column 2",
        "5,1.0,0.25",
        "6,2.0,0.5",
        "7,-3.0,1e-300",
        "10,4.0,0.1",
    ]
    assert json.loads((tmp_path / "lost.json").read_text()) == {"frames": notes}
