"""The catalogue tells what is in the files, whatever becomes of them; the same on both databases."""

from __future__ import annotations

import os
import shutil
import uuid
from pathlib import Path

import numpy as np
import pytest

from ipmclab.errors import InputError, IpmclabError
from ipmclab.quality import check
from ipmclab.run import Finding, RunMetadata
from ipmclab.sample import Sample
from ipmclab.store.catalogue import sweep as catalogue_sweep
from ipmclab.store.catalogue.catalogue import Catalogue, CatalogueRow, Range, RunQuery
from ipmclab.store.journal.finalise import finish
from ipmclab.store.journal.header import JournalHeader
from ipmclab.store.journal.journal import Journal

SEED = 20261121


def names(rows: list[CatalogueRow]) -> list[str | None]:
    return [row.path for row in rows]


def new_uuid() -> str:
    return str(uuid.uuid4())


# What the files say, and what becomes of them.


def test_new_changed_moved_and_vanished_files(catalogue: Catalogue, folder: Path, write) -> None:
    first = write("runs/2026/11/a.nc", sample="S1", recorded_at="2026-11-21T10:00:00+00:00")
    write("b.nc", sample="S2", recorded_at="2026-11-20T10:00:00+00:00")
    found = catalogue.sweep()
    assert (found.files, found.added, found.changed, found.gone, found.problems) == (2, 2, 0, 0, ())
    assert names(catalogue.query()) == ["b.nc", "runs/2026/11/a.nc"]  # the oldest first
    assert catalogue.sweep().added == 0

    write("b.nc", sample="S3")
    found = catalogue.sweep()
    assert (found.added, found.changed) == (0, 1)
    assert {(row.sample, row.state) for row in catalogue.query()} == {("S1", None), ("S3", None), ("S2", "missing")}

    first.rename(folder / "renamed.nc")
    found = catalogue.sweep()
    assert (found.added, found.gone) == (1, 1)
    assert names(catalogue.query(RunQuery(sample="S1"))) == ["renamed.nc"]
    assert len(catalogue.query()) == 3

    (folder / "renamed.nc").unlink()
    catalogue.sweep()
    (row,) = catalogue.query(RunQuery(state="missing", sample="S1"))
    assert row.path is None
    assert catalogue.metadata(row)["sample"] == {"id": "S1"}


def test_a_copy_is_the_same_run_and_stands_in_for_it(catalogue: Catalogue, folder: Path, write) -> None:
    path = write("a.nc", uuid=new_uuid(), sample="S1")
    catalogue.sweep()
    shutil.copy(path, folder / "copy.nc")
    assert catalogue.sweep().added == 1
    assert names(catalogue.query()) == ["a.nc"]
    path.unlink()
    catalogue.sweep()
    assert names(catalogue.query()) == ["copy.nc"]


def test_a_corrected_copy_is_a_version_and_both_are_listed(catalogue: Catalogue, folder: Path, write) -> None:
    """The numbers of one file never stand beside the metadata of another."""
    uuid = new_uuid()
    write("as_recorded.nc", uuid=uuid, sample="S1")
    catalogue.sweep()
    write("corrected.nc", uuid=uuid, sample="S2")
    for look in (catalogue.sweep, catalogue.rebuild):
        look()
        rows = catalogue.query()
        assert [(row.path, row.sample, row.version) for row in rows] == [
            ("as_recorded.nc", "S1", 1),
            ("corrected.nc", "S2", 2),
        ]
        assert [catalogue.metadata(row)["sample"]["id"] for row in rows] == ["S1", "S2"]
    (alone,) = catalogue.query(RunQuery(sample="S2"))
    assert alone.version == 2
    # A file whose metadata were changed in its place stays one run.
    (folder / "corrected.nc").unlink()
    write("corrected.nc", uuid=uuid, sample="S3")
    catalogue.sweep()
    assert [(row.path, row.sample) for row in catalogue.query()] == [("as_recorded.nc", "S1"), ("corrected.nc", "S3")]


def test_a_recording_becomes_the_run_of_its_file(catalogue: Catalogue, folder: Path, write) -> None:
    uuid = new_uuid()
    catalogue.begin(uuid, RunMetadata(uuid=uuid))
    write("a.nc", uuid=uuid, sample="S1")
    catalogue.add(folder / "a.nc")
    catalogue.begin(uuid, RunMetadata(uuid=uuid))  # one that knows less comes late
    assert [(row.path, row.state, row.version) for row in catalogue.query()] == [("a.nc", None, 1)]


