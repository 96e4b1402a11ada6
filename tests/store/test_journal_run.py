"""What a run holds that is made of a journal: the numbers that were recorded, and what happened."""

from __future__ import annotations

import io
import json
import math
import stat
from dataclasses import replace
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
import pytest
import xarray
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.quality import check
from ipmclab.run import QUALITY_FLAGS, Mark, Run, RunMetadata, ZeroReading
from ipmclab.sample import Sample
from ipmclab.store.journal import run as run_module
from ipmclab.store.journal.finalise import finalise
from ipmclab.store.journal.frames import DATA, END, EVENT, HEADER, Frame, read_frames
from ipmclab.store.journal.journal import Journal, JournalHeader, read_journal
from ipmclab.store.journal.run import Layout, layout_of
from ipmclab.store.run_file import CHUNK_ROWS, read_run
from tests.store.recordings import COLUMNS, finished, recorded, values


def test_the_run_is_the_one_that_was_recorded(tmp_path: Path) -> None:
    """Numbers, times, quality bits and raw volts, and the same checksum as if it had never been on a disk."""
    table = values(200)
    sample = Sample("S 2/a", counter_ion="Li+")
    about = {
        "sample": sample,
        "rig": "bench 1",
        "signal": "step 0 V for 5 s then sine 1 V 0.1 Hz for 40 s then step 0 V for 5 s",
        "recorded_at": "2026-11-21T14:32:05+01:00",
        "zeros": (ZeroReading("force", "tare", "before", 0.001, 1e-5, 2e-6),),
    }
    journal = recorded(tmp_path, table, **about)
    path = finalise(journal, tmp_path)
    expected = Run.from_arrays(
        time=np.arange(200) / 50.0,
        voltage=table[:, 0],
        current=table[:, 1],
        force=table[:, 2],
        quality={"force": table[:, 4]},  # nothing was known against the current
        raw={"force": table[:, 5], "output": table[:, 6]},
        hold="zero-before",
    )
    run = read_run(path)
    assert run.content_sha256 == expected.content_sha256
    assert run.metadata == RunMetadata(uuid=journal.stem, state="complete", **about)
    assert path == tmp_path / f"runs/2026/11/20261121_143205_bench-1_S-2-a_sine_{journal.stem[:8]}.nc"
    assert stat.S_IMODE(path.stat().st_mode) == 0o444  # who reads it does not change it
    assert list((tmp_path / "journal-archive").iterdir()) == [tmp_path / "journal-archive" / journal.name]
    assert list((tmp_path / "recording").iterdir()) == []
    with xarray.open_dataset(path) as opened:  # another reader than ours
        np.testing.assert_array_equal(opened["force_raw"].values, table[:, 5])
        assert opened["force_raw"].attrs["units"] == "V"
        assert opened.attrs["state"] == "complete"
        assert opened.attrs["zeros"] == "force: tare before 0.001 N, standard uncertainty 1e-05 N, drift 2e-06 N/s"


def test_a_record_that_is_longer_than_a_block_is_written_in_blocks(tmp_path: Path) -> None:
    table = values(2 * CHUNK_ROWS + 17)
    journal = recorded(tmp_path, table)
    run = finished(journal)
    np.testing.assert_array_equal(run.time, np.arange(len(table)) / 50.0)
    np.testing.assert_array_equal(run.current, table[:, 1])
    np.testing.assert_array_equal(run.raw["output"], table[:, 6])


