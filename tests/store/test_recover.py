"""Recovery: whatever was killed, every acknowledged row is back, and what was finished is as it was."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from uuid import uuid4

import numpy as np
import pytest

from ipmclab.errors import IpmclabError
from ipmclab.quality import check
from ipmclab.store.journal import guardian_word
from ipmclab.store.journal import journal as journal_module
from ipmclab.store.journal import recover as recover_module
from ipmclab.store.journal.finalise import finalise, finish_here
from ipmclab.store.journal.journal import Journal, JournalHeader, read_journal
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.store.journal.recover import recover
from ipmclab.store.run_file import read_run
from tests.waiting import HANGS

WRITER = Path(__file__).with_name("writer.py")


def journal(root: Path, count: int = 50) -> Journal:
    made = Journal.create(root, JournalHeader(str(uuid4()), 50.0, ("voltage",)), ballast=0)
    made.append(0, np.arange(count, dtype=float)[:, None])
    return made


def cut_off(root: Path) -> Path:
    made = journal(root)
    made.close()
    return made.path


def hashes(root: Path) -> dict[Path, str]:
    return {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in root.rglob("*.nc")}


def writer(root: Path, uuid: str, rows: int) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, WRITER, str(root), uuid, str(rows)], stdout=subprocess.PIPE)


def killed_after(process: subprocess.Popen[bytes], seconds: float) -> list[str]:
    """What a process had told when it was killed, so long after its first line."""
    assert process.stdout is not None
    first = process.stdout.readline()
    time.sleep(seconds)
    process.kill()
    rest = process.stdout.read()
    process.wait()
    process.stdout.close()
    return (first + rest).decode().split()


def assert_nothing_lost(root: Path, uuid: str, told: list[str]) -> str:
    """The run of a killed writer is whole as far as it was acknowledged; how it is marked."""
    (path,) = (root / "runs").rglob(f"*_{uuid[:8]}.nc")
    run = read_run(path)
    acknowledged = max(int(word) for word in told if word.isdigit())
    rows = np.arange(len(run))
    assert len(run) >= acknowledged
    np.testing.assert_array_equal(run.time, rows / 1000.0)
    np.testing.assert_array_equal(run.voltage, rows)
    np.testing.assert_array_equal(run.current, rows * 0.5)
    np.testing.assert_array_equal(run.raw["current"], rows * 0.25)
    assert run.metadata.uuid == uuid
    return run.metadata.state or ""


def test_kill_9_of_a_recording_loses_nothing_that_was_acknowledged(tmp_path: Path) -> None:
    """Killed at random moments of recording, end and finishing, by the signal that nobody can catch."""
    random = np.random.default_rng(20261121)
    states = set()
    for number in range(6):
        before = hashes(tmp_path)
        uuid = str(uuid4())
        process = writer(tmp_path, uuid, rows=4000 if number % 2 else 1200)
        told = killed_after(process, random.uniform(0.02, 0.4) + (number % 4 == 0) * 0.5)
        recover_all(tmp_path)
        states.add(assert_nothing_lost(tmp_path, uuid, told))
        if "ended" in told:
            assert read_run(next((tmp_path / "runs").rglob(f"*_{uuid[:8]}.nc"))).metadata.state == "complete"
        after = hashes(tmp_path)
        assert before.items() <= after.items()
        assert len(after) == number + 1
        assert recover(tmp_path).finished == ()
        assert hashes(tmp_path) == after
        assert not list((tmp_path / "recording").iterdir())
    assert "recovered" in states


def recover_all(root: Path) -> None:
    """Recover, again where a killed recorder's finishing process still has a journal: it goes on alone."""
    until = time.monotonic() + HANGS
    while True:
        recovery = recover(root)
        assert recovery.failed == ()
        if all(finished.outcome in ("run", "empty", "gone") for finished in recovery.finished):
            return
        assert time.monotonic() < until
        time.sleep(0.1)


def test_kills_of_the_recovery_itself(tmp_path: Path) -> None:
    random = np.random.default_rng(20261121)
    uuid = str(uuid4())
    told = killed_after(writer(tmp_path, uuid, rows=100_000), 0.3)
    (path,) = (tmp_path / "recording").glob("*.runj")
    command = [sys.executable, "-m", "ipmclab.store.journal.finalise", str(path), str(tmp_path)]
    for _ in range(4):
        child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        time.sleep(random.uniform(0.1, 0.9))
        child.kill()
        child.wait()
    assert recover(tmp_path).failed == ()
    assert assert_nothing_lost(tmp_path, uuid, told) == "recovered"
    assert len(hashes(tmp_path)) == 1
    assert not list(tmp_path.rglob("*.part"))


