"""From a journal to a run file: the same numbers, once, whatever interrupts it."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any
from uuid import uuid4

import h5py
import numpy as np
import pytest

from ipmclab import platform
from ipmclab.errors import IpmclabError
from ipmclab.platform import lock_file, move_file, replace_file
from ipmclab.store.journal import finalise as finalise_module
from ipmclab.store.journal.finalise import Finished, finalise, finish, finish_here
from ipmclab.store.journal.frames import HEADER, Frame
from ipmclab.store.journal.journal import Journal, JournalHeader, read_journal
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.store.run_file import read_run
from tests.store.recordings import COLUMNS, recorded, values


def test_it_can_be_stopped_anywhere_and_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stopped before and after each step: the next time gives the one same file, and no half file stays."""
    journal = recorded(tmp_path)
    content = journal.read_bytes()
    laboratory = Laboratory.open(tmp_path)
    expected = finish_here(journal, laboratory)
    whole = Path(expected.path)
    checksum = read_run(whole).content_sha256
    steps = ("_write", "_difference", "move_file", "file_checksum")
    for step in steps:
        for call in (0, 1):
            for after in (False, True):
                (laboratory.archive / journal.name).unlink(missing_ok=True)
                whole.chmod(0o644)
                whole.unlink()
                journal.write_bytes(content)
                with monkeypatch.context() as patch:
                    stop_at(patch, step, call, after=after)
                    try:
                        finish_here(journal, laboratory)
                    except KeyboardInterrupt:
                        pass
                    else:
                        continue  # the step is not done so often
                assert not list(laboratory.runs.rglob("*.part"))
                again = finish_here(journal, laboratory)
                assert again.outcome in ("run", "gone")
                assert list(laboratory.runs.rglob("*.nc")) == [whole]
                assert read_run(whole).content_sha256 == checksum
                assert not journal.exists()
                assert (laboratory.archive / journal.name).read_bytes() == content


def stop_at(patch: pytest.MonkeyPatch, step: str, call: int, *, after: bool) -> None:
    """Let Ctrl-C come just before or just after the ``call``-th time that a step is done."""
    real = getattr(finalise_module, step)
    calls = iter(range(1000))

    def stopped(*arguments: Any) -> Any:
        due = next(calls) == call
        if due and not after:
            raise KeyboardInterrupt
        result = real(*arguments)
        if due:
            raise KeyboardInterrupt
        return result

    patch.setattr(finalise_module, step, stopped)


def test_a_run_file_that_was_damaged_after_it_was_renamed_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replaced = []

    def move(source: Path, target: Path) -> None:
        if target.exists():
            replaced.append(target)
            mode = stat.S_IMODE(target.stat().st_mode)
            assert mode in (0o644, 0o666), "Windows replaces no file that may only be read"
        move_file(source, target)

    journal = recorded(tmp_path)
    content = journal.read_bytes()
    laboratory = Laboratory.open(tmp_path)
    path = Path(finish_here(journal, laboratory).path)
    checksum = read_run(path).content_sha256
    path.chmod(0o644)
    path.write_bytes(path.read_bytes()[:-100])
    path.chmod(0o444)
    journal.write_bytes(content)
    monkeypatch.setattr(finalise_module, "move_file", move)
    told = finish_here(journal, laboratory)
    assert path in replaced
    assert Path(told.path) == path
    assert read_run(path).content_sha256 == checksum
    assert told.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("name", ["metadata_json", "metadata_sha256", "hold", "state"])
@pytest.mark.parametrize("change", ["other", "gone"])
def test_a_run_file_with_another_attribute_is_made_again(tmp_path: Path, name: str, change: str) -> None:
    """Its rows are those of the journal; that it cannot be read, or says otherwise, is a damage as well."""
    journal = recorded(tmp_path)
    content = journal.read_bytes()
    laboratory = Laboratory.open(tmp_path)
    path = Path(finish_here(journal, laboratory).path)
    path.chmod(0o644)
    with h5py.File(path, "r+") as file:
        if change == "other":
            file.attrs[name] = "0" * len(file.attrs[name])
        else:
            del file.attrs[name]
    journal.write_bytes(content)
    assert finish_here(journal, laboratory).path == str(path)
    assert read_run(path).metadata.state == "complete"
    with h5py.File(path) as file:
        assert file.attrs["state"] == "complete"
        assert file.attrs["hold"] == read_run(path).hold


