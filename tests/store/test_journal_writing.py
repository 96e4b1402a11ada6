"""When and in which pieces a recording reaches the disk, on a clock that only the test moves."""

from __future__ import annotations

import errno
import json
import os
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from uuid import uuid4

import numpy as np
import pytest

from ipmclab.rig.safety import guardian
from ipmclab.store.journal import journal as journal_module
from ipmclab.store.journal.frames import DATA, END, EVENT, HEADER, Frame, read_frames
from ipmclab.store.journal.journal import Journal, JournalError, JournalHeader, read_journal
from tests.waiting import HANGS, in_background, until

BLOCK = 1 << 20
"""Rows of one column that make 8 MB, as much as is written at once."""


class Clock:
    """Stands still. Who waits for a time is woken when the test says so; a recorder's own thread never waits."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.sleeps = np.inf
        """How long [s] who came to wait last will wait."""
        self.is_at_rest = False
        self._turn: threading.Condition | None = None

    def condition(self) -> threading.Condition:
        clock, mine = self, threading.local()

        class Turn(threading.Condition):
            def wait_for(self, predicate: Callable[[], Any], timeout: float | None = None) -> Any:
                end = mine.end = np.inf if timeout is None else clock.now + timeout
                return super().wait_for(lambda: predicate() or clock.now >= end)

            def wait(self, timeout: float | None = None) -> bool:
                assert threading.current_thread() is not threading.main_thread(), "the recorder is held up"
                clock.sleeps, clock.is_at_rest = mine.end - clock.now, True
                return super().wait(timeout)

            def notify_all(self) -> None:
                clock.is_at_rest = False
                super().notify_all()

        self._turn = Turn()
        return self._turn

    def move(self, seconds: float) -> None:
        assert self._turn is not None
        with self._turn:
            self.now += seconds
            self._turn.notify_all()

    def wake(self) -> None:
        """Move to the time that is waited for."""
        self.move(self.sleeps)


class Disk:
    """Holds every write until it is let go on, then it may fail."""

    def __init__(self) -> None:
        self.is_asked, self.go_on = threading.Event(), threading.Event()
        self.error: int = 0

    def sync(self, descriptor: int) -> None:
        self.is_asked.set()
        if threading.current_thread() is threading.main_thread():
            assert self.go_on.is_set(), "the recorder is held up"
        assert self.go_on.wait(HANGS)
        if self.error:
            raise OSError(self.error, os.strerror(self.error))


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(journal_module, "time", SimpleNamespace(monotonic=lambda: made.now))
    monkeypatch.setattr(journal_module, "threading", SimpleNamespace(Condition=made.condition, Thread=threading.Thread))
    return made


def begun(root: Path, **options: Any) -> Journal:
    return Journal.create(root, JournalHeader(str(uuid4()), 50.0, ("voltage",)), **{"ballast": 0, **options})


def rows(first: int, count: int = 1) -> np.ndarray:
    return np.arange(first, first + count, dtype=float)[:, None]


def writer_of(journal: Journal) -> threading.Thread | None:
    return next((one for one in threading.enumerate() if one.name == f"journal {journal.header.uuid}"), None)


def settled(journal: Journal, clock: Clock) -> int:
    """How many rows are on the disk once all is written that need not wait."""
    until(lambda: clock.is_at_rest or writer_of(journal) is None)
    return journal.acknowledged


def frames(path: Path) -> list[Frame]:
    with path.open("rb") as stream:
        return [item for item in read_frames(stream) if isinstance(item, Frame)]


def stored(path: Path) -> list[float]:
    return [float(value) for _, values in read_journal(path).rows() for value in values[:, 0]]


def test_rows_are_on_the_disk_within_half_a_second(tmp_path: Path, clock: Clock) -> None:
    """The first at once; then what came within 0.4 s goes together, and a quiet time is not waited for again."""
    told: list[tuple[int, list[float]]] = []
    journal = begun(tmp_path, on_commit=lambda count: told.append((count, stored(journal.path))))
    assert settled(journal, clock) == 0
    journal.append(0, rows(0))
    assert settled(journal, clock) == 1
    clock.move(0.1)
    journal.append(1, rows(1))
    assert (settled(journal, clock), clock.sleeps) == (1, pytest.approx(0.3))
    journal.append(2, rows(2))
    assert (settled(journal, clock), clock.sleeps) == (1, pytest.approx(0.3))
    clock.wake()
    assert settled(journal, clock) == 3
    journal.append(3, rows(3))
    assert (settled(journal, clock), clock.sleeps) == (3, pytest.approx(0.4))  # as docs/files.md says
    clock.wake()
    assert settled(journal, clock) == 4
    clock.move(3600.0)
    journal.append(4, rows(4))
    assert settled(journal, clock) == 5
    assert told == [(count, [*range(count)]) for count in (1, 3, 4, 5)]
    journal.append(5, rows(5))
    assert (settled(journal, clock), clock.sleeps) == (5, pytest.approx(0.4))
    assert stored(journal.end("complete")) == [*range(6)]  # the end waits for no time


def test_eight_megabytes_are_written_at_once(tmp_path: Path, clock: Clock) -> None:
    """A fast recording does not fill the memory for 0.4 s."""
    journal = begun(tmp_path)
    journal.append(0, rows(0))
    settled(journal, clock)
    journal.append(1, np.zeros((BLOCK - 1, 1)))
    assert settled(journal, clock) == 1
    journal.append(BLOCK, rows(BLOCK))
    assert settled(journal, clock) == BLOCK + 1
    journal.end("complete")


def test_64_megabytes_wait_for_a_slow_disk_and_no_more(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The recorder is held up for less than its guardian waits for it; what waited goes in pieces of 8 MB."""
    told: list[int] = []
    journal, disk = begun(tmp_path, on_commit=told.append), Disk()
    monkeypatch.setattr(os, "write", lambda descriptor, data: len(data))  # the test is not about the disk's room
    monkeypatch.setattr(journal_module, "sync_file", disk.sync)
    block = np.zeros((BLOCK, 1))
    for number in range(8):
        journal.append(number * BLOCK, block)
        assert disk.is_asked.wait(HANGS)
    late = in_background(lambda: journal.append(8 * BLOCK, block))
    until(lambda: clock.is_at_rest or late.done())
    assert 0.0 < clock.sleeps < guardian.SILENCE
    clock.wake()
    error = late.exception(HANGS)
    assert isinstance(error, JournalError)
    assert error.code == "disk-slow"
    assert "the disk is too slow: 67 MB wait to be written" in str(error)
    clock.is_at_rest = False
    disk.go_on.set()
    assert settled(journal, clock) == 8 * BLOCK
    assert told == [number * BLOCK for number in range(1, 9)]
    journal.append(8 * BLOCK, rows(0))  # the refused rows were not taken
    journal.close()


