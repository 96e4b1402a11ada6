"""``ipmclab compare``: one document, a table for people, files."""

from __future__ import annotations

from pathlib import Path

import pytest

import ipmclab
from tests.cli.conftest import Command


@pytest.fixture
def steps(tmp_path: Path) -> list[str]:
    strip = ipmclab.load_actuator("friend-4-measured")
    names = []
    for volts in (1, 2, 3, 4):
        names.append(f"step-{volts}.nc")
        run = ipmclab.simulate(strip, f"step {volts} V", duration=10.0, rate=10.0)
        ipmclab.write_run(run, tmp_path / names[-1])
    return names


def test_one_document_and_every_file(command: Command, steps: list[str], tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    files = ("--out", "compare.html", "--data", "data", "--strip", "friend-4-measured")
    done = command("compare", *steps, "--by", "voltage,thickness", *files, "--json")
    assert (done.status, done.err) == (0, "")
    document = done.document
    assert [row["factors"]["voltage"] for row in document["runs"]] == [1.0, 2.0, 3.0, 4.0]
    assert {row["factor"] for row in document["effects"]} == {"voltage"}
    assert "displacement.strain" in document["runs"][0]["metrics"]
    assert document["performances"][0]["work_density"] > 0.0
    assert all(Path(name).stat().st_size > 0 for name in document["files"])
    assert (tmp_path / "data" / "runs.csv").exists()
    assert command("compare", *steps, "--out", "compare.html").status == 2


def test_the_posterior_goes_to_page_and_data_too(
    command: Command, steps: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "ipmclab.comparison.population.populations_of", lambda *_, **__: ({}, {"step: force": "one strip is too few"})
    )
    done = command("compare", *steps, "--metric", "force.largest", "--posterior", "--out", "c.html", "--json")
    assert done.document["populations"]["unknown"] == {"step: force": "one strip is too few"}
    page = (tmp_path / "c.html").read_text("utf-8")
    assert "step: force: nothing is known of the next strip: one strip is too few." in page
    assert "--metric force.largest --posterior</code>" in page


@pytest.mark.parametrize(("count", "told"), [(1, "1 of the runs has"), (7, "7 of the runs have")])
def test_runs_with_errors_are_counted_as_they_are_named(
    command: Command, tmp_path: Path, count: int, told: str
) -> None:
    clean = ipmclab.simulate(ipmclab.load_actuator("friend-2"), "step 1 V", duration=10.0, rate=10.0)
    names = [f"turned-{number}.nc" for number in range(count)]
    for number, name in enumerate(names):
        turned = ipmclab.Run.from_arrays(
            time=clean.time, voltage=clean.voltage, displacement=-(1.0 + 0.1 * number) * clean.displacement
        )
        ipmclab.write_run(turned, tmp_path / name)
    said = " ".join(command("compare", *names).err.split())
    assert f"{told} findings of severity error" in said
    assert (f"{names[4]} and 2 more; see" if count == 7 else f"nevertheless: {names[0]}; see") in said


def test_a_table_for_people(command: Command, steps: list[str], tmp_path: Path) -> None:
    (tmp_path / "broken.nc").write_bytes(b"no run")
    done = command("compare", *steps, "broken.nc", "--metric", "force.largest")
    assert done.status == 0
    assert "4 runs of 1 strip" in done.out
    assert "step: force, largest" in done.out
    assert "current" not in done.out
    assert "broken.nc is left out" in " ".join(done.err.split())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--by", "volts"), "by: unknown factor 'volts'; did you mean 'voltage'?"),
        (("--strip", "friend-2"), "--strip friend-2: the actuator names no sample"),
        (("--data", "nowhere"), "--data nowhere: there is no such folder"),
    ],
)
def test_bad_input(command: Command, steps: list[str], words: tuple[str, ...], message: str) -> None:
    done = command("compare", *steps, *words)
    assert done.status == 2
    assert message in done.err


def test_a_folder_is_every_run_below_it(command: Command, steps: list[str], tmp_path: Path) -> None:
    (tmp_path / "lab" / "deeper").mkdir(parents=True)
    for name, place in zip(steps, ("lab", "lab", "lab/deeper", "lab/deeper"), strict=True):
        (tmp_path / name).rename(tmp_path / place / name)
    document = command("compare", "lab", "--json").document
    assert [row["run"] for row in document["runs"]] == ["step-3.nc", "step-4.nc", "step-1.nc", "step-2.nc"]
    (tmp_path / "empty").mkdir()
    done = command("compare", "empty")
    assert (done.status, "there is no run file in this folder" in done.err) == (2, True)


def test_no_run_at_all(command: Command, tmp_path: Path) -> None:
    (tmp_path / "broken.nc").write_bytes(b"no run")
    done = command("compare", "broken.nc")
    assert done.status == 2
    assert "none of 1 files is a run" in done.err


def test_a_file_that_is_named_twice_is_one_run(command: Command, steps: list[str], tmp_path: Path) -> None:
    done = command("compare", steps[0], *steps, str(tmp_path), "--by", "voltage", "--json")
    assert len(done.document["runs"]) == len(steps)


def test_two_runs_are_shown_side_by_side_and_why_no_effect_is_told(command: Command, steps: list[str]) -> None:
    done = command("compare", *steps[:2])
    text = " ".join(done.out.split())
    assert "no effect: the runs differ in voltage" in text
    (row,) = [line for line in done.out.splitlines() if line.startswith("step: force, largest")]
    forces = [float(word) for word in row.split() if word[0].isdigit()]
    assert forces[1] == pytest.approx(2.0 * forces[0], rel=0.05)
    assert "metrics of each run" not in text