def test_a_damaged_file_is_named_and_stops_no_other(catalogue: Catalogue, folder: Path, write) -> None:
    write("a.nc", sample="S1")
    path = write("b.nc", sample="S2")
    whole = path.read_bytes()
    catalogue.sweep()
    path.write_bytes(whole[:3000])
    (folder / "empty.nc").touch()
    (folder / "text.nc").write_text("not netCDF", encoding="utf-8")
    (folder / "notes.txt").write_text("not looked at", encoding="utf-8")
    write("c.nc", sample="S3")
    found = catalogue.sweep()
    assert [(problem.path, problem.code) for problem in found.problems] == [
        ("b.nc", "truncated-file"),
        ("empty.nc", "empty-file"),
    ]
    assert "copy it again" in found.problems[0].message
    assert found.foreign == 1
    assert {(row.sample, row.state) for row in catalogue.query()} == {("S1", None), ("S2", "damaged"), ("S3", None)}
    assert [row.sample for row in catalogue.query(RunQuery(state="damaged"))] == ["S2"]
    assert catalogue.sweep().changed == 0  # nothing new, but the problems are told again
    assert len(catalogue.sweep().problems) == 2
    path.write_bytes(whole)
    assert [problem.path for problem in catalogue.sweep().problems] == ["empty.nc"]
    assert [row.state for row in catalogue.query(RunQuery(sample="S2"))] == [None]


def test_another_content_under_the_same_uuid_is_told(catalogue: Catalogue, folder: Path, write) -> None:
    same = new_uuid()
    write("a.nc", uuid=same, sample="S1")
    catalogue.sweep()
    write("b.nc", uuid=same, sample="S1", current=0.07)
    (problem,) = catalogue.sweep().problems
    assert (problem.path, problem.code) == ("b.nc", "same-uuid")
    assert "a.nc" in problem.message
    (folder / "a.nc").unlink()
    assert catalogue.sweep().problems == ()
    assert names(catalogue.query()) == ["b.nc"]


def test_folders_of_the_recorder_and_hidden_ones_are_left_alone(catalogue: Catalogue, write) -> None:
    for place in ("recording/a.nc", "lost+found/b.nc", "journal-archive/c.nc", ".hidden/d.nc", ".e.nc", "runs/f.nc"):
        write(place, sample=place)
    write("runs/recording/g.nc", sample="only at the top has it this meaning")
    catalogue.sweep()
    assert sorted(map(str, names(catalogue.query()))) == ["runs/f.nc", "runs/recording/g.nc"]


@pytest.mark.skipif(os.name == "nt", reason="Windows lets few users make links")
def test_links_make_no_loop(catalogue: Catalogue, folder: Path, write) -> None:
    write("a.nc")
    (folder / "again").symlink_to(folder, target_is_directory=True)
    (folder / "nowhere.nc").symlink_to(folder / "gone.nc")
    assert catalogue.sweep().files == 1


def test_texts_that_databases_dislike(catalogue: Catalogue, write) -> None:
    write("a.nc", sample="S\0\x01 %_' \N{SNOWMAN}", operator="x" * 5000, notes="\0", run_number=2**70)
    assert catalogue.sweep().problems == ()
    (row,) = catalogue.query()
    assert row.sample == "S\N{REPLACEMENT CHARACTER}\x01 %_' \N{SNOWMAN}"
    assert row.operator is not None
    assert len(row.operator) == 500
    assert row.run_number is None
    assert catalogue.metadata(row)["run_number"] == 2**70


def test_a_sweep_that_is_stopped_keeps_what_it_read(
    catalogue: Catalogue, write, monkeypatch: pytest.MonkeyPatch
) -> None:
    for k in range(7):
        write(f"{k}.nc", sample=f"S{k}")
    monkeypatch.setattr(catalogue_sweep, "_BATCH", 2)

    def stop(done: int, total: int) -> None:
        assert total == 7
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        catalogue.sweep(None, stop)
    assert len(catalogue.query()) == 4
    assert catalogue.sweep().added == 3


# Recording.