def test_what_waits_is_counted_to_the_byte(tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also after a while: a count that drifts would refuse rows one day, or take more than there is memory for."""
    monkeypatch.setattr(journal_module, "_PATIENCE", 0.0)
    journal = begun(tmp_path)

    def note(text: str) -> None:
        journal.event("note", 0.0, text)

    note("a note")
    settled(journal, clock)
    size = len(frames(journal.path)[-1].payload)
    monkeypatch.setattr(journal_module, "QUEUE_BYTES", size + 1)
    for _ in range(2):
        note("a note")  # leaves room for one byte
        note("a note")
        with pytest.raises(JournalError, match="too slow"):
            note("a note")
        settled(journal, clock)
        clock.wake()
        settled(journal, clock)
        note("a note!")  # fills it
        with pytest.raises(JournalError, match="too slow"):
            note("a note")
        settled(journal, clock)
        clock.wake()
        settled(journal, clock)
    assert len(read_journal(journal.end("complete")).events) == 7


@pytest.mark.parametrize("error", [0, errno.EIO])
def test_who_waits_for_room_goes_on_as_soon_as_the_disk_does(
    error: int, tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal, disk = begun(tmp_path), Disk()
    monkeypatch.setattr(journal_module, "QUEUE_BYTES", 8)
    monkeypatch.setattr(journal_module, "sync_file", disk.sync)
    journal.append(0, rows(0))
    assert disk.is_asked.wait(HANGS)
    late = in_background(lambda: journal.append(1, rows(1)))
    until(lambda: clock.is_at_rest or late.done())
    assert not late.done()
    disk.error = error
    disk.go_on.set()  # and no time passes
    if error:
        assert isinstance(late.exception(HANGS), JournalError)
        assert journal.failure is not None
        assert journal.failure.code == "write-failed"
    else:
        assert late.result(HANGS) is None
    disk.error = 0
    assert stored(journal.end("complete")) == ([0.0] if error else [0.0, 1.0])


def test_rows_are_told_as_safe_when_the_disk_has_said_so(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal, disk = begun(tmp_path), Disk()
    monkeypatch.setattr(journal_module, "sync_file", disk.sync)
    journal.append(0, rows(0))
    assert disk.is_asked.wait(HANGS)
    assert (stored(journal.path), journal.acknowledged) == ([0.0], 0)
    disk.go_on.set()
    assert settled(journal, clock) == 1
    journal.end("complete")


def test_who_listens_and_fails_does_not_end_the_recording(tmp_path: Path, clock: Clock) -> None:
    def fail(count: int) -> None:
        raise RuntimeError(count)

    journal = begun(tmp_path, on_commit=fail)
    for row in range(2):
        journal.append(row, rows(row))
        assert settled(journal, clock) == row + 1
        clock.move(1.0)
    journal.end("complete")


def test_the_end_waits_for_a_disk_that_hangs_but_not_for_ever(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal, disk = begun(tmp_path, ballast=1000), Disk()
    monkeypatch.setattr(journal_module, "sync_file", disk.sync)
    journal.append(0, rows(0))
    assert disk.is_asked.wait(HANGS)
    with monkeypatch.context() as patch:
        patch.setattr(journal_module, "_END_TIME", 0.0)
        with pytest.raises(JournalError, match="the disk has not answered for 0 s") as caught:
            journal.end("complete")
    assert caught.value.code == "disk-slow"
    assert list(tmp_path.rglob("*.ballast"))
    writer = writer_of(journal)
    assert writer is not None
    honest = writer.join
    monkeypatch.setattr(writer, "join", lambda timeout: (disk.go_on.set(), honest(timeout)))
    found = read_journal(journal.end("complete"))
    assert (found.state, found.n_rows) == ("complete", 1)
    assert not list(tmp_path.rglob("*.ballast"))


def test_who_lets_go_of_a_journal_has_its_rows_on_the_disk(tmp_path: Path, clock: Clock) -> None:
    journal = begun(tmp_path, ballast=1000)
    for row in range(2):
        journal.append(row, rows(row))
        settled(journal, clock)
    for _ in range(2):
        journal.close()
        assert stored(journal.path) == [0.0, 1.0]
        assert not list(tmp_path.rglob("*.ballast"))
        assert writer_of(journal) is None
    with pytest.raises(JournalError, match="the recording has ended"):
        journal.append(2, rows(2))
    assert read_journal(journal.end("complete")).state is None


def test_what_came_first_stands_first_and_rows_that_follow_each_other_together(tmp_path: Path, clock: Clock) -> None:
    """A file that is cut loses what came last, and nothing else."""
    journal = begun(tmp_path)
    journal.event("note", 0.0, "begun")
    settled(journal, clock)
    for first in (0, 1, 2):
        journal.append(first, rows(first))
    journal.event("note", 0.06, "touched")
    journal.append(3, rows(3, 2))
    journal.append(5, rows(5, 2))
    journal.append(9, rows(9, 2))
    journal.append(11, rows(11))
    found = frames(journal.end("complete"))
    assert [frame.sequence for frame in found] == [*range(8)]
    assert [frame.kind for frame in found] == [HEADER, EVENT, DATA, EVENT, DATA, DATA, HEADER, END]
    assert [(frame.first_row, frame.rows) for frame in found if frame.kind == DATA] == [(0, 3), (3, 4), (9, 3)]
    assert json.loads(found[3].payload)["text"] == "touched"


def test_copies_of_the_header_lie_ever_further_apart(tmp_path: Path, clock: Clock) -> None:
    """The first with the first rows, the others at doubling distances."""
    journal = begun(tmp_path)
    for row in range(40):
        clock.move(1.0)
        journal.append(row, rows(row))
        assert settled(journal, clock) == row + 1
    found = frames(journal.end("complete"))
    copies = [frame for frame in found if frame.kind == HEADER]
    assert [frame.sequence for frame in copies] == [0, 2, 7, 17, 37]
    assert {frame.payload for frame in copies} == {found[0].payload}
    assert [frame.sequence for frame in found] == [*range(len(found))]


def test_rows_of_one_write_outlive_the_first_frame(tmp_path: Path, clock: Clock) -> None:
    journal = begun(tmp_path)
    journal.append(0, rows(0, 5))
    settled(journal, clock)
    journal.close()
    content = bytearray(journal.path.read_bytes())
    content[0] ^= 1
    journal.path.write_bytes(content)
    assert stored(journal.path) == [*range(5)]


def test_events_alone_bring_no_copy(tmp_path: Path, clock: Clock) -> None:
    journal = begun(tmp_path)
    for _ in range(3):
        journal.event("note", 0.0)
        settled(journal, clock)
        clock.move(1.0)
    assert [frame.kind for frame in frames(journal.end("aborted"))] == [HEADER, EVENT, EVENT, EVENT, END]


def test_a_program_that_leaves_its_journal_open_can_end(tmp_path: Path) -> None:
    journal = begun(tmp_path)
    writer = writer_of(journal)
    assert writer is not None
    assert writer.daemon
    journal.close()
