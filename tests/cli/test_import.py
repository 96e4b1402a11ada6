"""What ``import`` prints of the record that it has read."""

from __future__ import annotations

from pathlib import Path

import pytest

MAP = """
[file]
format = "csv"

[channels.time]
column = "t (s)"

[channels.voltage]
column = "U (V)"

[channels.displacement]
column = "laser (mm)"
sentinels = [{sentinels}]
"""


def write(folder: Path, sentinels: str) -> None:
    """A laser that is lost for two rows of 500, reads nothing in one, and shows 80 mm beside the lost ones."""
    laser: list[float | str] = [k / 1000 for k in range(500)]
    laser[30:33] = [-99.9999, -99.9999, -80.0]
    laser[40] = ""
    rows = "".join(f"{k / 50},{int(k > 5)},{reading}\n" for k, reading in enumerate(laser))
    (folder / "record.csv").write_text("t (s),U (V),laser (mm)\n" + rows, encoding="utf-8")
    (folder / "map.toml").write_text(MAP.format(sentinels=sentinels), encoding="utf-8")


def test_the_table_has_the_period_and_counts_what_was_not_read(command, tmp_path: Path) -> None:
    write(tmp_path, "-99.9999")
    done = command("import", "record.csv", "--map", "map.toml", "--out", "run.nc")
    assert done.status == 0
    lines = done.out.splitlines()
    assert lines[0].endswith("0.02 s between rows, 500 rows, 10 s in all")
    assert lines[1].split() == ["channel", "lowest", "highest", "sentinels", "missing"]
    assert lines[3].split() == ["displacement", "-80", "mm", "0.499", "mm", "2", "1"]
    text = " ".join(done.out.split())
    assert "Next to lost readings, the displacement has 1 reading far from the others (-80 mm)" in text
    assert "No reading of" not in text


@pytest.mark.parametrize(
    ("words", "answer", "told"),
    [
        (("--map", "map.toml", "--out", "run.nc"), "sampling_period=10 ms", "write it into the map"),
        (("--out", "run.nc"), "channels.voltage.unit=mV", "the file says that itself"),
        (("--out", "run.nc"), "sampling_perod=10 ms", "no such question"),
        (("--template", "new.toml"), "sampling_period=10 ms", "leave it out"),
    ],
)
def test_an_answer_that_nothing_asks_for_is_refused(command, tmp_path: Path, words, answer: str, told: str) -> None:
    """It would count for nothing: the run would be another than who answers thinks."""
    write(tmp_path, "-99.9999")
    refused = command("import", "record.csv", *words, "--answer", answer)
    assert (refused.status, told in refused.err) == (2, True), refused.err
    assert not any((tmp_path / name).exists() for name in ("run.nc", "run.map.toml", "new.toml"))


def test_a_file_of_ours_asks_nothing(command, tmp_path: Path) -> None:
    write(tmp_path, "-99.9999")
    command("import", "record.csv", "--out", "run.nc")
    command("export", "run.nc", "--out", "ours.csv")
    refused = command("import", "ours.csv", "--out", "again.nc", "--answer", "sampling_period=10 ms")
    assert (refused.status, "nothing is asked" in refused.err) == (2, True)
    assert command("import", "ours.csv", "--out", "again.nc").status == 0


def test_sentinels_that_met_nothing_are_said(command, tmp_path: Path) -> None:
    write(tmp_path, "-99,9999")  # a decimal comma makes two numbers of one
    done = command("import", "record.csv", "--map", "map.toml", "--out", "run.nc")
    assert "No reading of the displacement is -99 or 9999: see sentinels in the map." in " ".join(done.out.split())
    document = command("import", "record.csv", "--map", "map.toml", "--out", "run.nc", "--force", "--json").document
    assert document["channels"]["displacement"]["sentinels"] == 0
    assert document["channels"]["displacement"]["missing"] == 1
    assert document["period"]["unit"] == "s"


TABLE = "Zeit;Spannung [V];Strom [mA];Laser [mm]\n" + "".join(
    f"{20 * k};{int(k > 5)},0;{k},5;{k / 100:.2f}\n".replace(".", ",") for k in range(50)
)


def test_without_a_map_one_is_guessed_shown_and_written(command, tmp_path: Path) -> None:
    (tmp_path / "record.csv").write_text(TABLE.replace("Zeit;", "Zeit [ms];"), encoding="utf-8")
    done = command("import", "record.csv", "--out", "run.nc")
    assert done.status == 0, done.err
    assert "time: column 'Zeit [ms]', ms" in done.out
    assert "columns separated by ';', decimal comma" in done.out
    assert "0.02 s between rows, 50 rows" in done.out
    assert command("import", "record.csv", "--map", "run.map.toml", "--out", "again.nc").status == 0
    refused = command("import", "record.csv", "--out", "third.nc", "--map", "third.toml")
    assert refused.status == 2


def test_what_cannot_be_known_is_asked_and_answered(command, tmp_path: Path) -> None:
    (tmp_path / "record.csv").write_text(TABLE, encoding="utf-8")
    asked = command("import", "record.csv", "--out", "run.nc")
    assert asked.status == 2
    assert "channels.time.unit: in which unit is the time 'Zeit'? It steps by 20 (s, ms," in " ".join(asked.err.split())
    assert not (tmp_path / "run.nc").exists()
    done = command("import", "record.csv", "--out", "run.nc", "--answer", "channels.time.unit=ms")
    assert done.status == 0, done.err
    wrong = command("import", "record.csv", "--out", "b.nc", "--answer", "channels.time.unit=mV")
    assert wrong.status == 2
    assert "'mV' is not one of" in wrong.err


def test_a_template_has_what_is_seen_and_what_is_asked(command, tmp_path: Path) -> None:
    (tmp_path / "record.csv").write_text(TABLE, encoding="utf-8")
    document = command("import", "record.csv", "--template", "map.toml", "--json").document
    assert [question["key"] for question in document["questions"]] == ["channels.time.unit"]
    text = (tmp_path / "map.toml").read_text(encoding="utf-8")
    text = text.replace('column = "Zeit"', 'column = "Zeit"\nunit = "ms"')
    (tmp_path / "map.toml").write_text(text, encoding="utf-8")
    assert command("import", "record.csv", "--map", "map.toml", "--out", "run.nc").status == 0


def test_patterns_of_files_are_expanded(command, tmp_path: Path) -> None:
    """A shell of Windows hands ``*.nc`` on as it is."""
    (tmp_path / "record.csv").write_text(TABLE.replace("Zeit;", "Zeit [ms];"), encoding="utf-8")
    for name in ("b.nc", "a.nc"):
        assert command("import", "record.csv", "--out", name).status == 0
    document = command("check", "*.nc", "--json").document
    assert [Path(run["run"]).name for run in document["runs"]] == ["a.nc", "b.nc"]