def test_a_recording_from_begin_to_end(catalogue: Catalogue, folder: Path, write) -> None:
    header = JournalHeader(new_uuid(), 50.0, ("voltage", "current"))
    journal = Journal.create(folder, header, ballast=0)
    metadata = RunMetadata(sample=Sample("S1"), signal="step 1 V", recorded_at="2026-11-21T10:00:00+00:00")
    catalogue.begin(header.uuid, metadata)
    (row,) = catalogue.query(RunQuery(state="recording"))
    assert (row.uuid, row.sample, row.amplitude) == (header.uuid, "S1", 1.0)
    catalogue.sweep()
    assert [row.state for row in catalogue.query()] == ["recording"]
    path = write("runs/a.nc", uuid=header.uuid, sample="S1", state="aborted", state_reason="operator")
    catalogue.add(path, [Finding("spike", "warning", "at 1 s", values={"height": float("nan")})])
    catalogue.begin(header.uuid, metadata)  # late, from a slow process: it knows less
    (row,) = catalogue.query()
    assert (row.state, row.state_reason, row.codes) == ("aborted", "operator", ("spike",))
    assert catalogue.findings([row])[row.id][0].values == {"height": None}
    journal.close()


def test_a_recording_that_the_catalogue_did_not_hear_of(catalogue: Catalogue, folder: Path) -> None:
    header = JournalHeader(new_uuid(), 50.0, ("voltage",), metadata=RunMetadata(sample=Sample("S9")))
    journal = Journal.create(folder, header, ballast=0)
    (folder / "recording" / "torn.runj").write_bytes(b"RU")
    catalogue.sweep()
    (row,) = catalogue.query(RunQuery(state="recording", sample="S9"))
    assert row.recorded is not None
    journal.close()
    journal.path.unlink()
    catalogue.sweep()
    assert [row.state for row in catalogue.query()] == ["missing"]


def test_nothing_is_left_of_a_recording_without_rows(catalogue: Catalogue, folder: Path) -> None:
    for dealt_with in (False, True):
        header = JournalHeader(new_uuid(), 50.0, ("voltage",), metadata=RunMetadata(sample=Sample("S9")))
        journal = Journal.create(folder, header, ballast=0)
        catalogue.begin(header.uuid, header.metadata)
        journal.end("aborted", "the guardian is gone")
        assert [row.state for row in catalogue.query()] == ["recording"]
        assert finish(journal.path, folder).outcome == "empty"
        if dealt_with:
            catalogue.discard(header.uuid)
        else:
            catalogue.sweep()
        assert catalogue.query() == []


def test_only_files_of_the_folder_are_added(catalogue: Catalogue, tmp_path: Path, write) -> None:
    outside = write("../elsewhere.nc")
    with pytest.raises(InputError, match="not in the folder"):
        catalogue.add(outside)


# Findings.


def test_findings_are_kept_until_the_content_changes(catalogue: Catalogue, write) -> None:
    current = 0.05 * np.exp(-np.arange(500) / 50.0)
    current[200] = 0.15
    time = np.arange(500) / 50.0
    spiked = {"time": time, "voltage": np.ones(500), "current": current}
    from ipmclab.run import Run
    from ipmclab.store.run_file import write_run

    write("good.nc", sample="S1")
    write_run(Run.from_arrays(**spiked), catalogue.root / "spiked.nc")
    catalogue.sweep()
    assert [row.codes for row in catalogue.query()] == [None, None]
    seen: list[tuple[int, int]] = []
    catalogue.inspect(catalogue.query(), check, lambda done, total: seen.append((done, total)))
    assert seen == [(1, 2), (2, 2)]
    (row,) = catalogue.query(RunQuery(findings=("spike",)))
    assert row.path == "spiked.nc"
    assert row.codes is not None
    (kept,) = [one for one in catalogue.findings([row])[row.id] if one.code == "spike"]
    assert (kept.severity, kept.channel) == ("warning", "current")
    assert catalogue.query(RunQuery(findings=("spik",))) == []
    assert "spike" in catalogue.codes()

    # Touched: read again, the findings stay. Changed: they are open again.
    os.utime(catalogue.root / "spiked.nc", ns=(1, 1))
    assert catalogue.sweep().changed == 1
    assert catalogue.query(RunQuery(findings=("spike",)))
    catalogue.inspect(catalogue.query(), lambda run: pytest.fail("it was inspected already"))
    write("good.nc", sample="S1", uuid=new_uuid(), current=0.06)
    catalogue.sweep(check)
    assert all(row.codes is not None for row in catalogue.query() if row.path)


