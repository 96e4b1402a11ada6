"""One record written by other programs in every foreign format, read through maps and held against what was written."""

from __future__ import annotations

import gzip
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pytest
import scipy.io

import ipmclab
from tests.independent.thesis import FRIEND_2, respond

MAPS = Path(__file__).resolve().parents[2] / "docs" / "import_maps"
RATE, ROWS = 50.0, 400


@pytest.fixture(scope="module")
def record() -> dict[str, np.ndarray]:
    time = np.arange(ROWS) / RATE
    voltage = np.where(time >= 1.0, 1.0, 0.0)
    return {"time": time, "voltage": voltage, **respond(FRIEND_2, voltage, RATE, "zero-before")}


def test_the_thesis_binary_with_its_laser(record: dict[str, np.ndarray], tmp_path: Path) -> None:
    # Appendix A.2: float64, four numbers a row. 1 ohm shunt; 4-20 mA over 500 ohm is 2 V to 10 V for 25 mm.
    laser = 2.0 + 8.0 * (12.3e-3 + record["displacement"]) / 25e-3
    rows = np.stack([record["time"], record["current"] * 1.0, laser, record["voltage"]], axis=1)
    rows.astype("<f8").tofile(tmp_path / "exp1.bin")
    run = ipmclab.import_run(tmp_path / "exp1.bin", MAPS / "friend_displacement.toml")
    np.testing.assert_allclose(run.time, record["time"], atol=1e-12)
    np.testing.assert_allclose(run.voltage, record["voltage"], atol=1e-12)
    np.testing.assert_allclose(run.current, record["current"], atol=1e-12)
    np.testing.assert_allclose(run.displacement, record["displacement"], atol=1e-12)
    assert run.hold == "zero-before"
    assert run.metadata.shunt_resistance == 1.0


def test_the_thesis_binary_with_its_load_cell(record: dict[str, np.ndarray], tmp_path: Path) -> None:
    # 10 V is 10 gf, and a gram-force is 9.80665 mN; the script counted 10 mN.
    cell = (record["force"] + 4.393e-3) / 9.80665e-3
    rows = np.stack([record["time"], record["current"], cell, record["voltage"]], axis=1)
    rows.astype("<f8").tofile(tmp_path / "exp1.bin")
    run = ipmclab.import_run(tmp_path / "exp1.bin", MAPS / "friend_force.toml")
    np.testing.assert_allclose(run.force, record["force"], atol=1e-12)


@pytest.mark.parametrize("step", [1e-4, 6.25e-6])
def test_a_peak_at_a_full_scale_is_found_with_the_map_of_the_thesis(step: float, tmp_path: Path) -> None:
    """204.8 mA (figure 5.15) are 2^11 steps of 0.1 mA, and 2^15 of 6.25 uA (NI 9205, range 0.2 V, 1 ohm)."""
    strip = ipmclab.load_actuator("friend-2-measured-displacement")
    run = ipmclab.simulate(strip, "step 1.2 V delay=2 s", duration=12.0, rate=50.0)
    assert run.current.max() > 0.21
    noise = 3.0 * step * np.random.default_rng(20261121).standard_normal(len(run))
    read = np.minimum(np.rint((run.current + noise) / step) * step, 0.2048)
    laser = 2.0 + 8.0 * (12.3e-3 + run.displacement) / 25e-3
    np.stack([run.time, read, laser, run.voltage], axis=1).astype("<f8").tofile(tmp_path / "exp1.bin")
    found = ipmclab.check(ipmclab.import_run(tmp_path / "exp1.bin", MAPS / "friend_displacement.toml"))
    (limit,) = (one for one in found if one.code in ("possible-range-limit", "clipped"))
    assert limit.channel == "current"
    assert limit.values.get("reading", limit.values.get("level")) == pytest.approx(0.2048)


def test_a_binary_cut_in_a_row_is_refused(record: dict[str, np.ndarray], tmp_path: Path) -> None:
    rows = np.stack([record["time"], record["current"], record["current"], record["voltage"]], axis=1)
    path = tmp_path / "exp1.bin"
    path.write_bytes(rows.astype("<f8").tobytes()[:-12])
    with pytest.raises(ipmclab.InputError, match=r"exp1\.bin"):
        ipmclab.import_run(path, MAPS / "friend_force.toml")


def write_csv(path: Path, record: dict[str, np.ndarray]) -> str:
    lines = ["t;U;I;x"]
    for t, u, i, x in zip(*(record[name] for name in ("time", "voltage", "current", "displacement")), strict=True):
        lines.append(";".join(f"{value:.15g}".replace(".", ",") for value in (t, u, 1e3 * i, 1e3 * x)))
    path.write_bytes(gzip.compress("\n".join(lines).encode("latin-1")))
    return 'format = "csv"\nseparator = ";"\ndecimal = ","\nencoding = "latin-1"'