def test_a_mark_that_no_file_can_hold_costs_no_run(tmp_path: Path) -> None:
    """Half a character, as a program may send it: the mark keeps the rest of its words, and the run its rows."""
    made = journal(tmp_path)
    made.event("note", 0.5, "touched \ud800 the strip")
    made.close()
    [one] = recover(tmp_path).finished
    run = read_run(one.path)
    assert len(run.time) == 50
    assert "touched ? the strip" in [mark.text for mark in run.metadata.marks]


def test_one_bad_recording_does_not_stop_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, third = (cut_off(tmp_path) for _ in range(3))
    (tmp_path / "recording" / "no journal.runj").write_bytes(b"what is this")
    live = journal(tmp_path)
    real = recover_module.finish

    def finish(path: Path, laboratory: Laboratory) -> object:
        if path == second:
            raise IpmclabError("it breaks", code="write-failed")
        return real(path, laboratory)

    told: list[tuple[int, int]] = []
    with monkeypatch.context() as patch:
        patch.setattr(recover_module, "finish", finish)
        recovery = recover(tmp_path, on_progress=lambda done, total, path: told.append((done, total)))
    assert told == [(number, 5) for number in range(5)]
    outcomes = {Path(finished.journal).name: finished.outcome for finished in recovery.finished}
    assert outcomes == {first.name: "run", third.name: "run", "no journal.runj": "lost", live.path.name: "in-use"}
    assert [path for path, _ in recovery.failed] == [second]
    again = recover(tmp_path)
    assert [(finished.journal, finished.outcome) for finished in again.finished if finished.outcome == "run"] == [
        (str(second), "run")
    ]
    assert read_run(finalise(live.end("complete"), tmp_path)).metadata.state == "complete"


def test_half_files_and_old_journals_are_removed_and_nothing_else(tmp_path: Path) -> None:
    laboratory = Laboratory.open(tmp_path)
    run = finalise(journal(tmp_path).end("complete"), tmp_path)
    other = finalise(journal(tmp_path).end("complete"), tmp_path)
    old, kept = sorted(laboratory.archive.iterdir(), key=lambda path: path.stem[:8] != run.stem[-8:])
    unfinished = laboratory.archive / f"{uuid4()}.runj"
    unfinished.write_bytes(b"the run of this one is not here")
    for path, days in ((old, 30.1), (unfinished, 30.1), (kept, 29.9)):  # a month of them is kept
        at = time.time() - days * 24.0 * 3600.0
        os.utime(path, (at, at))
    live = Journal.create(tmp_path, JournalHeader(str(uuid4()), 50.0, ("voltage",)), ballast=10)
    half = run.with_name("20261121_120000_rig_sample_step_01234567.nc.part")
    its_own = run.with_name(f"20261121_120000_rig_sample_step_{live.path.stem[:8]}.nc.part")
    ballast = laboratory.ballast(str(uuid4()))
    for path in (half, its_own, ballast):
        path.write_bytes(b"half")
    recovery = recover(tmp_path)
    assert set(recovery.removed) == {half, ballast, old}
    assert {path.exists() for path in (run, other, kept, unfinished, its_own, live.path)} == {True}
    assert laboratory.ballast(live.path.stem).exists()
    live.close()


def test_two_recoveries_at_once(tmp_path: Path) -> None:
    for _ in range(2):
        cut_off(tmp_path)
    command = [sys.executable, "-c", f"from ipmclab.store.journal.recover import recover; recover({str(tmp_path)!r})"]
    both = [subprocess.Popen(command, stderr=subprocess.PIPE) for _ in range(2)]
    for process in both:
        assert process.communicate()[1] == b""
        assert process.returncode == 0
    recover(tmp_path)
    assert len(hashes(tmp_path)) == 2
    for path in hashes(tmp_path):
        np.testing.assert_array_equal(read_run(path).voltage, np.arange(50.0))
    assert len(list((tmp_path / "journal-archive").iterdir())) == 2
    assert not list((tmp_path / "lost+found").iterdir())


