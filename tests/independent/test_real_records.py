"""The real records through the documented import maps, and twins of them made here with the same faults."""

from __future__ import annotations

import gzip
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import ipmclab
from tests.independent.thesis import Strip, respond

MAPS = Path(__file__).resolve().parents[2] / "docs" / "import_maps"
PERIOD = 0.040  # s, the best estimate: the records do not say
SEED = 20261121

# The circuit that reproduces the 1 V record (two branches, 56.9 ohm of electrodes), on a strip of 25 x 5 x 0.5 mm.
LABORATORY = Strip(
    free_length=25e-3,
    clamped_length=5e-3,
    width=5e-3,
    thickness=0.5e-3,
    sensing_length=15e-3,
    electrode_resistance=28.45,
    dc_resistance=3319.0,
    resistivities=(10.2 * 0.3, 269.0 * 0.3),
    permittivities=(4.39e-3 / 0.3, 10.5e-3 / 0.3),
)


def findings(run: ipmclab.Run, channel: str | None, *words: str) -> list[ipmclab.Finding]:
    """Findings about a channel whose code or message has one of the words."""
    return [
        finding
        for finding in ipmclab.check(run)
        if (channel is None or finding.channel == channel)
        and any(word in f"{finding.code} {finding.message}".lower() for word in words)
    ]


def covers(finding: ipmclab.Finding, row: int) -> bool:
    return any(start <= row < stop for start, stop in finding.samples)


@cache
def record(real_runs: Path, name: str) -> ipmclab.Run:
    return ipmclab.import_run(real_runs / f"{name}.csv.gz", MAPS / f"{name}.toml")


def write_twin(
    path: Path, *, voltage: np.ndarray, current: np.ndarray, laser: np.ndarray, force: np.ndarray | None = None
) -> None:
    """A record as the platform's CSV has it: four digits after the point."""
    force = np.zeros(len(voltage)) if force is None else force
    rows = ["sample_index,current_A,voltage_V,force_N,laser_mm"]
    rows += [
        f"{k},{i:.4f},{v:.4f},{f:.4f},{x:.4f}"
        for k, (i, v, f, x) in enumerate(zip(current, voltage, force, laser, strict=True))
    ]
    with gzip.open(path, "wt", encoding="utf-8") as file:
        file.write("\n".join(rows) + "\n")


# ---------------------------------------------------------------- the records as they are


@pytest.mark.parametrize(
    ("name", "rows", "final"),
    [("step_1V", 19612, 0.988), ("step_2V", 51386, 1.975), ("step_2V_poor", 2716, 1.975), ("step_3V", 12004, 2.957)],
)
def test_every_record_imports_and_survives_its_file(
    name: str, rows: int, final: float, real_runs: Path, tmp_path: Path
) -> None:
    run = record(real_runs, name)
    assert len(run) == rows
    assert np.median(run.voltage[-1000:]) == pytest.approx(final, rel=5e-3)
    assert run.hold == "unknown"
    assert not run.metadata.sampling_period_known
    assert run.time[1] - run.time[0] == pytest.approx(PERIOD)
    assert run.current is not None
    assert np.max(np.abs(run.current)) < 0.1
    ipmclab.write_run(run, tmp_path / "run.nc")
    assert ipmclab.read_run(tmp_path / "run.nc").content_sha256 == run.content_sha256
    assert findings(run, None, "sampling", "period"), "the unknown sampling period is a finding"


def test_the_workbook_is_the_csv(real_runs: Path) -> None:
    maps = [path for path in MAPS.glob("*.toml") if "platform" in path.stem or "xlsx" in path.stem]
    assert maps, "no import map for platform_export_1V.xlsx"
    workbook = ipmclab.import_run(real_runs / "platform_export_1V.xlsx", maps[0])
    text = record(real_runs, "step_1V")
    assert len(workbook) == len(text)
    assert workbook.current is not None
    np.testing.assert_allclose(workbook.current, text.current, atol=1e-4)
    np.testing.assert_allclose(workbook.voltage, text.voltage, atol=1e-4)


