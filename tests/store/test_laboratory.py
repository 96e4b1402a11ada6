"""The laboratory folder: what stands where, in which order, and what is no laboratory."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from ipmclab.errors import InputError, IpmclabError
from ipmclab.run import RunMetadata
from ipmclab.store.journal.laboratory import Laboratory, free_space_needed


def test_where_a_run_stands_says_when_and_of_what_in_a_name_that_every_system_takes(tmp_path: Path) -> None:
    """A file system has room for 255 bytes: 40 letters for each of rig, sample and signal."""
    about = RunMetadata(recorded_at="2026-11-21T14:32:05.123+01:00", rig="rig 1/é", signal="step 1 V")
    uuid = "3f2a77c1-0000-4000-8000-000000000000"
    laboratory = Laboratory.open(tmp_path)
    plain = laboratory.run_file(uuid, about, "2020-01-01T00:00:00")
    assert plain == tmp_path / "runs" / "2026" / "11" / "20261121_143205_rig-1_sample_step_3f2a77c1.nc"
    long = laboratory.run_file(uuid, replace(about, rig=80 * "r"), "2020-01-01T00:00:00")
    assert long.name == f"20261121_143205_{40 * 'r'}_sample_step_3f2a77c1.nc"
    undated = laboratory.run_file(uuid, replace(about, recorded_at=None), "2020-01-02T03:04:05")
    assert undated == tmp_path / "runs" / "2020" / "01" / "20200102_030405_rig-1_sample_step_3f2a77c1.nc"
    for purpose, word in (("baseline", "baseline"), ("signal", "step")):
        about = replace(about, purpose=purpose)
        assert laboratory.run_file(uuid, about, "").name == f"20261121_143205_rig-1_sample_{word}_3f2a77c1.nc"


def test_a_folder_becomes_a_laboratory_only_where_it_may(tmp_path: Path) -> None:
    root = tmp_path / "lab"
    with pytest.raises(InputError, match="this is no laboratory folder: it has no folder 'recording'") as caught:
        Laboratory.open(root, create=False)
    assert (caught.value.code, list(tmp_path.iterdir())) == ("no-laboratory", [])
    with pytest.raises(InputError, match="does not exist") as caught:
        Laboratory.open(root / "deeper")
    assert (caught.value.code, list(tmp_path.iterdir())) == ("no-such-folder", [])
    made = Laboratory.open(root)
    assert sorted(path.name for path in root.iterdir()) == ["journal-archive", "lost+found", "recording", "runs"]
    assert Laboratory.open(str(root), create=False) == made
    assert Laboratory.open(made) is made
    made.lost.rmdir()
    made.lost.write_text("a file is in the way")
    with pytest.raises(IpmclabError, match="the laboratory folder cannot be made: File exists") as failed:
        Laboratory.open(root)
    assert failed.value.code == "write-failed"


def test_journals_are_found_by_their_age(tmp_path: Path) -> None:
    laboratory = Laboratory.open(tmp_path)
    for folder in (laboratory.recording, laboratory.archive):
        for name, age in (("b", 100.0), ("a", 200.0), ("c", 150.0)):
            path = folder / f"{name}.runj"
            path.touch()
            os.utime(path, (age, age))
        (folder / "d.ballast").touch()
    assert [path.stem for path in laboratory.journals()] == ["b", "c", "a"]
    assert [path.stem for path in laboratory.archived(before=100.0)] == []
    assert sorted(path.stem for path in laboratory.archived(before=150.5)) == ["b", "c"]


def test_tables_of_lost_journals_are_found(tmp_path: Path) -> None:
    laboratory = Laboratory.open(tmp_path)
    for name in ("b.csv", "a.csv", "a.runj"):
        (laboratory.lost / name).touch()
    assert [path.name for path in laboratory.salvaged()] == ["a.csv", "b.csv"]


def test_the_room_of_a_run_is_its_journal_and_three_tenths_beside_what_is_held_back() -> None:
    columns = ["voltage", "current", "force"]
    assert free_space_needed(rate=100.0, duration=10.0, columns=columns, ballast=7) == 7 + 31_200
    assert free_space_needed(rate=100.0, duration=10.0, columns=columns) == 64 * 2**20 + 31_200