def test_what_happened_stands_in_the_run(tmp_path: Path) -> None:
    header = JournalHeader(str(uuid4()), 50.0, ("voltage", "current"), metadata=RunMetadata(operator="Ada"))
    journal = Journal.create(tmp_path, header, ballast=0)
    journal.event("environment", 0.0, temperature=22.0, relative_humidity=45.0)
    journal.append(0, np.ones((100, 2)))
    journal.event("environment", 1.0, temperature=22.5)
    journal.event("environment", 1.0, temperature=99.0)  # twice at one time: the first counts
    journal.event("note", 1.2, "touched the bench")
    journal.append(150, np.ones((50, 2)))
    told = replace(header.metadata, marks=(Mark(1.2, "touched the bench"), Mark(0.5, "a limit", "limit")))
    run = finished(journal.end("aborted", "the operator aborted it", told))
    assert run.metadata.state == "aborted"
    assert run.metadata.state_reason == "the operator aborted it"
    assert run.metadata.operator == "Ada"
    assert run.metadata.marks == (
        Mark(0.5, "a limit", "limit"),
        Mark(1.2, "touched the bench"),
        Mark(2.0, "rows 100 to 149 are missing (1 s)", "gap"),
    )
    np.testing.assert_array_equal(run.time_environment, [0.0, 1.0])
    np.testing.assert_array_equal(run.temperature, [22.0, 22.5])
    np.testing.assert_array_equal(run.relative_humidity, [45.0, np.nan])
    np.testing.assert_array_equal(run.time[[99, 100]], [1.98, 3.0])
    assert "rows-missing" in {finding.code for finding in check(run)}


def test_a_gap_that_the_recorder_told_of_is_not_told_twice(tmp_path: Path) -> None:
    header = JournalHeader(str(uuid4()), 50.0, ("voltage",))
    journal = Journal.create(tmp_path, header, ballast=0)
    journal.append(10, np.ones((10, 1)))
    journal.event("gap", 0.4, "the chassis dropped 1 row")
    journal.append(21, np.ones((10, 1)))
    marks = finished(journal.end("complete")).metadata.marks
    assert marks == (
        Mark(0.0, "rows 0 to 9 are missing (0.2 s)", "gap"),
        Mark(0.4, "the chassis dropped 1 row", "gap"),
    )


def test_a_voltage_that_could_not_be_read_is_what_was_commanded_and_flagged(tmp_path: Path) -> None:
    table = np.ones((50, 3))
    table[10:12, 0] = np.nan
    table[20, 1] = np.inf
    table[:, 2] = 1.5
    header = JournalHeader(str(uuid4()), 50.0, ("voltage", "current", "output_raw"))
    journal = Journal.create(tmp_path, header, ballast=0)
    journal.append(0, table)
    run = finished(journal.end("complete"))
    np.testing.assert_array_equal(run.voltage[9:13], [1.0, 1.5, 1.5, 1.0])
    np.testing.assert_array_equal(np.flatnonzero(run.quality["voltage"]), [10, 11])
    assert run.current is not None
    assert np.isnan(run.current[20])
    text = "the voltage could not be read in 2 rows: what was commanded is there"
    assert run.metadata.marks == (Mark(0.0, text, "bench"),)


@pytest.mark.parametrize(
    ("end", "torn", "state", "reason"),
    [
        ("complete", b"", "complete", None),
        (None, b"", "recovered", "the recording was cut off before its end; 0 bytes dropped"),
        (None, b"RUNF123", "recovered", "7 bytes dropped, the first at byte"),
        ("complete", b"\0" * 50, "recovered", "the recording ended complete, but its journal is damaged; 50 bytes"),
    ],
)
def test_the_state_says_how_it_ended(end: Any, torn: bytes, state: str, reason: str | None, tmp_path: Path) -> None:
    journal = recorded(tmp_path, end=end)
    with journal.open("ab") as stream:
        stream.write(torn)
    metadata = finished(journal).metadata
    assert metadata.state == state
    assert reason is None or reason in (metadata.state_reason or "")


def test_a_damaged_frame_is_a_gap_and_not_the_end(tmp_path: Path) -> None:
    """One flipped bit on the disk costs the rows of one write."""
    table = values(200)
    header = JournalHeader(str(uuid4()), 50.0, COLUMNS)
    journal = Journal.create(tmp_path, header, ballast=0)
    for first in (0, 50, 101, 150):  # a row is skipped each time, so that each has a frame of its own
        journal.append(first, table[first : first + 49])
    path = journal.end("complete")
    content = bytearray(path.read_bytes())
    with path.open("rb") as stream:
        second = [frame for frame in read_frames(stream) if isinstance(frame, Frame) and frame.rows][1]
    content[second.offset + 60] ^= 4
    path.write_bytes(content)
    run = finished(path)
    rows = [*range(49), *range(101, 199)]
    np.testing.assert_array_equal(run.time, np.array(rows) / 50.0)
    np.testing.assert_array_equal(run.voltage, table[rows, 0])
    assert run.metadata.state == "recovered"
    assert "the content of a frame is damaged" in (run.metadata.state_reason or "")
    assert run.metadata.marks[0].text == "rows 49 to 100 are missing (1.04 s)"


