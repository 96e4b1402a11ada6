"""The known faults of four real records, and of twins with the same faults that are made here."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab.quality import check, check_together, measure, usable
from ipmclab.run import Finding, Run, RunMetadata
from ipmclab.store.importing import import_run

MAPS = Path(__file__).parents[2] / "docs" / "import_maps"
NAMES = ("step_1V", "step_2V", "step_2V_poor", "step_3V")


def imported(folder: Path, name: str) -> Run:
    return import_run(folder / f"{name}.csv.gz", MAPS / f"{name}.toml")


def as_it_is(folder: Path, name: str) -> Run:
    """The record with its sentinels in it, as a careless reader takes it."""
    with gzip.open(folder / f"{name}.csv.gz", "rt", encoding="ascii") as file:
        index, current, voltage, force, laser = np.loadtxt(file, delimiter=",", skiprows=1).T
    return Run.from_arrays(
        time=0.040 * index,
        voltage=voltage,
        current=current,
        force=force,
        displacement=1e-3 * laser,
        hold="unknown",
        metadata=RunMetadata(sampling_period_known=False),
    )


def by_code(run: Run, channel: str | None = None) -> dict[str, Finding]:
    return {finding.code: finding for finding in check(run) if channel is None or finding.channel == channel}


def the_lost_laser(run: Run, first: int, sentinels: int) -> None:
    finding = by_code(run)["laser-lost"]
    assert finding.values["first_row"] == first
    assert finding.values["count"] == sentinels + 3
    assert finding.values["sentinel_count"] == sentinels
    assert finding.values["out_of_range_count"] == 3
    assert finding.values["blocks"] == 4
    assert np.count_nonzero(~usable(run, [finding])["displacement"]) == sentinels + 3


@pytest.mark.parametrize("read_record", [imported, as_it_is])
def test_step_2v_lost_laser(real_runs: Path, read_record: Callable[[Path, str], Run]) -> None:
    the_lost_laser(read_record(real_runs, "step_2V"), 21381, 29943)


def test_step_2v_current(real_runs: Path) -> None:
    run = imported(real_runs, "step_2V")
    found = by_code(run, "current")
    assert found["possible-range-limit"].samples == ((515, 516),)
    assert found["possible-range-limit"].effect == "none"
    assert "49.9 mA" in found["possible-range-limit"].message
    assert "spike" not in found
    assert found["channel-skew"].values["lead_rows"] == 1
    assert found["stale-values"].values["fraction"] == pytest.approx(0.21, abs=0.02)
    assert usable(run, found.values())["current"].all()


@pytest.mark.parametrize(
    ("name", "leads"),
    [("step_1V", {"current"}), ("step_2V", {"current", "displacement"}), ("step_2V_poor", {"current", "displacement"})],
)
def test_channels_that_lead_the_voltage_by_a_row(real_runs: Path, name: str, leads: set[str]) -> None:
    skewed = [finding for finding in check(imported(real_runs, name)) if finding.code == "channel-skew"]
    assert {finding.channel for finding in skewed} == leads
    assert {finding.values["lead_rows"] for finding in skewed} == {1}


def test_step_1v_edge_rows_and_open_contact(real_runs: Path) -> None:
    run = imported(real_runs, "step_1V")
    found = by_code(run, "current")
    assert found["edge-reading-partial"].samples == ((132, 134),)
    assert np.flatnonzero(~usable(run, check(run))["current"]).tolist() == [132, 133]
    ((start, stop),) = found["contact-lost"].samples
    assert stop == 677  # 0.1 mA in row 676, 3.9 mA in row 677, at a voltage of 0.988 V throughout
    assert 480 <= start <= 500
    assert run.current is not None
    assert abs(run.current[start:stop].mean()) < 2e-4


def test_the_smooth_top_of_the_first_minute_is_not_cut(real_runs: Path) -> None:
    """Five readings of 3.33548 mm in the rows 832 to 837, which the laser comes to and leaves by single steps."""
    run = imported(real_runs, "step_2V")
    arrays = {name: values[:1500] for name, values in run.channels.items() if len(values) == len(run)}
    first = Run.from_arrays(time=run.time[:1500], hold=run.hold, metadata=run.metadata, **arrays)
    assert first.displacement is not None
    assert np.flatnonzero(first.displacement == first.displacement.max()).tolist() == [832, 833, 835, 836, 837]
    assert "clipped" not in by_code(first)


def test_step_3v_contact_and_rising_current(real_runs: Path) -> None:
    run = imported(real_runs, "step_3V")
    found = by_code(run)
    assert found["contact-missing"].severity == "error"
    assert found["contact-missing"].samples == ((560, 690),)
    assert found["contact-missing"].values["count"] == 130
    rising = found["current-rises"].values
    assert rising["low"] == pytest.approx(13.8e-3, abs=1e-3)
    assert isinstance(rising["high"], float)
    assert rising["high"] > 20.6e-3
    assert "channel-skew" not in found
    for mask in usable(run, found.values()).values():
        assert not mask[560:690].any()


@pytest.mark.parametrize("name", NAMES)
def test_what_every_record_shares(real_runs: Path, name: str) -> None:
    found = by_code(imported(real_runs, name))
    assert "sampling-period-unknown" in found
    assert found["noise-only"].channel == "force"
    assert "stale-values" in by_code(imported(real_runs, name), "current")
    assert "response-opposite" not in found


def test_the_poor_run_shows_a_changed_state(real_runs: Path) -> None:
    runs = [imported(real_runs, "step_2V"), imported(real_runs, "step_2V_poor")]
    changed = {finding.channel: finding for finding in check_together(runs)}
    assert {finding.code for finding in changed.values()} == {"state-changed"}
    ratio = changed["displacement"].values["ratio"]
    assert isinstance(ratio, float)
    assert ratio < 0.2


@pytest.mark.parametrize(
    ("name", "peak", "rows"), [("step_1V", 1.27e-3, 162), ("step_2V", 3.34e-3, 316), ("step_2V_poor", 0.43e-3, 54)]
)
def test_the_first_bending_peak(real_runs: Path, name: str, peak: float, rows: int) -> None:
    found = {metric.name: metric for metric in measure(imported(real_runs, name)) if metric.channel == "displacement"}
    assert found["peak_at_first_edge"].value == pytest.approx(peak, rel=0.03)
    assert found["time_to_peak"].value == pytest.approx(0.040 * rows, abs=0.040 * 5)
    if name == "step_1V":  # it relaxes through zero, to -6.5 mm
        assert found["back_relaxation"].value > 1.0
        assert found["largest"].value == pytest.approx(-6.5e-3, rel=0.02)


# -- twins


def laboratory(read: Callable[..., Run], *, rows: int = 6000, edge: int = 516, noise: float = 1.0) -> Run:
    """A step as that laboratory records it: 25 rows per second, four digits after the point, in A and mm."""
    run = read(f"step 2 V delay={edge / 25} s", duration=rows / 25, rate=25.0, noise=0.1, round_off=False)
    assert run.current is not None
    bend = 3.0 * (1.0 - np.exp(-np.maximum(run.time - edge / 25 + 0.04, 0.0) / 3.0))
    laser = 10.0 + np.where(run.voltage > 0.0, bend, 0.0) + np.random.default_rng(20261121).normal(0.0, 3e-4, rows)
    glitches = noise * np.random.default_rng(20261121 + edge).normal(0.0, 3e-4, rows)
    force = np.where(np.random.default_rng(20261121).random(rows) < 0.2, 1e-4, 0.0)
    return Run.from_arrays(
        time=run.time,
        voltage=run.voltage.round(4),
        current=(0.3 * run.current + glitches).round(4),
        displacement=1e-3 * laser.round(4),
        force=force,
        hold="unknown",
        metadata=RunMetadata(sampling_period_known=False),
    )


def led_by_a_row(run: Run, *channels: str) -> Run:
    return replace(run, **{name: np.append(getattr(run, name)[1:], getattr(run, name)[-1]) for name in channels})


def with_stale_values(run: Run, fraction: float) -> Run:
    assert run.current is not None
    rows = np.arange(len(run))
    fresh = np.random.default_rng(20261121).random(len(run)) >= fraction
    fresh[510:525] = True
    return replace(run, current=run.current[np.maximum.accumulate(np.where(fresh, rows, 0))])


def test_twin_of_the_lost_laser(read: Callable[..., Run]) -> None:
    run = laboratory(read)
    assert run.displacement is not None
    laser = run.displacement.copy()
    for start, stop in ((2000, 2040), (2089, 2090), (2091, 2096), (2105, 6000)):
        laser[start:stop] = -0.0999999
    laser[[2095, 2105, 2106]] = [-0.0801682, -0.0801688, -0.0801686]
    the_lost_laser(replace(run, displacement=laser), 2000, 40 + 1 + 5 + 3895 - 3)


def test_twin_of_the_skewed_and_stale_channels(read: Callable[..., Run]) -> None:
    run = with_stale_values(led_by_a_row(laboratory(read), "current", "displacement"), 0.22)
    assert run.current is not None
    peak = run.current.copy()
    peak[515] = 0.0499
    findings = check(replace(run, current=peak))
    assert {(finding.code, finding.channel) for finding in findings if finding.severity != "info"} == {
        ("sampling-period-unknown", None),
        ("channel-skew", "current"),
        ("channel-skew", "displacement"),
        ("stale-values", "current"),
        ("possible-range-limit", "current"),
        ("noise-only", "force"),
    }


def test_twin_of_the_edge_rows_and_the_open_contact(read: Callable[..., Run]) -> None:
    run = led_by_a_row(laboratory(read), "current")
    later = laboratory(read, edge=1100)
    assert run.current is not None
    assert later.current is not None
    current = run.current.copy()
    current[516] = current[515]
    current[514:516] = 0.44 * current[516]
    current[900:1100] = later.current[900:1100]
    current[1100:] = later.current[1100:] * 0.3 + current[1100:]
    found = by_code(replace(run, current=current), "current")
    assert found["contact-lost"].samples[0][1] == 1100
    assert abs(found["contact-lost"].samples[0][0] - 900) <= 4
    assert found["edge-reading-partial"].samples == ((514, 516),)
    assert found["channel-skew"].values["lead_rows"] == 2


def test_twin_of_the_missing_contact_and_the_rising_current(read: Callable[..., Run]) -> None:
    run, contact = laboratory(read), laboratory(read, edge=516 + 130)
    rise = (7e-3 * (1 - np.exp(-np.maximum(run.time - 80.0, 0.0) / 60.0))).round(4)
    assert contact.current is not None
    run = replace(run, current=contact.current + rise, displacement=contact.displacement)
    found = by_code(run)
    assert found["contact-missing"].samples == ((516, 646),)
    assert "contact-lost" not in found
    assert "contact-changed" not in found
    rising = found["current-rises"].values
    assert isinstance(rising["low"], float)
    assert isinstance(rising["high"], float)
    assert rising["high"] - rising["low"] == pytest.approx(6e-3, abs=1e-3)


def test_twin_of_the_changed_state(read: Callable[..., Run]) -> None:
    good, poor = laboratory(read), laboratory(read, edge=420, rows=2716)
    assert poor.current is not None
    assert poor.displacement is not None
    same = {finding.code for finding in check_together([good, poor])}
    assert same == {"state-unchanged"}
    weak = replace(poor, current=0.37 * poor.current, displacement=0.13 * poor.displacement)
    changed = {finding.channel: finding for finding in check_together([good, weak])}
    assert {finding.code for finding in changed.values()} == {"state-changed"}
    assert changed["current"].values["ratio"] == pytest.approx(0.37, abs=0.01)
    assert changed["displacement"].values["ratio"] == pytest.approx(0.13, abs=0.01)