def test_the_laser_lost_in_the_2_v_record(real_runs: Path) -> None:
    run = record(real_runs, "step_2V")
    lost = findings(run, "displacement", "laser", "lost", "sentinel")
    assert len(lost) == 1
    assert lost[0].samples[0][0] == 21_381
    assert lost[0].count == 29_946
    assert len(lost[0].samples) == 4
    assert lost[0].effect == "mask"
    # 29,943 sentinels, and three readings of -80.17 mm: 90.17 mm from the map's zero, counted towards the anode.
    assert lost[0].values["sentinel_count"] == 29_943
    assert lost[0].values["out_of_range_count"] == 3
    assert "90.17 mm" in lost[0].message
    assert run.displacement is not None
    assert np.isnan(run.displacement[21_381])
    assert not np.isnan(run.displacement[21_380])


def test_the_contact_missing_in_the_3_v_record(real_runs: Path) -> None:
    run = record(real_runs, "step_3V")
    contact = findings(run, "current", "contact-missing")
    assert len(contact) == 1
    assert contact[0].samples == ((560, 690),)
    assert contact[0].count == 130


@pytest.mark.parametrize(
    ("name", "leading"),
    [
        ("step_1V", {"current"}),
        ("step_2V", {"current", "displacement"}),
        ("step_2V_poor", {"current", "displacement"}),
        ("step_3V", set()),
    ],
)
def test_channels_that_lead_the_voltage_by_a_row(name: str, leading: set[str], real_runs: Path) -> None:
    skewed = findings(record(real_runs, name), None, "skew")
    channels = {finding.channel for finding in skewed}
    assert channels == leading
    for finding in skewed:
        assert "1 row" in finding.message or "one row" in finding.message or 1 in finding.values.values()


def test_the_inrush_of_the_2_v_record_is_kept(real_runs: Path) -> None:
    run = record(real_runs, "step_2V")
    assert run.current is not None
    assert run.current[515] == pytest.approx(49.9e-3, abs=1e-6)
    about = [finding for finding in ipmclab.check(run) if finding.channel == "current" and covers(finding, 515)]
    assert not any("spike" in finding.code for finding in about)
    assert any("range" in finding.code or "range" in finding.message for finding in about), about
    assert not any(finding.effect == "mask" and "range" in finding.code for finding in about)


@pytest.mark.parametrize("name", ["step_1V", "step_2V"])
def test_stale_repeats_are_found(name: str, real_runs: Path) -> None:
    stale = findings(record(real_runs, name), "current", "stale", "repeat")
    assert stale
    if name == "step_1V":
        assert covers(stale[0], 133), "0.0074 A stands in row 132 and again in row 133"


def test_the_current_of_the_1_v_record_is_a_two_branch_circuit(real_runs: Path, tmp_path: Path) -> None:
    run = record(real_runs, "step_1V")
    assert run.current is not None
    rows = slice(134, 1634)
    cut = ipmclab.Run.from_arrays(
        time=run.time[rows], voltage=run.voltage[rows], current=run.current[rows], hold="unknown"
    )
    assert two_branch_rmse(cut, tmp_path) <= 0.33e-3


def two_branch_rmse(cut: ipmclab.Run, folder: Path) -> float:
    """Error of the best two-branch circuit behind free electrodes, computed without the package."""
    path = folder / "laboratory.toml"
    path.write_text(LABORATORY.changed(resistivities=(30.0, 30.0)).toml("laboratory"), encoding="utf-8")
    found = ipmclab.identify(ipmclab.load_actuator(path), [cut], free=["electrical", "circuit.sheet_resistance"])
    score = ipmclab.validate(found.actuator, [cut]).scores["current"]
    assert found.noise[0]["current"] == pytest.approx(score.rmse, rel=0.02), "fit and validation read one record alike"
    return float(score.rmse)


# ---------------------------------------------------------------- twins, made here


def laboratory_step(rows: int, first: int, final: float) -> tuple[np.ndarray, np.ndarray]:
    """Voltage and clean current of a step at a row, at 25 S/s."""
    voltage = np.where(np.arange(rows) >= first, final, 0.0)
    return voltage, respond(LABORATORY, voltage, 1.0 / PERIOD, "zero")["current"]


