"""The journal: what it acknowledges is in the file, and a disk that fails costs nothing that was acknowledged."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
import pytest

from ipmclab.errors import InputError
from ipmclab.run import Mark, RunMetadata
from ipmclab.store.journal import journal as journal_module
from ipmclab.store.journal.finalise import finalise
from ipmclab.store.journal.journal import Journal, JournalError, JournalHeader, read_header, read_journal
from ipmclab.store.journal.laboratory import Laboratory, free_space_needed
from ipmclab.store.journal.recover import recover
from ipmclab.store.run_file import read_run
from tests.waiting import until

COLUMNS = ("voltage", "current", "current_quality", "current_raw", "output_raw")


def header(**changes: Any) -> JournalHeader:
    return JournalHeader(**{"uuid": str(uuid4()), "rate": 50.0, "columns": COLUMNS, **changes})


def rows(first: int, count: int) -> np.ndarray:
    """Values that tell their row and column."""
    table = np.add.outer(np.arange(first, first + count), np.arange(len(COLUMNS)) / 16.0)
    table[:, COLUMNS.index("current_quality")] = 0.0
    return table


def stored(path: Path) -> np.ndarray:
    pieces = [values for _, values in read_journal(path).rows()]
    return np.concatenate(pieces) if pieces else np.empty((0, len(COLUMNS)))


def settled(journal: Journal, sent: int) -> None:
    """Wait until all rows are on the disk, or cannot be."""
    until(lambda: journal.acknowledged == sent or journal.failure is not None)


@pytest.fixture(autouse=True)
def _often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journal_module, "COMMIT_TIME", 0.02)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"uuid": "run-1"}, "journal.uuid: 'run-1' is no UUID"),
        ({"uuid": "../../etc/passwd"}, "is no UUID"),
        ({"rate": 0.0}, "journal.rate: the rate is 0.0, it must be above 0"),
        ({"rate": float("nan")}, "the rate is nan"),
        ({"hold": "linear"}, "unknown hold 'linear'"),
        ({"columns": ("voltage", "pressure")}, "unknown column 'pressure'"),
        ({"columns": ("voltage", "temperature")}, "unknown column 'temperature'"),
        ({"columns": ("voltage", "voltage")}, "the column 'voltage' is there twice"),
        ({"columns": ("voltage", "force_quality")}, "'force_quality' without its channel"),
        ({"columns": ("current",)}, "no column 'voltage'"),
    ],
)
def test_a_header_that_makes_no_run_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as caught:
        header(**changes)
    assert caught.value.code == "bad-header"
    assert words in str(caught.value)


def test_a_journal_of_a_newer_format_is_not_guessed_at() -> None:
    """What it would be read as is not what it says: it is refused, with what to do."""
    table = json.loads(header().to_json())
    assert table["format_version"] == 1
    assert JournalHeader.from_json(json.dumps(table).encode(), where="it").rate == 50.0
    newer = json.dumps({**table, "format_version": 2}).encode()
    with pytest.raises(InputError, match="it: format version 2, this ipmclab reads versions up to 1; update ipmclab"):
        JournalHeader.from_json(newer, where="it")
    other = json.dumps({**table, "format": "another"}).encode()
    with pytest.raises(InputError, match="its first frame is no header of a journal"):
        JournalHeader.from_json(other, where="it")


def test_the_header_is_on_the_disk_before_the_first_row(tmp_path: Path) -> None:
    given = header(metadata=RunMetadata(operator="Ada", marks=(Mark(0.0, "began"),)))
    journal = Journal.create(tmp_path, given, ballast=1000)
    found = read_header(journal.path)
    assert found.metadata == given.metadata
    assert (found.uuid, found.rate, found.columns, found.hold) == (given.uuid, 50.0, COLUMNS, "zero-before")
    assert found.created_at
    journal.close()


def test_acknowledged_rows_can_be_read_while_more_are_recorded(tmp_path: Path) -> None:
    told: list[int] = []
    journal = Journal.create(tmp_path, header(), on_commit=told.append)
    sent = 0
    for _ in range(3):
        for _ in range(4):
            journal.append(sent, rows(sent, 10))
            sent += 10
        settled(journal, sent)
        np.testing.assert_array_equal(stored(journal.path), rows(0, sent))
    assert told == sorted(told)
    assert told[-1] == sent
    assert read_journal(journal.path).state is None
    journal.end("complete")
    assert read_journal(journal.path).state == "complete"
    assert not list(journal.path.parent.glob("*.ballast"))


def test_the_recorder_may_use_its_buffer_again(tmp_path: Path) -> None:
    journal = Journal.create(tmp_path, header(), ballast=0)
    buffer = rows(0, 5)
    journal.append(0, buffer)
    buffer[:] = -1.0
    np.testing.assert_array_equal(stored(journal.end("complete")), rows(0, 5))


def test_events_gaps_and_the_end_stand_in_it(tmp_path: Path) -> None:
    journal = Journal.create(tmp_path, header(), ballast=0)
    journal.append(0, rows(0, 3))
    journal.event("environment", np.float64(0.02), temperature=np.float64(22.5), relative_humidity=None)
    journal.append(5, rows(5, 2))
    journal.event("limit", 0.13, "current above 0.1 A")
    found = read_journal(journal.end("aborted", "limit", RunMetadata(operator="Ada")))
    assert found.gaps == ((3, 5),)
    assert found.n_rows == 5
    assert [event.values for event in found.events] == [{"temperature": 22.5, "relative_humidity": None}, {}]
    assert (found.state, found.reason) == ("aborted", "limit")
    assert found.final_metadata == RunMetadata(operator="Ada")
    assert journal.end("complete") == journal.path  # ended is ended
    with pytest.raises(JournalError, match="the recording has ended"):
        journal.append(7, rows(7, 1))


def test_what_is_no_row_or_event_is_refused(tmp_path: Path) -> None:
    journal = Journal.create(tmp_path, header(), ballast=0)
    journal.append(0, rows(0, 3))
    for first, values, words in (
        (2, rows(2, 1), "row 2 was there already: the next is row 3"),
        (3, np.zeros((2, 3)), "shape (2, 3) for 5 columns"),
        (3, np.zeros(5), "shape (5,)"),
    ):
        with pytest.raises(InputError, match="journal") as caught:
            journal.append(first, values)
        assert words in str(caught.value)
    with pytest.raises(InputError, match="the event 'note' cannot be written"):
        journal.event("note", float("nan"))
    with pytest.raises(InputError, match="does not end 'recovered'"):
        journal.end("recovered")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="metadata"):
        journal.end("complete", metadata=RunMetadata(temperature=float("nan")))
    np.testing.assert_array_equal(stored(journal.end("complete")), rows(0, 3))


def test_a_run_has_one_journal(tmp_path: Path) -> None:
    given = header()
    journal = Journal.create(tmp_path, given, ballast=0)
    with pytest.raises(InputError, match="this run has a journal already") as caught:
        Journal.create(tmp_path, given, ballast=0)
    assert caught.value.code == "file-exists"
    journal.close()


def test_a_file_is_no_folder_of_a_laboratory(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("a file")
    with pytest.raises(InputError, match="this is a file") as caught:
        Laboratory.open(tmp_path / "runs")
    assert "name a folder" in caught.value.repair


def test_no_room_is_told_before_anything_moves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    laboratory = Laboratory.open(tmp_path)
    planned = free_space_needed(rate=1e4, duration=3600.0, columns=COLUMNS)
    assert planned > 8 * 5 * 1e4 * 3600  # the journal alone
    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(10**9, 9 * 10**8, 10**8))  # type: ignore[attr-defined]
    assert free_space_needed(rate=50.0, duration=40.0, columns=COLUMNS) < laboratory.free_space() < planned

    def full(descriptor: int, size: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(journal_module, "reserve", full)
    with pytest.raises(InputError, match="the disk has no room for a run: 100 MB are free"):
        Journal.create(laboratory, header())
    assert list(laboratory.recording.iterdir()) == []


class Disk:
    """Takes so many bytes, then fails: a full disk writes what fits, and says so at the next call."""

    def __init__(self, room: float, code: int = errno.ENOSPC) -> None:
        self.room = room
        self.code = code
        self.writes = 0

    def write(self, descriptor: int, data: Any) -> int:
        self.writes += 1
        fits = int(min(self.room, len(data)))
        if not fits:
            raise OSError(self.code, os.strerror(self.code))
        self.room -= fits
        return REAL_WRITE(descriptor, data[:fits])


REAL_WRITE = os.write


@pytest.mark.parametrize("room", [1, 39, 40, 41, 500, 1000])
def test_a_full_disk_cuts_back_to_whole_frames_and_ends_with_the_room_held_back(
    room: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rows of the failed write were not acknowledged; with the ballast gone they are written all the same."""
    journal = Journal.create(tmp_path, header(), ballast=5000)
    journal.append(0, rows(0, 20))
    settled(journal, 20)
    size = journal.path.stat().st_size
    disk = Disk(room)
    monkeypatch.setattr(os, "write", disk.write)
    journal.append(20, rows(20, 30))
    until(lambda: journal.failure is not None)
    assert journal.path.stat().st_size == size
    np.testing.assert_array_equal(stored(journal.path), rows(0, 20))
    with pytest.raises(JournalError) as caught:
        journal.append(50, rows(50, 10))
    assert caught.value.code == "disk-full"
    assert "the disk is full: nothing more can be recorded; what was recorded is safe" in str(caught.value)
    disk.room = 4000  # what the ballast gives back
    path = journal.end("aborted", "disk full")
    assert not list(path.parent.glob("*.ballast"))
    np.testing.assert_array_equal(stored(path), rows(0, 50))
    assert (read_journal(path).state, read_journal(path).damage) == ("aborted", ())


