"""A journal that is begun: what is on the disk by then, and what may come in between."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from uuid import uuid4

import pytest

from ipmclab import platform
from ipmclab.errors import InputError
from ipmclab.store.journal import journal as journal_module
from ipmclab.store.journal.journal import Journal, JournalError, JournalHeader, read_header
from ipmclab.store.journal.laboratory import Laboratory


def header() -> JournalHeader:
    return JournalHeader(str(uuid4()), 50.0, ("voltage", "current"))


def test_header_and_name_are_on_the_disk_and_64_megabytes_are_held_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []

    def sync_file(descriptor: int) -> None:
        platform.sync_file(descriptor)
        done.append(f"{len(read_header(next(tmp_path.rglob('*.runj'))).columns)} columns")

    def sync_folder(folder: Path) -> None:
        platform.sync_folder(folder)
        done.append(folder.name)

    monkeypatch.setattr(journal_module, "sync_file", sync_file)
    monkeypatch.setattr(journal_module, "sync_folder", sync_folder)
    journal = Journal.create(tmp_path, header())
    assert done == ["2 columns", "recording"]
    assert journal.acknowledged == 0
    assert journal.failure is None
    [held] = tmp_path.rglob("*.ballast")
    assert held.stat().st_size == 64 * 2**20  # as docs/files.md says
    assert not journal.path.stat().st_mode & 0o111  # it is no program
    journal.close()


def test_a_disk_that_fails_at_the_beginning_leaves_nothing_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(descriptor: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(journal_module, "sync_file", fail)
    with pytest.raises(JournalError) as caught:
        Journal.create(tmp_path, header(), ballast=1000)
    assert caught.value.code == "write-failed"
    assert list(Laboratory.open(tmp_path).recording.iterdir()) == []


def test_what_was_not_begun_may_be_put_away_by_a_recovery(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A journal that is let go of is anybody's: the disk that is full is told all the same."""
    laboratory, about, close = Laboratory.open(tmp_path), header(), os.close

    def let_go(descriptor: int) -> None:
        close(descriptor)
        laboratory.journal(about.uuid).unlink(missing_ok=True)

    def full(descriptor: int, size: int) -> None:
        monkeypatch.setattr(os, "close", let_go)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(journal_module, "reserve", full)
    with pytest.raises(InputError, match="the disk has no room for a run"):
        Journal.create(laboratory, about)


@pytest.mark.skipif(platform.keeps_what_is_open(), reason="this system moves no file that somebody has open")
def test_an_empty_journal_that_a_recovery_puts_away_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stood there for a moment without a lock and without a word in it."""
    laboratory, about, close = Laboratory.open(tmp_path), header(), os.close
    locked: list[int] = []
    closed: list[int] = []

    def lock_file(descriptor: int) -> bool:
        locked.append(descriptor)
        if len(locked) == 1:
            laboratory.journal(about.uuid).rename(laboratory.lost / "empty.runj")
        return platform.lock_file(descriptor)

    monkeypatch.setattr(journal_module, "lock_file", lock_file)
    with monkeypatch.context() as patch:
        patch.setattr(os, "close", lambda descriptor: (closed.append(descriptor), close(descriptor))[1])
        journal = Journal.create(laboratory, about, ballast=0)
    assert len(locked) == 2
    assert locked[0] in closed
    assert read_header(journal.path).uuid == about.uuid
    with journal.path.open("rb") as another:
        assert not platform.lock_file(another.fileno())
    journal.close()