def test_one_run_that_cannot_be_inspected_stops_no_other(catalogue: Catalogue, write) -> None:
    import h5py

    write("a.nc", sample="S1")
    write("b.nc", sample="S2")
    flipped = write("c.nc", sample="S3")
    with h5py.File(flipped, "r+") as file:
        file["current"][7] = 9.0
    catalogue.sweep()

    def fails(run) -> list[Finding]:
        if run.metadata.sample.id == "S1":
            raise ZeroDivisionError("a check that nobody foresaw")
        return [Finding("noted", "info", "seen")]

    problems = catalogue.inspect(catalogue.query(), fails)
    assert {(problem.path, problem.code) for problem in problems} == {("a.nc", "not-checked"), ("c.nc", "checksum")}
    states = {row.path: (row.codes, row.state) for row in catalogue.query()}
    assert states == {"a.nc": (None, None), "b.nc": (("noted",), None), "c.nc": (None, "damaged")}
    assert [problem.path for problem in catalogue.sweep().problems] == []  # its size and time are those of before


def test_the_numbers_of_a_fingerprint(catalogue: Catalogue, write) -> None:
    path = write("a.nc", sample="S1", purpose="fingerprint", uuid=new_uuid())
    told = Finding("fingerprint", "info", "...", values={"series_resistance": 5.5, "capacitance": 0.03, "drift": 0.0})
    catalogue.add(path, [told])
    (row,) = catalogue.query(RunQuery(sample="S1", purpose="fingerprint"))
    assert (row.series_resistance, row.capacitance) == (5.5, 0.03)


# Questions.


def test_questions_against_a_plain_filter(catalogue: Catalogue) -> None:
    """Random runs, random questions: the database gives what a loop over the runs gives."""
    generator = np.random.default_rng(SEED)
    signals = [
        "step 1 V",
        "step -1 V",
        "sine 1 V 0.1 Hz",
        "sine 1.1 V 2 Hz",
        "step 1 V for 5 s then sine 2 V 1 Hz",
        None,
    ]
    runs = {}
    for k in range(120):
        runs[new_uuid()] = RunMetadata(
            sample=Sample(f"S{generator.integers(4)}"),
            mounting_id=f"m{generator.integers(6)}",
            signal=signals[generator.integers(len(signals))],
            relative_humidity=None if k % 7 == 0 else float(generator.uniform(20, 95)),
            temperature=float(generator.uniform(15, 30)),
            recorded_at=f"2026-11-{1 + generator.integers(28):02d}T10:00:00+00:00",
            purpose=["signal", "baseline", "fingerprint"][generator.integers(3)],
        )
    for name, metadata in runs.items():
        catalogue.begin(name, metadata)

    def within(value: float | None, wanted: Range | None) -> bool:
        return wanted is None or (value is not None and wanted.low <= value <= wanted.high)

    def amplitude(text: str | None) -> float | None:
        return None if text is None else 2.0 if "then" in text else float(text.split()[1])

    def holds(one: RunMetadata, query: RunQuery) -> bool:
        assert one.sample is not None
        assert one.recorded_at is not None
        words = [part.split()[0] for part in (one.signal or "").split(" then ") if part]
        return (
            query.sample in (None, one.sample.id)
            and query.mounting in (None, one.mounting_id)
            and query.purpose in (None, one.purpose)
            and (query.signal is None or query.signal in words)
            and within(amplitude(one.signal), query.amplitude)
            and within(one.relative_humidity, query.humidity)
            and within(one.temperature, query.temperature)
            and (query.since is None or int(one.recorded_at[8:10]) >= 15)
        )

    def maybe(value):
        return value if generator.random() < 0.4 else None

    found_any = 0
    for _ in range(60):
        low = float(generator.uniform(20, 80))
        query = RunQuery(
            sample=maybe(f"S{generator.integers(4)}"),
            mounting=maybe(f"m{generator.integers(6)}"),
            purpose=maybe("baseline"),
            signal=maybe(["step", "sine"][generator.integers(2)]),
            amplitude=maybe(Range(0.9, 1.1)),
            humidity=maybe(Range(low, low + 30.0)),
            temperature=maybe(Range(20.0, np.inf)),
            since=maybe(1794700800.0),  # 2026-11-15 00:00 UTC
        )
        expected = {name for name, metadata in runs.items() if holds(metadata, query)}
        assert {row.uuid for row in catalogue.query(query)} == expected
        found_any += bool(expected)
    assert found_any > 20


def test_measured_channels_must_all_be_there(catalogue: Catalogue, write) -> None:
    write("a.nc", channels={"force": np.zeros(50)})
    write("b.nc", channels={"force": np.zeros(50), "displacement": np.zeros(50)})
    write("c.nc")
    catalogue.sweep()
    assert len(catalogue.query(RunQuery(measured=("force",)))) == 2
    assert names(catalogue.query(RunQuery(measured=("force", "displacement")))) == ["b.nc"]
    assert catalogue.query(RunQuery(measured=("forc",))) == []
    assert catalogue.query(RunQuery(measured=("force",)))[0].measured == ("current", "force")


