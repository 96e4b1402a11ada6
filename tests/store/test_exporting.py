"""What other programs find in an export, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import openpyxl
import pytest
import scipy.io

from ipmclab.errors import InputError
from ipmclab.run import QUALITY_FLAGS, Mark, Run, RunMetadata
from ipmclab.sample import Sample
from ipmclab.store.document import flat_attributes
from ipmclab.store.exporting import export_run
from ipmclab.store.import_map import ImportMap
from ipmclab.store.importing import import_run
from ipmclab.store.run_file import read_run, write_run


@pytest.fixture
def run() -> Run:
    time = np.arange(50) / 50
    current = 0.06 * np.exp(-time)
    current[3] = np.nan
    return Run.from_arrays(
        time=time,
        voltage=np.ones(50),
        current=current,
        temperature=[20.0, 20.5],
        time_environment=[0.0, 0.5],
        quality={"current": np.where(np.isnan(current), QUALITY_FLAGS["missing"], 0)},
        metadata=RunMetadata(sample=Sample(id="2"), notes='first line\nsecond, "quoted"', shunt_resistance=1.0),
    )


def test_a_text_table_starts_with_comments_then_names_its_units(run: Run, tmp_path: Path) -> None:
    export_run(run, tmp_path / "run.csv")
    lines = (tmp_path / "run.csv").read_text(encoding="utf-8").split("\n")
    comments = [line for line in lines if line.startswith("#")]
    assert {"# sample_id: 2", "# shunt_resistance: 1.0 ohm", '# notes: first line second, "quoted"'} <= set(comments)
    assert (
        lines[len(comments)]
        == "time (s),voltage (V),current (A),temperature (degC),time_environment (s),current_quality"
    )
    assert lines[len(comments) + 4].startswith("0.06,1.0,,,,1")
    read = np.genfromtxt(tmp_path / "run.csv", delimiter=",", skip_header=len(comments) + 1)
    np.testing.assert_array_equal(read[:, 2], run.current)


def test_a_table_says_that_slow_channels_have_times_of_their_own(run: Run, tmp_path: Path) -> None:
    said = "temperature: read at the times in time_environment, not at those in time beside them"
    export_run(run, tmp_path / "run.csv")
    assert f"# times: {said}" in (tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()
    export_run(run, tmp_path / "run.xlsx")
    notes = openpyxl.load_workbook(tmp_path / "run.xlsx")["metadata"]
    assert ("times", said) in [row[:2] for row in notes.iter_rows(values_only=True)]
    export_run(Run.from_arrays(time=run.time, voltage=run.voltage), tmp_path / "without.csv")
    assert (
        "time_environment" not in (tmp_path / "without.csv").read_text(encoding="utf-8").partition("metadata_json")[0]
    )


def test_matlab_finds_column_vectors_units_and_texts(run: Run, tmp_path: Path) -> None:
    export_run(run, tmp_path / "run.mat")
    assert (tmp_path / "run.mat").read_bytes().startswith(b"MATLAB 5.0 MAT-file")
    found = scipy.io.loadmat(tmp_path / "run.mat", simplify_cells=False)
    assert found["current"].shape == (50, 1)
    assert found["current_quality"].dtype == np.uint8
    assert found["units"]["current"].item().item() == "A"
    assert found["metadata"]["sample_id"].item().item() == "2"
    assert json.loads(found["metadata_json"].item())["content_sha256"] == run.content_sha256


def test_a_workbook_holds_numbers_not_texts(run: Run, tmp_path: Path) -> None:
    export_run(run, tmp_path / "run.xlsx")
    book = openpyxl.load_workbook(tmp_path / "run.xlsx")
    assert book.sheetnames == ["run", "metadata"]
    header, *rows = book["run"].iter_rows(values_only=True)
    assert header[:3] == ("time (s)", "voltage (V)", "current (A)")
    assert run.current is not None
    assert [row[2] for row in rows] == [None if np.isnan(value) else value for value in run.current.tolist()]
    assert ("sample_id", "2") in set(book["metadata"].iter_rows(values_only=True, max_col=2))


def test_an_edited_export_is_refused_and_can_be_imported_with_a_map(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    export_run(run, path)
    path.write_text(path.read_text().replace("\n0.02,1.0,", "\n0.02,1.5,"))
    with pytest.raises(InputError, match="the checksum does not match"):
        import_run(path)
    channels = {
        "time": {"column": "time (s)", "unit": "s"},
        "voltage": {"column": "voltage (V)", "unit": "V"},
        "current": {"column": "current (A)", "unit": "A"},
    }
    table = {"file": {"format": "csv", "comment": "#"}, "channels": channels}
    assert import_run(path, ImportMap.from_table(table)).voltage[1] == 1.5


def test_a_lost_document_is_named(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    export_run(run, path)
    path.write_text(path.read_text().replace("# metadata_json", "# metadata"))
    with pytest.raises(InputError, match="metadata_json: damaged, it is not JSON"):
        import_run(path)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("run.txt", r"the ending '\.txt' is not one of \.csv, \.xlsx, \.mat; give one of these"),
        ("new/run.csv", "the folder .*new.* does not exist; make the folder"),
        ("there.csv", "the file exists already; choose another name, or allow overwriting"),
    ],
)
def test_what_cannot_be_written_is_refused(name: str, message: str, run: Run, tmp_path: Path) -> None:
    (tmp_path / "there.csv").write_text("precious")
    with pytest.raises(InputError, match=message):
        export_run(run, tmp_path / name)
    assert (tmp_path / "there.csv").read_text() == "precious"
    assert len(list(tmp_path.iterdir())) == 1
    export_run(run, tmp_path / "there.csv", overwrite=True)
    assert import_run(tmp_path / "there.csv").content_sha256 == run.content_sha256


@pytest.mark.parametrize("name", ["run.nc", "run.csv", "run.xlsx", "run.mat"])
def test_metadata_that_numpy_computed_are_numbers(name: str, tmp_path: Path) -> None:
    one = np.float64(1.0)
    about = RunMetadata(
        sample=Sample(id="2", dry_mass=one),
        shunt_resistance=one,
        minutes_out_of_water=one,
        ranges={"voltage": (-one, one)},
        marks=(Mark(one, "drop"),),
        parameters={"beam.modulus": one},
    )
    run = Run.from_arrays(time=[0.0, 1.0], voltage=[0.0, 1.0], metadata=about)
    assert "float64" not in "".join(flat_attributes(run).values())
    (write_run if name.endswith(".nc") else export_run)(run, tmp_path / name)
    assert (read_run if name.endswith(".nc") else import_run)(tmp_path / name).metadata == about


def test_more_rows_than_a_sheet_holds(tmp_path: Path) -> None:
    rows = np.arange(1_048_576, dtype=float)
    with pytest.raises(InputError, match=r"1048576 rows, a sheet holds 1048575; export to \.csv or \.mat"):
        export_run(Run.from_arrays(time=rows, voltage=0 * rows), tmp_path / "run.xlsx")
    assert list(tmp_path.iterdir()) == []


def test_a_document_longer_than_a_cell_comes_back_wherever_it_is_cut(tmp_path: Path) -> None:
    """A piece that began with "=" was a formula, and the run could not be read any more."""
    run = Run.from_arrays(time=[0.0, 1.0], voltage=[0.0, 1.0], metadata=RunMetadata(notes="=" * 40_000))
    export_run(run, tmp_path / "long.xlsx")
    assert import_run(tmp_path / "long.xlsx").metadata == run.metadata
