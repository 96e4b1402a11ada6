"""``ipmclab runs``: questions to the catalogue, and the life of a sample."""

from __future__ import annotations

import shutil
import uuid
from datetime import datetime, timedelta
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from ipmclab.run import Run, RunMetadata
from ipmclab.sample import Sample
from ipmclab.store.run_file import read_run, write_run

START = datetime(2026, 11, 18, 9, 6).astimezone()  # as the time line shows it, wherever this runs


@pytest.fixture(autouse=True)
def no_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("IPMCLAB_CATALOGUE", raising=False)


def record(
    path: Path, *, minutes: float | None, signal: str = "step 0 V for 2 s then step 1 V for 5 s", **metadata
) -> None:
    """A run of 9 s that begins so many minutes after START: a strip of 10 ohm and 10 ohm parallel to 20 mF."""
    path.parent.mkdir(parents=True, exist_ok=True)
    time = np.arange(450) / 50.0
    on = (time >= 2.0) & (time < 7.0)
    peak = 0.1 / metadata.pop("resistance", 10.0)
    current = np.where(on, peak * (0.5 + 0.5 * np.exp(-(time - 2.0) / 0.5)), 0.0)
    current += np.random.default_rng(20261121).normal(0.0, 1e-6, len(time))
    if metadata.pop("spike", False):
        current[300] += 0.01
    sample = metadata.pop("sample", "strip-1")
    run = Run.from_arrays(
        time=time,
        voltage=np.where(on, 0.1, 0.0),
        current=current,
        hold="zero-before",
        metadata=RunMetadata(
            sample=Sample(sample),
            signal=signal,
            recorded_at=None if minutes is None else (START + timedelta(minutes=minutes)).isoformat(),
            uuid=metadata.pop("uuid", str(uuid.uuid4())),
            **metadata,
        ),
    )
    write_run(run, path)