def test_a_finished_file_is_not_written_again(tmp_path: Path) -> None:
    """A kill between the rename and the archive leaves both: the file stays the very one that it is."""
    journal = recorded(tmp_path)
    content = journal.read_bytes()
    laboratory = Laboratory.open(tmp_path)
    before = Path(finish_here(journal, laboratory).path).stat()
    journal.write_bytes(content)
    (path,) = laboratory.runs.rglob("*.nc")
    path = path.rename(path.with_name(path.name.replace("_signal_", "_other-words_")))
    told = finish_here(journal, laboratory)
    after = Path(told.path).stat()
    assert (before.st_ino, before.st_mtime_ns) == (after.st_ino, after.st_mtime_ns)
    assert told.path == str(path)


def test_what_is_no_run_is_put_away_and_told(tmp_path: Path) -> None:
    laboratory = Laboratory.open(tmp_path)
    broken = laboratory.recording / "broken.runj"
    broken.write_bytes(b"RUNF and nothing else")
    lost = finish_here(broken, laboratory)
    assert (lost.outcome, lost.note) == ("lost", "its first frame is no header of a journal")
    assert Path(lost.path) == laboratory.lost / "broken.runj"
    broken.write_bytes(b"another")
    assert Path(finish_here(broken, laboratory).path) == laboratory.lost / "broken-1.runj"  # nothing is replaced
    broken.write_bytes(b"a third")
    assert Path(finish_here(broken, laboratory).path) == laboratory.lost / "broken-2.runj"
    assert sorted(path.read_bytes()[:7] for path in laboratory.lost.iterdir()) == [b"RUNF an", b"a third", b"another"]
    nothing = recorded(tmp_path, np.empty((0, len(COLUMNS))), end=None)
    empty = finish_here(nothing, laboratory)
    assert (empty.outcome, empty.rows) == ("empty", 0)
    assert (laboratory.archive / nothing.name).exists()
    one = recorded(tmp_path, values(1))
    told = finish_here(one, laboratory)
    assert (told.outcome, told.rows) == ("lost", 1)
    assert [finished.is_loss for finished in (lost, empty, told)] == [False, False, True]  # one has a row
    assert read_journal(told.path).n_rows == 1
    assert finish_here(one, laboratory).outcome == "gone"
    two = finish_here(recorded(tmp_path, values(2)), laboratory)
    assert (two.outcome, two.rows, two.is_loss) == ("run", 2, False)


@pytest.mark.parametrize(
    ("outcome", "words"),
    [
        ("empty", "a.runj: nothing was recorded; record again"),
        ("lost", "a.runj: it cannot be made into a run: 1 row; record again"),
        ("in-use", "a.runj: it is still being written; see ipmclab recover"),
        ("gone", "a.runj: it is not there any more; see ipmclab runs: another program has finished it"),
    ],
)
def test_a_journal_that_gave_no_run_says_what_to_do(
    outcome: Any, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(finalise_module, "finish", lambda *_: Finished("a.runj", outcome, note="1 row"))
    with pytest.raises(IpmclabError) as caught:
        finalise("a.runj", tmp_path)
    assert str(caught.value) == words
    assert caught.value.code == f"journal-{outcome}"


def test_a_journal_that_is_being_written_is_left_alone(tmp_path: Path) -> None:
    journal = Journal.create(tmp_path, JournalHeader(str(uuid4()), 50.0, ("voltage",)), ballast=100)
    journal.append(0, np.ones((10, 1)))
    assert finish(journal.path, tmp_path).outcome == "in-use"
    assert len(list(journal.path.parent.iterdir())) == 2  # with its ballast
    assert read_run(finalise(journal.end("complete"), tmp_path)).metadata.state == "complete"


def test_a_disk_that_takes_no_run_file_keeps_the_journal(tmp_path: Path) -> None:
    """With the largest file that the system allows set below what is needed, as a full disk fails."""
    journal = recorded(tmp_path, values(20000))
    limited = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000));"
        "from ipmclab.store.journal.finalise import finish; from ipmclab.errors import IpmclabError\n"
        f"try: finish({str(journal)!r}, {str(tmp_path)!r})\n"
        "except IpmclabError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", limited], capture_output=True, text=True, check=True)
    assert "ipmclab recover" in done.stdout
    assert "journal is kept" in done.stdout
    assert not list(tmp_path.rglob("*.nc"))
    assert finish(journal, tmp_path).rows == 20000


