"""From a journal to a run file: the same numbers, once, whatever interrupts it."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
import pytest
import xarray

from ipmclab.errors import IpmclabError
from ipmclab.platform import move_file
from ipmclab.quality import check
from ipmclab.run import QUALITY_FLAGS, Mark, Run, RunMetadata, ZeroReading
from ipmclab.sample import Sample
from ipmclab.store.journal import finalise as finalise_module
from ipmclab.store.journal.finalise import Finished, finalise, finish, finish_here
from ipmclab.store.journal.frames import EVENT, Frame, read_frames
from ipmclab.store.journal.journal import Journal, JournalHeader, read_journal
from ipmclab.store.journal.laboratory import Laboratory
from ipmclab.store.journal.run import layout_of
from ipmclab.store.run_file import CHUNK_ROWS, read_run

COLUMNS = ("voltage", "current", "force", "current_quality", "force_quality", "force_raw", "output_raw")


def values(count: int) -> np.ndarray:
    noise = np.random.default_rng(20261121).normal(size=(count, len(COLUMNS)))
    noise[:, COLUMNS.index("current_quality")] = 0.0
    noise[:, COLUMNS.index("force_quality")] = np.arange(count) % 3 * QUALITY_FLAGS["clipped"]
    noise[::7, COLUMNS.index("force")] = np.nan
    return noise


def recorded(
    root: Path, table: np.ndarray | None = None, *, end: str | None = "complete", skip: range = range(0), **about: Any
) -> Path:
    """A journal of these rows, of which some never came."""
    table = values(200) if table is None else table
    header = JournalHeader(str(uuid4()), 50.0, COLUMNS, metadata=RunMetadata(**about))
    journal = Journal.create(root, header, ballast=0)
    for first in range(0, len(table), 70):
        part = range(first, min(first + 70, len(table)))
        kept = [row for row in part if row not in skip]
        if kept:
            journal.append(kept[0], table[kept])
    if end is None:
        journal.close()
        return journal.path
    return journal.end(end, "")  # type: ignore[arg-type]


def finished(journal: Path) -> Run:
    """The run of a journal, finished in this process."""
    return read_run(finish_here(journal, Laboratory.open(journal.parent.parent)).path)


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
    assert not path.stat().st_mode & 0o222
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
    assert "could not be read in 2 rows" in run.metadata.marks[0].text


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


def test_it_can_be_stopped_anywhere_and_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stopped before and after each step: the next time gives the one same file, and no half file stays."""
    journal = recorded(tmp_path)
    content = journal.read_bytes()
    laboratory = Laboratory.open(tmp_path)
    expected = finish_here(journal, laboratory)
    whole = Path(expected.path)
    checksum = read_run(whole).content_sha256
    steps = ("_write", "_difference", "move_file", "_sha256")
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
            assert target.stat().st_mode & 0o200, "Windows replaces no file that may only be read"
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
    nothing = recorded(tmp_path, np.empty((0, len(COLUMNS))), end=None)
    assert finish_here(nothing, laboratory).outcome == "empty"
    assert (laboratory.archive / nothing.name).exists()
    one = recorded(tmp_path, values(1))
    told = finish_here(one, laboratory)
    assert (told.outcome, told.rows) == ("lost", 1)
    assert read_journal(told.path).n_rows == 1
    assert finish_here(one, laboratory).outcome == "gone"
    with pytest.raises(IpmclabError, match="it is not there any more"):
        finalise(one, laboratory)


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


def test_a_crash_of_the_library_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = recorded(tmp_path)
    crashed = subprocess.CompletedProcess([], -11, b"", b"Segmentation fault")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: crashed)
    with pytest.raises(IpmclabError, match="ended with status -11") as caught:
        finish(journal, tmp_path)
    assert caught.value.code == "finalise-failed"
    assert journal.exists()


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


def test_the_child_tells_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    journal = recorded(tmp_path)
    assert finalise_module.main([str(journal), str(tmp_path)]) == 0
    told = Finished(**json.loads(capsys.readouterr().out))
    assert (told.outcome, told.rows, told.state) == ("run", 200, "complete")
