"""What is read of a journal: every row that fits, once; and what else stands in it is told as damage."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ipmclab.errors import InputError
from ipmclab.store.journal.frames import DATA, END, EVENT, HEADER, HEADER_SIZE, Damage, Frame
from ipmclab.store.journal.header import JournalHeader
from ipmclab.store.journal.record import Event, JournalRecord, Piece, read_header, read_journal

COLUMNS = ("voltage", "current", "current_quality")
ABOUT = JournalHeader("3f2a77c1-0d4b-4a52-8f0e-2f3a51c0ffee", 50.0, COLUMNS)
HEAD = Frame(HEADER, ABOUT.to_json(), 0)


def rows(first: int, count: int, columns: int = 3) -> Frame:
    """Rows that tell their number, with no bit of quality."""
    table = np.outer(np.arange(first, first + count), np.ones(columns))
    table[:, 2:] = 0.0
    return Frame(DATA, table.tobytes(), 0, columns, count, first)


def note(kind: int, said: Any) -> Frame:
    return Frame(kind, said if isinstance(said, bytes) else json.dumps(said).encode(), 0)


def written(folder: Path, *frames: Frame) -> tuple[Path, list[int]]:
    """A journal of these frames, numbered, and where each starts."""
    encoded = [replace(frame, sequence=number).encode() for number, frame in enumerate(frames)]
    path = folder / "a.runj"
    path.write_bytes(b"".join(encoded))
    return path, [sum(map(len, encoded[:number])) for number in range(len(encoded))]


def table(record: JournalRecord) -> np.ndarray:
    return np.concatenate([values for _, values in record.rows()])


@pytest.mark.parametrize(
    "strange",
    [
        rows(3, 2, columns=2),  # of another rig
        rows(3, 2, columns=4),
        rows(2, 2),  # a row that was there
        rows(0, 3),
        rows(3, 0),
    ],
)
def test_rows_that_do_not_fit_are_dropped_and_told(tmp_path: Path, strange: Frame) -> None:
    """Nobody knows what they are: none of their numbers stands in a run, and all others do."""
    path, starts = written(tmp_path, HEAD, rows(0, 3), strange, rows(3, 3), rows(8, 1))
    record = read_journal(path)
    assert record.damage == (Damage(starts[2], starts[3], "a frame does not fit the header"),)
    assert record.bytes_dropped == len(strange)
    assert record.pieces == tuple(
        Piece(first, count, start + HEADER_SIZE)
        for first, count, start in zip((0, 3, 8), (3, 3, 1), (starts[1], *starts[3:]), strict=True)
    )
    assert (record.n_rows, record.gaps) == (7, ((6, 8),))
    np.testing.assert_array_equal(table(record)[:, 0], [0, 1, 2, 3, 4, 5, 8])


def test_rows_that_a_disk_lost_are_gaps_and_its_rubbish_is_counted(tmp_path: Path) -> None:
    """Also before the first row that is left, and of one row; the end may be torn."""
    path, starts = written(tmp_path, HEAD, rows(0, 2), rows(2, 2), rows(4, 1), rows(6, 3))
    content = bytearray(path.read_bytes())
    content[starts[1] + HEADER_SIZE] ^= 1
    path.write_bytes(content + b"RUNF")
    record = read_journal(path)
    assert record.gaps == ((0, 2), (5, 6))
    assert record.damage == (
        Damage(starts[1], starts[2], "the content of a frame is damaged"),
        Damage(len(content), len(content) + 4, "it ends inside the head of a frame"),
    )
    assert record.bytes_dropped == starts[2] - starts[1] + 4
    np.testing.assert_array_equal(table(record)[:, 0], [2, 3, 4, 6, 7, 8])


@pytest.mark.parametrize(
    "strange",
    [
        note(EVENT, b"no words"),
        note(EVENT, ["note", 1.0, "touched"]),
        note(EVENT, {"kind": "note", "text": "touched"}),
        note(EVENT, {"kind": "note", "time": 1.0}),
        note(EVENT, {"kind": "note", "time": 1.0, "text": "touched", "values": 5}),
        note(END, {"reason": "it ended"}),
        note(END, {"state": "recovered"}),
        note(END, {"state": "complete", "metadata": {"temperature": "hot"}}),
    ],
)
def test_what_is_neither_event_nor_end_is_told_and_costs_no_row(tmp_path: Path, strange: Frame) -> None:
    path, starts = written(tmp_path, HEAD, rows(0, 3), strange, rows(3, 3))
    record = read_journal(path)
    assert record.damage == (Damage(starts[2], starts[3], "a frame holds neither event nor end"),)
    assert (record.events, record.state, record.final_metadata) == ((), None, None)
    np.testing.assert_array_equal(table(record)[:, 0], np.arange(6.0))


def test_events_and_the_end_are_read_and_copies_of_the_header_are_no_damage(tmp_path: Path) -> None:
    """Event and end may come with or without what is optional; what happened at no time is no event."""
    path, _ = written(
        tmp_path,
        HEAD,
        note(EVENT, {"kind": "note", "time": 1, "text": "touched"}),
        note(EVENT, {"kind": "note", "time": float("inf"), "text": "never"}),
        HEAD,
        note(EVENT, {"kind": "environment", "time": 2.0, "text": "", "values": {"temperature": 22.0}}),
        note(END, {"state": "aborted"}),
    )
    record = read_journal(path)
    assert record.events == (Event("note", 1.0, "touched"), Event("environment", 2.0, "", {"temperature": 22.0}))
    assert (record.state, record.reason, record.final_metadata, record.damage) == ("aborted", "", None, ())
    assert (record.n_rows, record.gaps, record.unread_voltages) == (0, (), 0)


def test_one_bit_of_quality_flags_its_column_and_each_voltage_that_is_no_number_is_counted(tmp_path: Path) -> None:
    values = np.ones((4, 3))
    values[:, 2] = 0.0
    clean = read_journal(written(tmp_path, HEAD, Frame(DATA, values.tobytes(), 0, 3, 4))[0])
    assert (clean.flagged, clean.unread_voltages) == (frozenset(), 0)
    values[[0, 2], 0], values[1, 1], values[3, 2] = (np.nan, -np.inf), np.nan, 4.0
    frame = Frame(DATA, values.tobytes(), 0, 3, 4)
    record = read_journal(written(tmp_path, HEAD, frame, replace(frame, first_row=4))[0])
    assert (record.flagged, record.unread_voltages) == (frozenset({"current_quality"}), 4)


@pytest.mark.parametrize(
    ("frames", "code", "words"),
    [
        ((), "empty-file", "it is empty (0 bytes)"),
        ((note(EVENT, {"kind": "note", "time": 1.0, "text": ""}),), "not-a-journal", "its first frame is no header"),
        ((rows(0, 0),), "not-a-journal", "its first frame is no header of a journal"),
        ((rows(0, 1),), "header-lost", "no copy of it: 1 rows are whole"),
        ((rows(0, 3), rows(3, 2), note(END, {"state": "complete"})), "header-lost", "no copy of it: 5 rows are whole"),
    ],
)
def test_what_has_no_header_is_refused_with_what_is_left_of_it(
    tmp_path: Path, frames: tuple[Frame, ...], code: str, words: str
) -> None:
    path, _ = written(tmp_path, *frames)
    for read in (read_journal, read_header, lambda path: read_journal(path, io.BytesIO(path.read_bytes()))):
        with pytest.raises(InputError) as caught:
            read(path)
        assert caught.value.code == code
        assert words in str(caught.value)
        assert str(path) in str(caught.value)


def test_a_copy_of_the_header_is_as_good_as_the_first(tmp_path: Path) -> None:
    """Where the first is lost the rows before the copy are read as well: from the path as from the open file."""
    path, _ = written(tmp_path, rows(0, 3), HEAD, rows(3, 3))
    assert read_header(path) == ABOUT
    with path.open("rb") as stream:
        for record in (read_journal(path), read_journal(tmp_path / "not looked at", stream)):
            assert (record.header, record.n_rows, record.damage) == (ABOUT, 6, ())
            got = list(record.rows(stream))
            assert [first for first, _ in got] == [0, 3]
            np.testing.assert_array_equal(np.concatenate([values for _, values in got])[:, 0], np.arange(6.0))