def test_twin_of_the_lost_laser_and_the_skew(tmp_path: Path) -> None:
    generator = np.random.default_rng(SEED)
    rows, first = 6000, 516
    voltage, _ = laboratory_step(rows, first, 1.975)
    _, current = laboratory_step(rows, first - 1, 1.975)  # current and laser lead the voltage channel by a row
    current = current + 0.3e-3 * generator.standard_normal(rows)
    laser = 10.0 - 3.0 * (1.0 - np.exp(-(np.arange(rows) - first + 2).clip(0) / 90.0))
    laser += 2e-4 * generator.standard_normal(rows)
    lost = np.zeros(rows, dtype=bool)
    lost[3000:3040] = lost[3100:3101] = lost[3200:] = True
    laser[lost] = -99.9999
    path = tmp_path / "step_2V.csv.gz"
    write_twin(path, voltage=voltage + 2e-4 * generator.standard_normal(rows), current=current, laser=laser)
    run = ipmclab.import_run(path, MAPS / "step_2V.toml")
    finding = findings(run, "displacement", "laser", "lost", "sentinel")
    assert len(finding) == 1
    assert finding[0].samples == ((3000, 3040), (3100, 3101), (3200, 6000))
    assert finding[0].count == int(np.sum(lost))
    assert {finding.channel for finding in findings(run, None, "skew")} == {"current", "displacement"}


def test_twin_of_the_missing_contact(tmp_path: Path) -> None:
    generator = np.random.default_rng(SEED)
    rows, first, late = 4000, 560, 690
    voltage, _ = laboratory_step(rows, first, 2.957)
    _, current = laboratory_step(rows, late, 2.957)
    current = current + 1e-3 * generator.standard_normal(rows)
    laser = 8.0 - 2.0 * (1.0 - np.exp(-(np.arange(rows) - late).clip(0) / 60.0))
    laser += 2e-4 * generator.standard_normal(rows)
    path = tmp_path / "step_3V.csv.gz"
    write_twin(path, voltage=voltage + 2e-4 * generator.standard_normal(rows), current=current, laser=laser)
    run = ipmclab.import_run(path, MAPS / "step_3V.toml")
    contact = findings(run, "current", "contact-missing")
    assert len(contact) == 1
    assert contact[0].samples == ((first, late),)
    # And a record whose contact holds has no such finding.
    _, good = laboratory_step(rows, first, 2.957)
    good_path = tmp_path / "good.csv.gz"
    laser = 8.0 - 2.0 * (1.0 - np.exp(-(np.arange(rows) - first).clip(0) / 60.0))
    write_twin(good_path, voltage=voltage, current=good + 1e-3 * generator.standard_normal(rows), laser=laser)
    assert not findings(ipmclab.import_run(good_path, MAPS / "step_3V.toml"), "current", "contact-missing")


def test_twin_of_the_one_volt_fit(tmp_path: Path) -> None:
    generator = np.random.default_rng(SEED)
    voltage, current = laboratory_step(1800, 133, 0.988)
    noise = 0.3e-3
    measured = np.round(current + noise * generator.standard_normal(1800), 4)
    measured[132:134] = 7.4e-3
    cut = ipmclab.Run.from_arrays(
        time=np.arange(1500) * PERIOD,
        voltage=np.round(voltage[134:1634], 4),
        current=measured[134:1634],
        hold="unknown",
    )
    assert two_branch_rmse(cut, tmp_path) <= 1.03 * noise


def test_a_wrong_map_is_named(real_runs: Path, tmp_path: Path) -> None:
    text = (MAPS / "step_1V.toml").read_text(encoding="utf-8")
    for old, new, word in (
        ('column = "current_A"', 'column = "curent_A"', "current_A"),
        ('unit = "A"', 'unit = "mV"', "mV"),
        ('sampling_period = "0.040 s"', 'sampling_period = "0.040 V"', "sampling_period"),
        ("sentinels", "sentinells", "sentinels"),
    ):
        assert old in text
        path = tmp_path / "map.toml"
        path.write_text(text.replace(old, new), encoding="utf-8")
        with pytest.raises(ipmclab.InputError) as caught:
            ipmclab.import_run(real_runs / "step_1V.csv.gz", path)
        assert word in str(caught.value)