def test_a_journal_torn_at_any_byte_gives_all_that_was_whole(tmp_path: Path) -> None:
    """The last write stopped anywhere: the rows of every whole frame, no other, and the note of what was dropped."""
    table = values(15)
    header = JournalHeader(str(uuid4()), 50.0, COLUMNS)
    journal = Journal.create(tmp_path, header, ballast=0)
    for first in (0, 5, 10):
        journal.append(first, table[first : first + 4])
        journal.event("note", first / 50.0, "looked")
    content = journal.end("complete").read_bytes()
    with journal.path.open("rb") as stream:
        frames = [frame for frame in read_frames(stream) if isinstance(frame, Frame)]
    ends = [frame.offset + len(frame) for frame in frames]
    assert ends[-1] == len(content)
    torn = tmp_path / "torn.runj"
    for length in range(ends[0], len(content) + 1):
        torn.write_bytes(content[:length])
        record = read_journal(torn)
        whole = [frame for frame, end in zip(frames, ends, strict=True) if end <= length]
        expected = [row for frame in whole for row in range(frame.first_row, frame.first_row + frame.rows)]
        got = [block for _, block in record.rows()]
        np.testing.assert_array_equal(np.concatenate(got) if got else np.empty((0, 7)), table[expected])
        assert record.bytes_dropped == length - ends[len(whole) - 1]
        assert len(record.events) == sum(frame.kind == EVENT for frame in whole)
        metadata = layout_of(record).metadata
        assert metadata.state == ("complete" if length == len(content) else "recovered")
        assert metadata.state_reason is None or f"{record.bytes_dropped} bytes dropped" in metadata.state_reason


def stored(columns: tuple[str, ...], *items: Any, created_at: str = "", **about: Any) -> tuple[Layout, io.BytesIO]:
    """What the run of a journal will hold: of (first row, values), of events as tables, and of its end as a text."""
    header = JournalHeader(str(uuid4()), 50.0, columns, metadata=RunMetadata(**about), created_at=created_at)
    frames = [Frame(HEADER, header.to_json(), 0)]
    for number, item in enumerate(items, start=1):
        if isinstance(item, tuple):
            table = np.asarray(item[1], dtype="<f8").reshape(-1, len(columns))
            frames.append(Frame(DATA, table.tobytes(), number, len(columns), len(table), item[0]))
        elif isinstance(item, dict):
            frames.append(Frame(EVENT, json.dumps({"text": "", **item}).encode(), number))
        else:
            frames.append(Frame(END, json.dumps({"state": item}).encode(), number))
    stream = io.BytesIO(b"".join(frame.encode() for frame in frames))
    return layout_of(read_journal("a.runj", stream)), stream


voltages = st.sampled_from([1.0, -2.0, math.nan, math.inf])


@given(
    pieces=st.lists(st.tuples(st.integers(0, 2), st.lists(voltages, min_size=1, max_size=9)), min_size=1, max_size=5)
)
@pytest.mark.parametrize("output_is_known", [False, True])
def test_rows_come_in_blocks_however_they_were_written(
    output_is_known: bool, pieces: list[tuple[int, list[float]]]
) -> None:
    """A voltage that could not be read is what was commanded, else the last one read, also across blocks; 0 V first."""
    columns = ("voltage", "current", "current_quality", *(["output_raw"] if output_is_known else []))
    items, rows, expected, flagged, last = [], [], [], [], 0.0
    for gap, piece in pieces:
        first = (rows[-1] + 1 if rows else 0) + gap
        table = []
        for row, voltage in enumerate(piece, start=first):
            output = math.nan if row % 5 == 3 else 10.0 + row
            table.append([voltage, row / 8.0, float(4 * (row % 2)), output][: len(columns)])
            seen = [value for value in (voltage, *([output] if output_is_known else [])) if math.isfinite(value)]
            last = seen[0] if seen else last
            rows.append(row)
            expected.append(last)
            flagged.append(0 if math.isfinite(voltage) else QUALITY_FLAGS["missing"])
        items.append((first, table))
    layout, stream = stored(columns, *items, "complete")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_module, "CHUNK_ROWS", 4)
        blocks = list(layout.blocks(stream))
    assert [len(block["time"]) for block in blocks[:-1]] == [4] * (len(blocks) - 1)
    got = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    assert {name: len(array) for name, array in got.items()} == layout.lengths
    np.testing.assert_array_equal(got["time"], np.array(rows) / 50.0)
    np.testing.assert_array_equal(got["current"], np.array(rows) / 8.0)
    np.testing.assert_array_equal(got["voltage"], expected)
    np.testing.assert_array_equal(got.get("voltage_quality", np.zeros(len(rows))), flagged)
    np.testing.assert_array_equal(got.get("current_quality", np.zeros(len(rows))), np.array(rows) % 2 * 4)