def test_the_room_held_back_is_given_before_what_waits_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The end alone would fit as well, and the rows that came last would be lost."""
    journal = Journal.create(tmp_path, header(), ballast=5000)
    [held] = tmp_path.rglob("*.ballast")

    def write(descriptor: int, data: Any) -> int:
        if held.exists():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return REAL_WRITE(descriptor, data)

    monkeypatch.setattr(os, "write", write)
    journal.append(0, rows(0, 20))
    until(lambda: journal.failure is not None)
    found = read_journal(journal.end("aborted", "disk full"))
    assert (found.state, found.n_rows, found.damage) == ("aborted", 20, ())


def test_room_that_somebody_has_freed_by_hand_is_no_obstacle(tmp_path: Path) -> None:
    journal = Journal.create(tmp_path, header(), ballast=5000)
    journal.append(0, rows(0, 20))
    next(tmp_path.rglob("*.ballast")).unlink()
    assert read_journal(journal.end("complete")).n_rows == 20


def test_an_end_that_does_not_fit_takes_the_room_held_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = Journal.create(tmp_path, header(), ballast=5000)
    journal.append(0, rows(0, 20))
    settled(journal, 20)
    disk = Disk(10)
    monkeypatch.setattr(os, "write", disk.write)
    free = journal._free_room

    def give_back() -> None:
        disk.room = 4000
        free()

    monkeypatch.setattr(journal, "_free_room", give_back)
    found = read_journal(journal.end("complete"))
    assert (found.state, found.n_rows, found.damage) == ("complete", 20, ())


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EIO])
def test_without_any_room_the_acknowledged_rows_are_recovered(
    code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = Journal.create(tmp_path, header(), ballast=100)
    journal.append(0, rows(0, 20))
    settled(journal, 20)
    with monkeypatch.context() as patch:
        patch.setattr(os, "write", Disk(7, code).write)
        journal.append(20, rows(20, 5))
        with pytest.raises(JournalError, match="what was recorded is safe") as caught:
            journal.end("complete")
        assert "ipmclab recover" in caught.value.repair
        assert caught.value.code == ("disk-full" if code == errno.ENOSPC else "write-failed")
    (finished,) = recover(tmp_path).finished
    assert (finished.state, finished.rows) == ("recovered", 20)
    np.testing.assert_array_equal(read_run(finished.path).voltage, np.arange(20.0))


def test_a_disk_that_hangs_is_told_and_does_not_hold_the_recorder_up_for_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = Journal.create(tmp_path, header(), ballast=0)
    go_on = threading.Event()
    real = os.fsync
    monkeypatch.setattr(os, "fsync", lambda descriptor: (go_on.wait(30), real(descriptor)))
    monkeypatch.setattr(journal_module, "QUEUE_BYTES", 2000)

    def record() -> None:
        for first in range(0, 1000, 20):
            journal.append(first, rows(first, 20))

    with pytest.raises(JournalError, match="the disk is too slow") as caught:
        record()
    assert caught.value.code == "disk-slow"
    go_on.set()
    path = journal.end("aborted", "disk slow")
    got = stored(path)
    np.testing.assert_array_equal(got, rows(0, len(got)))
    assert len(got) >= 60


@pytest.fixture
def small_disk(tmp_path: Path, require: Callable[[str, object], None]) -> Iterator[Path]:
    """A file system of 3 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(folder)]
    mounted = shutil.which("mount") and not subprocess.run(command, capture_output=True, check=False).returncode
    require("tmpfs", mounted)
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_real_disk_that_fills_up(small_disk: Path) -> None:
    """Recorded until nothing fits, ended, finished where there is room again: every row that went in is there."""
    laboratory = Laboratory.open(small_disk / "runs")
    earlier = Journal.create(laboratory, header(), ballast=1 << 20)
    earlier.append(0, rows(0, 50))
    first = finalise(earlier.end("complete"), laboratory)
    before = first.read_bytes()
    journal = Journal.create(laboratory, header(), ballast=1 << 20)
    noise = np.random.default_rng(20261121)
    written: list[np.ndarray] = []

    def record() -> None:
        for first in range(0, 10**6, 5000):
            block = noise.normal(size=(5000, len(COLUMNS)))
            block[:, 2] = 0.0
            journal.append(first, block)
            written.append(block)
            settled(journal, first + 5000)

    with pytest.raises(JournalError, match="the disk is full"):
        record()
    path = journal.end("aborted", "disk full")
    safe = read_journal(path)
    assert safe.n_rows == 5000 * len(written)  # also what was in flight: the ballast made room
    assert safe.state == "aborted"
    recovery = recover(laboratory)  # the run file does not fit: told, and nothing is lost
    ((failed, error),) = recovery.failed
    assert failed == path
    assert "ipmclab recover" in error.repair
    assert not list(laboratory.runs.rglob("*.part"))
    subprocess.run(["mount", "-o", "remount,size=30m", str(small_disk)], check=True)
    (finished,) = recover(laboratory).finished
    run = read_run(finished.path)
    assert run.metadata.state == "aborted"
    np.testing.assert_array_equal(run.raw["current"], np.concatenate(written)[:, 3])
    assert first.read_bytes() == before