def write_xlsx(path: Path, record: dict[str, np.ndarray]) -> str:
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["n1", "t", "n2", "U", "n3", "I", "n4", "x"])
    for k in range(ROWS):
        row: list[float] = []
        for name, factor in (("time", 1.0), ("voltage", 1.0), ("current", 1e3), ("displacement", 1e3)):
            row += [k, float(factor * record[name][k])]
        sheet.append(row)
    book.save(path)
    return 'format = "xlsx"'


def table(record: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {
        "t": record["time"],
        "U": record["voltage"],
        "I": 1e3 * record["current"],
        "x": 1e3 * record["displacement"],
    }


def write_mat_5(path: Path, record: dict[str, np.ndarray]) -> str:
    scipy.io.savemat(path, table(record))
    return 'format = "mat"'


def write_mat_7_3(path: Path, record: dict[str, np.ndarray]) -> str:
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in table(record).items():
            variable = file.create_dataset(name, data=values.reshape(-1, 1))
            variable.attrs["MATLAB_class"] = np.bytes_("double")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + b"\0" * 8 + b"\x00\x02IM"
    with path.open("r+b") as raw:
        raw.write(head)
    return 'format = "mat"'


def write_tdms(path: Path, record: dict[str, np.ndarray]) -> str:
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([nptdms.ChannelObject("log", name, values) for name, values in table(record).items()])
    return 'format = "tdms"'


def write_lvm(path: Path, record: dict[str, np.ndarray]) -> str:
    head = [
        "LabVIEW Measurement\t",
        "Writer_Version\t2",
        "Reader_Version\t2",
        "Separator\tTab",
        "Decimal_Separator\t.",
        "Multi_Headings\tNo",
        "X_Columns\tOne",
        "Time_Pref\tRelative",
        "***End_of_Header***\t",
        "\t",
        "Channels\t3",
        f"Samples\t{ROWS}\t{ROWS}\t{ROWS}",
        "X_Dimension\tTime\tTime\tTime",
        f"X0\t{0.0:.15E}\t{0.0:.15E}\t{0.0:.15E}",
        f"Delta_X\t{1 / RATE:.6f}\t{1 / RATE:.6f}\t{1 / RATE:.6f}",
        "***End_of_Header***\t\t\t",
        "X_Value\tU\tI\tx\tComment",
    ]
    columns = table(record)
    rows = [
        "\t".join(f"{columns[name][k]:.15g}" for name in ("t", "U", "I", "x")) + ("\t" if k else "\tby hand")
        for k in range(ROWS)
    ]
    path.write_bytes("\r\n".join([*head, *rows, ""]).encode())
    return 'format = "lvm"'


FORMATS: dict[str, tuple[str, Callable[[Path, dict[str, np.ndarray]], str]]] = {
    "csv.gz with semicolons and decimal commas": ("record.csv.gz", write_csv),
    "xlsx in pairs": ("record.xlsx", write_xlsx),
    "mat 5": ("record5.mat", write_mat_5),
    "mat 7.3": ("record73.mat", write_mat_7_3),
    "tdms": ("record.tdms", write_tdms),
    "lvm": ("record.lvm", write_lvm),
}


def import_map(kind: str, file_table: str) -> str:
    group = "log/" if kind == "tdms" else ""
    time = "X_Value" if kind == "lvm" else f"{group}t"
    channels = {"time": (time, "s"), "voltage": (f"{group}U", "V"), "current": (f"{group}I", "mA")}
    text = f'hold = "zero-before"\n[file]\n{file_table}\n'
    for name, (column, unit) in (channels | {"displacement": (f"{group}x", "mm")}).items():
        text += f'[channels.{name}]\ncolumn = "{column}"\nunit = "{unit}"\n'
        if kind == "xlsx in pairs":
            text += f'index = "n{1 + "tUIx".index(column)}"\n'
    return text


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_gives_the_same_run(kind: str, record: dict[str, np.ndarray], tmp_path: Path) -> None:
    name, write = FORMATS[kind]
    path, map_path = tmp_path / name, tmp_path / "map.toml"
    map_path.write_text(import_map(kind, write(path, record)), encoding="utf-8")
    run = ipmclab.import_run(path, map_path)
    for channel in ("time", "voltage", "current", "displacement"):
        np.testing.assert_allclose(getattr(run, channel), record[channel], rtol=1e-12, atol=1e-15)
    assert run.hold == "zero-before"
    assert run.metadata.source_file
    assert name in run.metadata.source_file


@pytest.mark.parametrize("kind", FORMATS)
def test_damaged_files_are_refused_by_name(kind: str, record: dict[str, np.ndarray], tmp_path: Path) -> None:
    name, write = FORMATS[kind]
    path, map_path = tmp_path / name, tmp_path / "map.toml"
    map_path.write_text(import_map(kind, write(path, record)), encoding="utf-8")
    whole = path.read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], b"\x00" * 300):
        path.write_bytes(damaged)
        with pytest.raises(ipmclab.InputError) as caught:
            ipmclab.import_run(path, map_path)
        assert name in str(caught.value), sys.exc_info()
