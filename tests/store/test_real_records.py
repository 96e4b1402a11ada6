"""The five real records through the maps of the documentation, and a twin of their faults made here."""

from __future__ import annotations

import csv
import gzip
from pathlib import Path

import numpy as np
import openpyxl
import pytest

from ipmclab.run import QUALITY_FLAGS, Run
from ipmclab.store.exporting import export_run
from ipmclab.store.importing import import_run
from ipmclab.store.run_file import read_run, write_run

MAPS = Path(__file__).parents[2] / "docs" / "import_maps"
RECORDS = {  # name: rows, row of the voltage step, its final voltage
    "step_1V": (19_612, 133, 0.988),
    "step_2V": (51_386, 516, 1.975),
    "step_2V_poor": (2_716, 420, 1.975),
    "step_3V": (12_004, 560, 2.957),
}


@pytest.mark.parametrize("name", RECORDS)
def test_a_real_record_imports(name: str, real_runs: Path, tmp_path: Path) -> None:
    rows, step, final = RECORDS[name]
    path = real_runs / f"{name}.csv.gz"
    run = import_run(path, MAPS / f"{name}.toml")
    raw = np.genfromtxt(path, delimiter=",", names=True)
    assert len(run) == rows == len(raw)
    np.testing.assert_allclose(run.time, 0.040 * np.arange(rows), rtol=1e-14)
    assert not run.metadata.sampling_period_known
    assert run.hold == "unknown"
    np.testing.assert_array_equal(run.voltage, raw["voltage_V"])
    np.testing.assert_array_equal(run.current, raw["current_A"])
    np.testing.assert_array_equal(run.force, raw["force_N"])
    assert int(np.argmax(run.voltage > final / 2)) == step
    assert run.voltage[-1] == pytest.approx(final, abs=1e-3)

    lost = raw["laser_mm"] == -99.9999
    assert run.displacement is not None
    np.testing.assert_array_equal(np.isnan(run.displacement), lost)
    flags = run.quality.get("displacement", np.zeros(rows, np.uint8))
    np.testing.assert_array_equal(flags, np.where(lost, QUALITY_FLAGS["sentinel"], 0))
    # Only the zero and the sign lie between the reading and the displacement.
    moved = run.displacement[~lost] + raw["laser_mm"][~lost] / 1000
    np.testing.assert_allclose(moved, moved[0], atol=1e-14)
    assert abs(run.displacement[step - 10]) < 5e-5
    # The first bending after the step, within 500 rows, is positive by the convention.
    bending = run.displacement[step : step + 500]
    assert bending[np.argmax(np.abs(bending))] > 0.3e-3

    for file in (tmp_path / "run.nc", tmp_path / "run.mat", tmp_path / "run.csv"):
        (write_run if file.suffix == ".nc" else export_run)(run, file)
        again = read_run(file) if file.suffix == ".nc" else import_run(file)
        assert again.content_sha256 == run.content_sha256
        assert again.metadata == run.metadata


def test_the_lost_laser_of_the_2_volt_record(real_runs: Path) -> None:
    run = import_run(real_runs / "step_2V.csv.gz", MAPS / "step_2V.toml")
    lost = np.flatnonzero(run.quality["displacement"] == QUALITY_FLAGS["sentinel"])
    assert (len(lost), lost[0]) == (29_943, 21_381)
    # Three readings at -80.17 mm are no sentinel: they stay for the check to find.
    assert run.displacement is not None
    assert np.count_nonzero(run.displacement > 0.05) == 3


def test_the_workbook_is_the_same_run_as_the_table(real_runs: Path) -> None:
    book = import_run(real_runs / "platform_export_1V.xlsx", MAPS / "platform_export_1V.toml")
    table = import_run(real_runs / "step_1V.csv.gz", MAPS / "step_1V.toml")
    assert book.content_sha256 == table.content_sha256


@pytest.fixture
def twin() -> np.ndarray:
    """Rows as the platform writes them: index, current, voltage, force, laser; the laser lost in two blocks."""
    rng = np.random.default_rng(20261121)
    row = np.arange(900)
    after = np.maximum(row - 515, 0) * 0.04
    laser = 10.0 - 3.3 * (1 - np.exp(-after / 4)) + rng.normal(0, 5e-4, 900)
    laser[700:890] = -99.9999
    laser[[750, 751]] = -80.1688
    voltage = np.where(row >= 516, 1.975, 3e-4)
    current = np.where(row >= 515, 0.0499 * np.exp(-after), 0.0)
    return np.column_stack([row, current.round(4), voltage, 0 * row, laser.round(4)])


def import_twin(twin: np.ndarray, folder: Path) -> Run:
    path = folder / "step_2V.csv.gz"
    with gzip.open(path, "wt", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(["sample_index", "current_A", "voltage_V", "force_N", "laser_mm"])
        table.writerows([int(row[0]), *row[1:]] for row in twin.tolist())
    return import_run(path, MAPS / "step_2V.toml")


def test_the_twin_imports_as_the_real_record_does(twin: np.ndarray, tmp_path: Path) -> None:
    run = import_twin(twin, tmp_path)
    lost = np.flatnonzero(run.quality["displacement"] == QUALITY_FLAGS["sentinel"])
    assert (len(lost), lost[0]) == (188, 700)
    assert run.displacement is not None
    assert np.count_nonzero(run.displacement > 0.05) == 2
    np.testing.assert_allclose(
        run.displacement[516:700], 1e-3 * (twin[490:515, 4].mean() - twin[516:700, 4]), atol=1e-15
    )
    np.testing.assert_array_equal(run.current, twin[:, 1])


def test_the_workbook_of_the_twin_is_the_same_run(twin: np.ndarray, tmp_path: Path) -> None:
    zero = twin.copy()
    zero[:, 4] = np.where(zero[:, 4] < -50, 10.0, zero[:, 4])
    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet("lvtemporary_501849")
    channels = {"电流": 1, "电压": 2, "力": 3, "位移": 4}
    sheet.append([f"{axis} - {name}" for name in channels for axis in ("时间 Point", "纵轴")] + ["纵轴 - 电阻"])
    for row in zero.tolist():
        sheet.append([cell for column in channels.values() for cell in (int(row[0]), row[column])] + ["Inf"])
    book.save(tmp_path / "export.xlsx")
    run = import_run(tmp_path / "export.xlsx", MAPS / "platform_export_1V.toml")
    np.testing.assert_array_equal(run.current, zero[:, 1])
    assert run.displacement is not None
    np.testing.assert_allclose(run.displacement, 1e-3 * (zero[107:132, 4].mean() - zero[:, 4]), atol=1e-15)
    assert run.quality == {}