@pytest.mark.parametrize(
    ("missing", "text"), [(1, "row 20 is missing (0.02 s)"), (2, "rows 20 to 21 are missing (0.04 s)")]
)
@pytest.mark.parametrize(("beside", "is_told"), [(-2, False), (-1, True), (0, True), (1, True), (2, False)])
def test_a_gap_is_told_by_whoever_told_of_it_within_a_row(missing: int, text: str, beside: int, is_told: bool) -> None:
    """The recorder says when it saw the gap, from the row before to the row behind; another gap is not this one."""
    stop = 20 + missing
    seen = (20 if beside <= 0 else stop) + beside
    mark = {"kind": "gap", "time": seen / 50.0, "text": "the chassis lost them"}
    layout, _ = stored(("voltage",), (0, np.ones(20)), mark, (stop, np.ones(20)), "complete")
    told = [one.text for one in layout.metadata.marks if one.text != "the chassis lost them"]
    assert told == ([] if is_told else [text])


@pytest.mark.parametrize("count", [99, 100, 101, 103])
def test_of_many_gaps_a_hundred_are_told_and_the_rest_summed_up(count: int) -> None:
    layout, _ = stored(("voltage",), *((3 * number, [1.0]) for number in range(count + 1)), "complete")
    marks = layout.metadata.marks
    assert [mark.time for mark in marks[:100]] == [(3 * number + 1) / 50.0 for number in range(min(count, 100))]
    more = count - 100
    said = [(Mark(301 / 50.0, f"{more} more gaps from here on, {2 * more} rows", "gap"))] if more > 0 else []
    assert list(marks[100:]) == said


def test_a_reading_of_the_room_that_is_no_number_is_missing() -> None:
    """What a sensor says while it starts, or another program writes; a sensor that never says one was not there."""
    events = [
        {"kind": "environment", "time": time, "values": {"temperature": temperature, "relative_humidity": "dry"}}
        for time, temperature in ((0.0, "warm"), (1.0, 22), (2.0, None), (3.0, math.inf), (3.5, 23.5))
    ]
    layout, _ = stored(("voltage",), *events, (0, np.ones(200)), "complete")
    assert list(layout.environment) == ["time_environment", "temperature"]
    np.testing.assert_array_equal(layout.environment["time_environment"], [0.0, 1.0, 2.0, 3.0, 3.5])
    np.testing.assert_array_equal(layout.environment["temperature"], [math.nan, 22.0, math.nan, math.nan, 23.5])
    deaf, _ = stored(("voltage",), events[0], (0, np.ones(200)), "complete")
    assert deaf.environment == {}
    assert deaf.lengths == {"time": 200, "voltage": 200}


def test_a_run_was_recorded_when_its_metadata_say_so_else_when_its_journal_began() -> None:
    said, began = "2026-11-21T14:32:05+01:00", "2026-11-21T14:32:01+01:00"
    rows = (0, np.ones(3))
    assert stored(("voltage",), rows, created_at=began, recorded_at=said)[0].metadata.recorded_at == said
    assert stored(("voltage",), rows, created_at=began)[0].metadata.recorded_at == began
    assert stored(("voltage",), rows)[0].metadata.recorded_at is None
