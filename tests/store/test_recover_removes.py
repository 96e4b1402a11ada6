"""What recovery removes: files that nobody needs any more, each only when that is sure."""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from uuid import uuid4

import pytest

from ipmclab.errors import IpmclabError
from ipmclab.store.journal import recover as recover_module
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.store.journal.recover import ARCHIVE_TIME, recover

NOW = 1.8e9


@pytest.fixture
def laboratory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Laboratory:
    """One whose journals cannot be finished, as on a full disk, and whose clock stands at ``NOW``."""

    def finish(journal: Path, laboratory: Laboratory) -> None:
        raise IpmclabError("the disk is full", code="write-failed")

    monkeypatch.setattr(recover_module, "finish", finish)
    monkeypatch.setattr(recover_module, "time", SimpleNamespace(time=lambda: NOW))
    return Laboratory.open(tmp_path)


def kept(path: Path, content: str = "kept") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content)
    return path


def half_run(laboratory: Laboratory, uuid: str) -> Path:
    return kept(laboratory.runs / "2026" / "11" / f"20261121_120000_rig_sample_step_{uuid[:8]}.nc.part")


def test_half_files_stay_as_long_as_their_journal_is_there(laboratory: Laboratory) -> None:
    """Each journal's own, however many journals there are; without any journal none is needed."""
    uuids = [str(uuid4()) for _ in range(3)]
    halves = [(half_run(laboratory, uuid), kept(laboratory.ballast(uuid))) for uuid in uuids]
    journals = [kept(laboratory.journal(uuid)) for uuid in uuids[:2]]
    assert set(recover(laboratory).removed) == set(halves[2])
    assert all(path.exists() for pair in halves[:2] for path in (*pair, *journals))
    for journal in journals:
        journal.unlink()
    assert set(recover(laboratory).removed) == {*halves[0], *halves[1]}
    assert not [path for pair in halves for path in pair if path.exists()]


def test_a_file_that_may_only_be_read_is_removed_and_one_that_is_open_is_left(
    laboratory: Laboratory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the rules of Windows; what is left is not said to be removed, and the next recovery removes it."""
    read_only, in_use = (half_run(laboratory, str(uuid4())) for _ in range(2))
    read_only.chmod(0o444)
    held = {in_use}
    real = Path.unlink

    def unlink(path: Path, **options: Any) -> None:
        if path in held or not path.stat().st_mode & 0o200:
            raise PermissionError(13, "Access is denied", str(path))
        real(path, **options)

    monkeypatch.setattr(Path, "unlink", unlink)
    assert recover(laboratory).removed == (read_only,)
    assert (read_only.exists(), in_use.exists()) == (False, True)
    held.clear()
    assert recover(laboratory).removed == (in_use,)


def test_archived_journals_go_after_thirty_days_if_their_run_is_there(laboratory: Laboratory) -> None:
    """Not a second before; one whose run is not there, or whose name tells no run, is kept for ever."""
    assert ARCHIVE_TIME == 30 * 24 * 3600.0
    old, young, runless = (laboratory.archive / f"{uuid4()}.runj" for _ in range(3))
    by_hand = laboratory.archive / "the good one.runj"
    for journal, seconds in ((old, 1.0), (young, 0.0), (runless, 1.0), (by_hand, 1.0)):
        at = NOW - 30 * 24 * 3600.0 - seconds
        os.utime(kept(journal), (at, at))
    for journal in (old, young):
        kept(laboratory.runs / "2026" / "11" / f"20261021_120000_rig_sample_step_{journal.stem[:8]}.nc")
    assert recover(laboratory).removed == (old,)
    assert all(path.exists() for path in (young, runless, by_hand))


def word(laboratory: Laboratory, name: str, state: str, age: float) -> Path:
    told = json.dumps({"state": state, "text": "", "time": NOW - age})
    return kept(laboratory.recording / f"{name}.guardian", told)


def test_a_guardian_s_word_stays_until_everybody_who_needs_it_has_read_it(laboratory: Laboratory) -> None:
    """Clients read it for a minute, a recorder that still runs has its file beside it, a journal cites it."""
    settled = {word(laboratory, state, state, 61.0) for state in ("zero", "disarmed")}
    stay = [word(laboratory, state, state, 61.0) for state in ("armed", "unread", "failed")]
    stay += [word(laboratory, "new", "zero", 60.0), word(laboratory, "recording", "disarmed", 61.0)]
    kept(laboratory.recording / "recording.recorder")
    journal = kept(laboratory.journal(str(uuid4())))
    assert recover(laboratory).removed == ()
    journal.unlink()
    assert set(recover(laboratory).removed) == settled
    assert all(path.exists() for path in stay)