@pytest.mark.parametrize(
    ("child", "told"),
    [
        ("raise SystemExit(7)", "ended with status 7"),
        ("print('{}')", "ended with status 0"),
        ("""print('{"error": {"code": "write-failed", "message": "no"}}')""", "no"),
    ],
)
def test_a_child_that_made_no_run_is_told(
    child: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = recorded(tmp_path)
    monkeypatch.setattr(finalise_module, "python_child", lambda *_: [sys.executable, "-SE", "-c", child])
    with pytest.raises(IpmclabError, match=told) as caught:
        finish(journal, tmp_path)
    assert caught.value.code == ("write-failed" if told == "no" else "finalise-failed")
    assert journal.exists()


def test_a_child_that_crashes_when_all_is_done_has_done_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The library may also crash as the process ends; and what it prints before is not the word that counts."""
    line = json.dumps({"journal": "a.runj", "outcome": "run", "path": "a.nc", "rows": 5})
    child = f"import os; print('HDF5 says'); print('{{}}'); print({line!r}, flush=True); os._exit(139)"
    monkeypatch.setattr(finalise_module, "python_child", lambda *_: [sys.executable, "-SE", "-c", child])
    assert finish("a.runj", tmp_path) == Finished("a.runj", "run", "a.nc", rows=5)


def test_what_was_written_is_read_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A library that says nothing and writes zeros, as it did on a full disk, is found out."""
    journal = recorded(tmp_path)
    real = finalise_module._write

    def forgetful(layout: Any, stream: Any, path: Path) -> Any:
        import h5py

        digests = real(layout, stream, path)
        with h5py.File(path, "r+") as file:
            file["force"][150:] = 0.0
        return digests

    monkeypatch.setattr(finalise_module, "_write", forgetful)
    with pytest.raises(IpmclabError, match=r"what was read back differs from what was written \(force\)"):
        finish_here(journal, Laboratory.open(tmp_path))
    assert journal.exists()
    assert not [path for path in (tmp_path / "runs").rglob("*") if path.is_file()]


def test_the_child_tells_in_one_line_that_no_later_crash_takes_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = recorded(tmp_path)
    pipe = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(pipe))
    finalise_module.main([str(journal), str(tmp_path)])
    told = Finished(**json.loads(pipe.getvalue()))  # it is through the buffer
    assert (told.outcome, told.rows, told.state, told.note) == ("run", 200, "complete", "")


@pytest.mark.parametrize(
    ("failure", "why"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), "No space left on device"),
        (RuntimeError("unable to flush file\nerrno = 28\nfd = 5"), "unable to flush file"),
        (RuntimeError(), "RuntimeError"),
    ],
)
def test_the_child_tells_why_it_could_not_write(
    failure: Exception, why: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: Any) -> None:
        raise failure

    monkeypatch.setattr(finalise_module, "finish_here", fail)
    finalise_module.main(["a.runj", str(tmp_path)])
    told = json.loads(capsys.readouterr().out)["error"]
    assert told["message"] == f"the run file cannot be written: {why}"
    assert (told["code"], told["where"]) == ("write-failed", "a.runj")