# Anew from the files.


def everything(catalogue: Catalogue) -> list[tuple[object, ...]]:
    """What the catalogue tells, without the numbers of its rows."""
    rows = catalogue.query()
    kept = catalogue.findings(rows)
    return sorted((str((row[1:], catalogue.metadata(row), kept.get(row.id))),) for row in rows)


def test_a_rebuild_gives_what_a_first_look_gives(catalogue: Catalogue, folder: Path, write) -> None:
    for k in range(4):
        write(f"{k}.nc", sample=f"S{k}", uuid=new_uuid(), recorded_at=f"2026-11-0{k + 1}T10:00:00+00:00")
    catalogue.sweep(check)
    first = everything(catalogue)
    catalogue.begin(new_uuid(), RunMetadata(sample=Sample("of a recorder that is at work elsewhere")))
    gone = write("gone.nc", sample="gone", uuid=new_uuid())
    catalogue.sweep()
    gone.unlink()
    catalogue.rebuild(check)
    assert everything(catalogue) == first


def test_a_rebuild_leaves_other_laboratories_alone(server, tmp_path: Path, folder: Path, write) -> None:
    address = server.new_database()
    other = tmp_path / "other"
    other.mkdir()
    write("a.nc", sample="S1", uuid=new_uuid())
    shutil.copy(write("b.nc", sample="S2", uuid=new_uuid()), other / "b.nc")
    (folder / "b.nc").unlink()
    here, there = Catalogue(folder, address), Catalogue(other, address)
    here.sweep()
    there.sweep()
    assert {row.sample for row in here.query()} == {"S1", "S2"}
    assert [row.sample for row in here.query(RunQuery(laboratory=here.laboratory))] == ["S1"]
    (far,) = here.query(RunQuery(laboratory=there.laboratory))
    assert str(here.file_of(far)).endswith(f"{other.as_posix()}/b.nc")
    here.rebuild()
    here.sweep()
    assert {(row.sample, row.state) for row in there.query()} == {("S1", None), ("S2", None)}


def test_a_catalogue_of_another_version_says_what_to_do(catalogue: Catalogue, write) -> None:
    write("a.nc", sample="S1")
    catalogue.sweep()
    from sqlalchemy import text

    from ipmclab.store.catalogue.tables import VERSION

    for version, code in ((VERSION + 1, "catalogue-newer"), (VERSION - 1, "catalogue-older")):
        with catalogue._database.write() as connection:
            connection.execute(text(f"UPDATE ipmclab_catalogue SET version = {version}"))
        again = Catalogue(catalogue.root, None if catalogue._own else catalogue._database.url.render_as_string(False))
        with pytest.raises(IpmclabError, match=f"version {version}.*--rebuild") as caught:
            again.query()
        assert caught.value.code == code
        again.rebuild()
        assert [row.sample for row in again.query()] == ["S1"]


def test_tables_that_somebody_changed(catalogue: Catalogue, write) -> None:
    write("a.nc", sample="S1")
    catalogue.sweep()
    from sqlalchemy import text

    with catalogue._database.write() as connection:
        connection.execute(text("ALTER TABLE ipmclab_file DROP COLUMN problem"))
    with pytest.raises(IpmclabError, match=r"nothing is lost.*--rebuild") as caught:
        catalogue.query()
    assert caught.value.code == "catalogue-broken"
    catalogue.rebuild()
    assert [row.sample for row in catalogue.query()] == ["S1"]


def test_what_cannot_be_looked_at_is_not_gone(folder: Path, write, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder that is closed for now, or on a drive that does not answer: its runs are still known."""
    monkeypatch.delenv("IPMCLAB_CATALOGUE", raising=False)
    catalogue = Catalogue(folder)
    write("aside/a.nc")
    catalogue.sweep()
    scan, stat = os.scandir, Path.stat

    def refuse(path: object) -> None:
        if "aside" in str(path):
            raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "scandir", lambda path: refuse(path) or scan(path))
    monkeypatch.setattr(Path, "stat", lambda self, **asked: refuse(self) or stat(self, **asked))
    found = catalogue.sweep()
    assert (found.gone, [one.code for one in found.problems]) == (0, ["unreadable-folder"])
    assert [row.path for row in catalogue.query()] == ["aside/a.nc"]