def long_journal(root: Path) -> tuple[Path, bytes]:
    """A recording that was cut off, of many small frames."""
    made = journal(root, 0)
    for first in range(0, 120, 4):
        made.append(first, np.arange(first, first + 4, dtype=float)[:, None])
        made.event("environment", first / 50.0, temperature=22.0)
        made.append(first + 400, np.empty((0, 1)))
        while made.acknowledged < first + 4:
            time.sleep(0.001)
    path = made.end("complete")
    return path, path.read_bytes()


def rows_but_of(content: bytes, place: int) -> list[float]:
    """The rows of every frame but the one that has this byte, by the layout that the documentation gives."""
    kept: list[float] = []
    start = 0
    while start < len(content):
        kind, length = int.from_bytes(content[start + 4 : start + 6], "little"), content[start + 12 : start + 16]
        stop = start + 40 + int.from_bytes(length, "little")
        if kind == 0 and not start <= place < stop:
            kept += np.frombuffer(content[start + 40 : stop], "<f8").tolist()
        start = stop
    return kept


def test_one_flipped_byte_anywhere_costs_no_row_outside_its_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also in the header, which every row needs: 200 flips, half of them in the first frame."""
    monkeypatch.setattr(journal_module, "COMMIT_TIME", 0.001)
    path, content = long_journal(tmp_path)
    first = 40 + int.from_bytes(content[12:16], "little")
    assert len(content) > 4 * first
    random = np.random.default_rng(20261121)
    for number in range(200):
        place = int(random.integers(first if number % 2 else len(content)))
        flipped = bytearray(content)
        flipped[place] ^= 1 << int(random.integers(8))
        path.write_bytes(flipped)
        record = read_journal(path)
        got = [value for _, values in record.rows() for value in values[:, 0].tolist()]
        assert got == rows_but_of(content, place), place
        assert record.damage
        assert record.header.columns == ("voltage",)
    # And it becomes a run, which says that it is damaged.
    path.write_bytes(bytes([content[0] ^ 1]) + content[1:])
    [told] = recover(tmp_path).finished
    assert (told.outcome, told.rows, told.state) == ("run", 120, "recovered")
    assert "its journal is damaged" in told.note


def test_rows_without_any_header_are_kept_as_a_table_and_told(tmp_path: Path) -> None:
    path = journal(tmp_path).end("complete")
    content = path.read_bytes()
    first = 40 + int.from_bytes(content[12:16], "little")
    path.write_bytes(content[first:].replace(content[40:first], b"\0" * (first - 40)))
    [told] = recover(tmp_path).finished
    assert told.outcome == "lost"
    assert "50 rows are whole" in told.note
    assert Path(told.path).parent == Path(told.salvaged).parent == tmp_path / "lost+found"
    table = np.loadtxt(told.salvaged, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table, np.column_stack([np.arange(50.0), np.arange(50.0)]))
    assert Path(told.salvaged).read_text().startswith("row,column 1\n")
    assert recover(tmp_path).finished == ()


@pytest.mark.parametrize(
    ("state", "words"),
    [
        ("zero", "its guardian read the output back at 0 V at 20"),
        ("unread", "its guardian reset the output at 20"),
        ("failed", "its guardian could NOT bring the output to 0 V by 20"),
        ("armed", "its guardian never said that the output is at 0 V"),
        ("disarmed", "its recorder had the output at 0 V at 20"),
        (None, "its guardian left no word of the output"),
    ],
)
def test_a_recovered_run_says_what_became_of_the_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, state: str | None, words: str
) -> None:
    monkeypatch.setattr(guardian_word, "_ACTS_WITHIN", 0.0)
    made = journal(tmp_path)
    made.event("guardian", 0.0, "20261121.guardian")
    made.close()
    word = tmp_path / "recording" / "20261121.guardian"
    if state is not None:
        word.write_text(json.dumps({"state": state, "text": "the recorder is gone", "time": time.time() - 61.0}))
    run = read_run(finish_here(made.path, Laboratory.open(tmp_path)).path)
    assert run.metadata.state == "recovered"
    assert words in (run.metadata.state_reason or "")
    assert "guardian" not in [mark.kind for mark in run.metadata.marks]
    (finding,) = [finding for finding in check(run) if finding.code == "cut-off"]
    assert words in finding.message
    # What says 0 V is no longer needed; what does not is told at the next recording.
    recover(tmp_path)
    assert word.exists() == (state in ("unread", "failed", "armed"))
