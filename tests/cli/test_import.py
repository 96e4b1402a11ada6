"""What ``import`` prints of the record that it has read."""

from __future__ import annotations

from pathlib import Path

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
    assert "Beside lost readings the displacement has 1 reading far out of the others (-80 mm)" in text
    assert "No reading of" not in text


def test_sentinels_that_met_nothing_are_said(command, tmp_path: Path) -> None:
    write(tmp_path, "-99,9999")  # a decimal comma makes two numbers of one
    done = command("import", "record.csv", "--map", "map.toml", "--out", "run.nc")
    assert "No reading of the displacement is -99 or 9999: see sentinels in the map." in " ".join(done.out.split())
    document = command("import", "record.csv", "--map", "map.toml", "--out", "run.nc", "--force", "--json").document
    assert document["channels"]["displacement"]["sentinels"] == 0
    assert document["channels"]["displacement"]["missing"] == 1
    assert document["period"]["unit"] == "s"