@pytest.fixture
def lab(recorded: Path, tmp_path: Path) -> Path:
    """A copy of the folder for each test."""
    return Path(shutil.copytree(recorded, tmp_path / "lab"))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two mountings of strip-1 on one day, one run of strip-2 two days later, a damaged file."""
    folder = tmp_path_factory.mktemp("recorded")
    first, second = {"mounting_id": "m1"}, {"mounting_id": "m2"}
    fingerprint = {"purpose": "fingerprint", "signal": "step 0 V for 2 s then step 0.1 V for 5 s", "state": "complete"}
    record(folder / "1.nc", minutes=6.0, minutes_out_of_water=6.0, **first, **fingerprint)
    record(folder / "2.nc", minutes=8.0, minutes_out_of_water=8.0, **first, purpose="signal", state="complete")
    record(folder / "3.nc", minutes=66.0, minutes_out_of_water=66.0, **first, **fingerprint, resistance=11.0)
    record(folder / "4.nc", minutes=190.0, minutes_out_of_water=10.0, **second, **fingerprint, resistance=12.0)
    record(
        folder / "5.nc",
        minutes=195.0,
        minutes_out_of_water=15.0,
        **second,
        signal="step 0 V for 2 s then sine -1 V 0.1 Hz for 5 s",
        state="aborted",
        relative_humidity=80.0,
        spike=True,
    )
    record(folder / "6.nc", minutes=2 * 1440.0, sample="strip-2", relative_humidity=40.0)
    (folder / "7.nc").write_bytes((folder / "6.nc").read_bytes()[:2000])
    return folder


def files(document) -> list[str]:
    return [Path(one["file"]).name for one in document["runs"]]


def test_a_table_of_everything(command, lab: Path) -> None:
    told = command("runs", lab)
    assert told.status == 0
    lines = told.out.splitlines()
    assert lines[0].split() == [
        "recorded",
        "sample",
        "signal",
        "measured",
        "length",
        "humidity",
        "state",
        "findings",
        "file",
    ]
    assert lines[1].startswith("2026-11-18 09:12:00  strip-1  fingerprint: step 0.1 V  current   9 s")
    assert lines[1].endswith("1.nc")
    assert "sine -1 V 0.1 Hz" in lines[5]
    assert "aborted" in lines[5]
    assert "spike" in lines[5]
    assert lines[-1] == "6 runs"
    assert "problem: 7.nc: the file is truncated" in told.err


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((), "123456"),
        (("--signal", "step"), "12346"),
        (("--signal", "dc"), "12346"),
        (("--signal", "sine"), "5"),
        (("--amplitude", "0.9 V..1.1 V"), "26"),
        (("--amplitude", "-1 V"), "5"),
        (("--amplitude", "..0 V"), "5"),
        (("--frequency", "0.05 Hz..1 Hz"), "5"),
        (("--humidity", "78 percent..82 percent"), "5"),
        (("--humidity", "..50 percent"), "6"),
        (("--measured", "current"), "123456"),
        (("--measured", "force"), ""),
        (("--since", "2026-11-19"), "6"),
        (("--until", "2026-11-18"), "12345"),
        (("--since", "2026-11-18 12:00", "--until", "2026-11-18 12:18"), "4"),
        (("--finding", "spike"), "5"),
        (("--finding", "spike", "--sample", "strip-2"), ""),
        (("--state", "aborted"), "5"),
        (("--state", "missing"), ""),
        (("--purpose", "fingerprint"), "134"),
        (("--sample", "strip-2", "--signal", "step"), "6"),
    ],
)
def test_questions(command, lab: Path, words: tuple[str, ...], expected: str) -> None:
    told = command("runs", lab, *words, "--json")
    assert told.status == 0
    assert files(told.document) == [f"{digit}.nc" for digit in expected]
    assert [problem["path"] for problem in told.document["problems"]] == ["7.nc"]


def test_one_document(command, lab: Path) -> None:
    document = command("runs", lab, "--state", "aborted", "--json").document
    assert document["files"] == {"there": 7, "added": 7, "changed": 0, "gone": 0, "not_runs": 0}
    assert document["catalogue"] == str(lab / "catalogue.db")
    (row,) = document["runs"]
    assert row["amplitude"] == {"value": -1.0, "unit": "V"}
    assert row["relative_humidity"] == {"value": 80.0, "unit": "percent"}
    assert row["signal"] == "step 0 V for 2 s then sine -1 V 0.1 Hz for 5 s"
    assert row["drive"] == "sine -1 V 0.1 Hz"
    assert row["duration"] == {"value": pytest.approx(9.0), "unit": "s"}
    assert command("runs", lab, "--json").document["files"]["added"] == 0


def test_the_life_of_a_sample(command, lab: Path, tmp_path: Path) -> None:
    told = command("runs", lab, "--sample", "strip-1", "--out", "life.svg")
    assert told.status == 0
    lines = told.out.splitlines()
    assert lines[0] == "strip-1: 5 runs (1 ended early), 2 mountings, driven for 45 s, 2026-11-18"
    assert lines[1] == "series resistance: 10 ohm at first, 12 ohm at last (+20 %)"
    assert lines[2].startswith("capacitance: ")
    assert lines[2].endswith("(-17 %)")
    told_events = [line[12:].split("  ")[:2] for line in lines[5:-1]]
    assert [(time, what.strip()) for time, what, *_ in told_events if what] == [
        ("09:06:00", "taken out of the water"),
        ("09:12:00", "clamped: mounting 1, m1"),
        ("12:06:00", "taken out of the water"),
        ("12:16:00", "clamped: mounting 2, m2"),
    ]
    assert sum("fingerprint: step 0.1 V" in line for line in lines) == 3
    assert "11 ohm" in next(line for line in lines if line[12:].startswith("10:12:00"))
    drawn = "".join(ElementTree.parse(tmp_path / "life.svg").getroot().itertext())
    for shown in (
        "life of strip-1",
        "series resistance (Ω)",
        "capacitance (mF)",
        "out of the water (min)",
        "mounting 1",
    ):
        assert shown in drawn

    document = command("runs", lab, "--sample", "strip-1", "--json").document
    assert document["mountings"] == ["m1", "m2"]
    kinds = [event["kind"] for event in document["events"]]
    assert kinds == ["out of water", "clamped", "run", "run", "run", "out of water", "clamped", "run", "run"]
    recorded = [read_run(lab / f"{number}.nc").metadata.uuid for number in range(1, 6)]
    assert [event["run"] for event in document["events"] if event["kind"] == "run"] == recorded
    # The charge beyond the steady current: 5 mA that fade with 0.5 s, summed in steps of 20 ms.
    farads = 5e-3 * 0.02 / (1.0 - np.exp(-0.02 / 0.5)) / 0.1
    changes = document["changes"]
    assert changes["capacitance"]["first"]["value"] == pytest.approx(farads, rel=5e-3)
    assert changes["capacitance"]["last"]["value"] == pytest.approx(farads / 1.2, rel=5e-3)
    assert changes["series_resistance"]["last"]["value"] == pytest.approx(12.0, rel=1e-3)
    assert len(document["runs"]) == 5


def test_a_sample_without_dates(command, tmp_path: Path) -> None:
    record(tmp_path / "a.nc", minutes=None)
    assert files(command("runs", "--json").document) == ["a.nc"]
    assert "no date" in command("runs", "--sample", "strip-1").out
    refused = command("runs", "--sample", "strip-1", "--out", "life.svg")
    assert refused.status == 2
    assert "when it was recorded" in refused.err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--signal", "sien"), "did you mean 'sine'?"),
        (("--signal", "sine 1 V"), "write --signal sine, and the rest as --amplitude"),
        (("--amplitude", "1"), "has no unit"),
        (("--humidity", "80 percent"), "give a range"),
        (("--measured", "forse"), "did you mean 'force'?"),
        (("--since", "yesterday"), "write for example 2026-11-21"),
        (("--since", "2026-11-21", "--until", "2026-11-20"), "ends (2026-11-20) before it begins (2026-11-21)"),
        (("--state", "done"), "known: 'recording'"),
        (("--purpose", "fun"), "known: 'signal'"),
        (("--sample", "strip-3"), "did you mean 'strip-1' or 'strip-2'?"),
        (("--out", "life.svg"), "give --sample ID alone"),
        (("--sample", "strip-1", "--out", "life.txt"), "must end in .svg"),
        (("--catalogue", "mysql://host/x"), "postgresql://USER@HOST/NAME"),
    ],
)
def test_bad_questions(command, lab: Path, words: tuple[str, ...], says: str) -> None:
    told = command("runs", lab, *words, "--json")
    assert told.status == 2
    assert says in told.err
    assert "error" in told.document


def test_a_folder_that_is_not_there_or_has_nothing(command, tmp_path: Path) -> None:
    assert command("runs", "nowhere").status == 2
    told = command("runs")
    assert (told.status, told.out) == (0, f"no runs in {tmp_path}\n")
    assert list(tmp_path.iterdir()) == []  # a look leaves nothing behind


def test_the_folder_of_the_experiment_file_is_found(command, tmp_path: Path) -> None:
    (tmp_path / "runs" / "recording").mkdir(parents=True)
    record(tmp_path / "runs" / "runs" / "a.nc", minutes=0.0)
    assert files(command("runs", "--json").document) == ["a.nc"]


def test_a_damaged_catalogue_and_its_rebuild(command, lab: Path) -> None:
    assert command("runs", lab).status == 0
    (lab / "catalogue.db").write_bytes(b"no database " * 1000)
    told = command("runs", lab, "--json")
    assert told.status == 1
    assert told.document["error"]["code"] == "catalogue-broken"
    assert "--rebuild" in told.err
    assert files(command("runs", lab, "--rebuild", "--json").document) == [f"{k}.nc" for k in range(1, 7)]


def test_an_unknown_code_is_told_with_those_that_are_there(command, lab: Path) -> None:
    told = command("runs", lab, "--finding", "spikes")
    assert told.status == 0
    assert "no runs" in told.out
    assert "findings here: " in told.out
    assert "spike" in told.out


def test_a_catalogue_of_a_group(command, lab: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    record(other / "far.nc", minutes=0.0, sample="strip-9")
    group = tmp_path / "group.db"
    assert len(command("runs", lab, "--catalogue", group, "--json").document["runs"]) == 6
    assert files(command("runs", other, "--catalogue", group, "--json").document) == ["far.nc"]
    everything = command("runs", "--catalogue", group, "--json").document
    assert len(everything["runs"]) == 7
    assert everything["files"] is None  # nothing was looked at
    assert not (lab / "catalogue.db").exists()


def test_a_name_that_would_move_the_cursor_is_shown_plainly(command, tmp_path: Path) -> None:
    record(tmp_path / "a.nc", minutes=0.0, sample="\x1b[2J strip")
    told = command("runs")
    assert "\x1b" not in told.out