def test_a_run_is_on_the_disk_before_it_has_its_name_and_before_its_journal_is_put_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power cut between two steps finds the journal, or a whole run; also where the month's folder is new."""
    journal = recorded(tmp_path, recorded_at="2026-11-21T14:32:05+01:00")
    laboratory = Laboratory.open(tmp_path)
    steps: list[Any] = []

    def syncs(descriptor: int) -> None:
        found = os.fstat(descriptor)
        steps.append((found.st_ino, found.st_size, found.st_mtime_ns))

    def names(source: Path, target: Path) -> None:
        steps.append((source, target))
        replace_file(source, target)

    monkeypatch.setattr(finalise_module, "sync_file", syncs)
    monkeypatch.setattr(finalise_module, "sync_folder", steps.append)
    monkeypatch.setattr(platform, "sync_folder", steps.append)
    monkeypatch.setattr(platform, "replace_file", names)
    finished = finish_here(journal, laboratory)
    run, archived = Path(finished.path), laboratory.archive / journal.name
    at_last = run.stat()
    assert stat.S_IMODE(at_last.st_mode) == 0o444
    assert steps == [
        laboratory.runs,
        laboratory.runs / "2026",
        (at_last.st_ino, at_last.st_size, at_last.st_mtime_ns),  # nothing is written to it after it was brought there
        (run.with_name(f"{run.name}.part"), run),
        run.parent,
        (journal, archived),
        laboratory.archive,
        laboratory.recording,
    ]


@pytest.mark.skipif(os.name == "nt", reason="there it is so, and a locked file cannot be renamed")
@pytest.mark.parametrize("closes_first", [False, True])
def test_nobody_else_takes_a_journal_before_it_is_put_away(
    closes_first: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is renamed while it is locked; on a system that renames nothing that is open, as soon as it is closed."""
    journal = recorded(tmp_path)
    laboratory = Laboratory.open(tmp_path)
    was_free = []

    def move(source: Path, target: Path) -> None:
        if source == journal:
            with journal.open("r+b") as other:
                was_free.append(lock_file(other.fileno()))
        move_file(source, target)

    monkeypatch.setattr(finalise_module, "keeps_what_is_open", lambda: closes_first)
    monkeypatch.setattr(finalise_module, "move_file", move)
    assert finish_here(journal, laboratory).outcome == "run"
    assert was_free == [closes_first]
    assert (laboratory.archive / journal.name).exists()


def test_the_room_held_back_is_free_when_the_run_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a crash left of it: on a full disk nothing else makes room for the run."""
    journal = recorded(tmp_path, end=None)
    laboratory = Laboratory.open(tmp_path)
    ballast = laboratory.ballast(journal.stem)
    ballast.write_bytes(bytes(1000))
    real = finalise_module._write
    held: list[bool] = []
    monkeypatch.setattr(finalise_module, "_write", lambda *given: (held.append(ballast.exists()), real(*given))[1])
    assert finish_here(journal, laboratory).outcome == "run"
    assert held == [False]


def test_a_journal_that_is_there_is_never_said_to_be_gone(tmp_path: Path) -> None:
    """Where the folder of the runs is not: somebody has moved it, or its disk is not mounted."""
    journal = recorded(tmp_path)
    laboratory = Laboratory.open(tmp_path)
    laboratory.runs.rmdir()
    with pytest.raises(FileNotFoundError):
        finish_here(journal, laboratory)
    assert journal.exists()


def test_a_journal_of_a_newer_version_waits_for_it(tmp_path: Path) -> None:
    laboratory = Laboratory.open(tmp_path)
    header = json.loads(JournalHeader(str(uuid4()), 50.0, ("voltage",)).to_json())
    journal = laboratory.recording / "newer.runj"
    journal.write_bytes(Frame(HEADER, json.dumps({**header, "format_version": 2}).encode(), 0).encode())
    with pytest.raises(IpmclabError, match="update ipmclab"):
        finish_here(journal, laboratory)
    assert journal.exists()


def test_a_run_that_cannot_take_its_name_leaves_no_half_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Windows, which removes no file that may only be read."""
    journal = recorded(tmp_path)
    removed = []
    unlink = Path.unlink

    def remove(path: Path, missing_ok: bool = False) -> None:
        if path.suffix == ".part":
            removed.append(stat.S_IMODE(path.stat().st_mode))
        unlink(path, missing_ok)

    def refuse(*_: Path) -> None:
        raise PermissionError(errno.EACCES, "a virus scanner has it")

    monkeypatch.setattr(Path, "unlink", remove)
    monkeypatch.setattr(finalise_module, "move_file", refuse)
    with pytest.raises(PermissionError, match="a virus scanner has it"):
        finish_here(journal, Laboratory.open(tmp_path))
    assert removed
    assert set(removed) <= {0o644, 0o666}
    assert journal.exists()
    assert not [path for path in (tmp_path / "runs").rglob("*") if path.is_file()]
