"""Bad input: exit status 2 and one message that says what, where and what to do; never a traceback."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import h5netcdf
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab.cli.app import run
from ipmclab.run import Run
from ipmclab.store.run_file import write_run

ACTUATOR = """
name = "strip"
[geometry]
free_length = "25 mm"
clamped_length = "5 mm"
width = "5 mm"
thickness = "0.245 mm"
sensing_length = "21 mm"
[circuit]
sheet_resistance = "1.3333333333333333 ohm"
dc_resistivity = "43.42040816326531 ohm m"
[[circuit.branches]]
resistivity = "0.35734 ohm m"
permittivity = "0.11998 F/m"
[coupling]
gain = "6.79e-9 m/V/s"
zero = "210.5 1/s"
p1 = "15.897 1/s"
p2 = "41.097 1/s^2"
[beam]
density = "3965 kg/m^3"
modulus = "1.45 GPa"
"""


MAP = """[file]
format = "csv"

[channels.time]
column = "time"
unit = "s"

[channels.voltage]
column = "voltage"
unit = "V"

[channels.current]
column = "current"
unit = "A"
"""


def simulate(**changed: str) -> list[str]:
    options = {"signal": "step 1 V", "duration": "1 s", "rate": "50 Hz", "out": "out.nc"} | changed
    actuator = options.pop("actuator", "friend-2")
    return ["simulate", actuator, *(word for name, value in options.items() for word in (f"--{name}", value))]


def expect(done, status: int, *parts: str) -> None:
    assert done.status == status, done
    assert done.out == ""
    assert done.err.startswith("error: ")
    assert done.err.count("\n") == 1
    assert "Traceback" not in done.err
    for part in parts:
        assert part in done.err


@pytest.fixture(autouse=True)
def files(made: Path, tmp_path: Path) -> None:
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    time = np.arange(100) * 0.02
    rng = np.random.default_rng(20261121)
    step = Run.from_arrays(time=time, voltage=np.ones(100), current=0.01 + 1e-4 * rng.standard_normal(100))
    write_run(step, folder / "step.nc")
    (folder / "empty.nc").touch()
    (folder / "cut.nc").write_bytes((folder / "step.nc").read_bytes()[:5000])
    (folder / "text.nc").write_text("hello", encoding="utf-8")
    (folder / "folder.nc").mkdir()
    (folder / "record.csv").write_text("time,voltage,current\n0,0,0\n0.02,1,0.06\n0.04,1,0.05\n", encoding="utf-8")
    rows = "\n".join(f"{second},0.5" for second in range(201))
    (folder / "long.csv").write_text(f"time [s],voltage [V]\n{rows}\n", encoding="utf-8")
    with h5netcdf.File(folder / "other.nc", "w") as file:
        file.dimensions = {"x": 3}
        file.create_variable("sea_level", ("x",), data=np.arange(3.0))
    return folder


@pytest.mark.parametrize(
    ("changed", "parts"),
    [
        # wrong units
        ({"duration": "40"}, ("--duration", "'40'", "no unit", "40 s")),
        ({"duration": "40 mm"}, ("--duration", "'mm'")),
        ({"rate": "50 s"}, ("--rate", "Hz")),
        ({"duration": "1,5 s"}, ("--duration", "comma", "1.5 s")),
        ({"signal": "step 1 A"}, ("signal", "A", "V")),
        ({"signal": "sine 1 V 0.1 s"}, ("signal", "Hz")),
        # negative numbers reach our own message
        ({"rate": "-50 Hz"}, ("--rate", "'-50 Hz'", "above 0")),
        ({"duration": "-5"}, ("--duration", "'-5'", "above 0")),
        ({"duration": "0 s"}, ("--duration", "above 0")),
        ({"rate": "nan Hz"}, ("--rate", "'nan Hz'")),
        ({"duration": "1e999 s"}, ("--duration", "too large")),
        # unknown names, with the nearest
        ({"signal": "stp 1 V"}, ("signal", "stp", "step")),
        ({"signal": ""}, ("signal",)),
        ({"hold": "zeroth"}, ("--hold", "'zeroth'", "did you mean 'zero'")),
        ({"actuator": "freind-2"}, ("freind-2", "did you mean 'friend-2'")),
        ({"actuator": "nowhere.toml"}, ("nowhere.toml",)),
        ({"actuator": "folder.nc"}, ("folder.nc",)),
        # a signal that does not fit its record
        ({"signal": "step 1 V for 2 s then step 0.5 V for 3 s"}, ("signal", "5 s", "1 s")),
        ({"signal": "file long.csv"}, ("long.csv", "200 s", "1 s")),
        ({"signal": "step 1 V delay=2 s"}, ("signal", "2 s", "1 s")),
        ({"signal": "file nowhere.csv"}, ("nowhere.csv",)),
        # where the output goes
        ({"out": "step.nc"}, ("step.nc", "exists", "--force")),
        ({"out": "missing/out.nc"}, ("missing", "does not exist")),
        ({"out": "folder.nc"}, ("folder.nc", "folder")),
        ({"out": "out.csv"}, ("out.csv", ".nc")),
        # rows
        ({"duration": "1 ms", "rate": "1 Hz"}, ("row",)),
    ],
)
def test_simulate_refuses(command, tmp_path: Path, changed: dict[str, str], parts: tuple[str, ...]) -> None:
    before = sorted(path.name for path in tmp_path.iterdir())
    expect(command(*simulate(**changed)), 2, *parts)
    assert sorted(path.name for path in tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ('width = "5 mm"', 'width = "-5 mm"', ("geometry.width", "-0.005 m")),
        ('width = "5 mm"', 'width = "5 V"', ("geometry.width", "'V'")),
        ('width = "5 mm"', "width = 5", ("geometry.width",)),
        ('width = "5 mm"', 'width = "nan mm"', ("geometry.width",)),
        ('width = "5 mm"', 'widht = "5 mm"', ("widht", "did you mean 'geometry.width'")),
        ('width = "5 mm"', "", ("geometry.width", "missing")),
        ("[beam]", "[beem]", ("beem", "beam")),
        ('name = "strip"', 'name = "strip', ("strip.toml",)),
        ('name = "strip"', "name = 'str\xefp'", ("strip.toml", "utf-8")),
    ],
)
def test_an_actuator_file_is_read_strictly(command, tmp_path: Path, old: str, new: str, parts) -> None:
    assert old in ACTUATOR
    (tmp_path / "strip.toml").write_bytes(ACTUATOR.replace(old, new).encode("latin-1"))
    expect(command(*simulate(actuator="strip.toml")), 2, *parts)


@pytest.mark.parametrize(
    ("file", "parts"),
    [
        ("missing.nc", ("missing.nc", "no such file")),
        ("empty.nc", ("empty.nc", "empty")),
        ("cut.nc", ("cut.nc", "truncated")),
        ("text.nc", ("text.nc",)),
        ("folder.nc", ("folder.nc", "folder")),
        ("other.nc", ("other.nc", "no run", "sea_level")),
        ("record.csv", ("record.csv", "ipmclab import")),
    ],
)
@pytest.mark.parametrize(
    "words",
    [
        ("check",),
        ("export", "--out", "out.csv"),
        ("plot", "--out", "out.svg"),
        ("identify", "--free", "electrical", "--out", "out.toml", "friend-2"),
        ("validate", "friend-2"),
    ],
    ids=lambda words: words[0],
)
def test_a_file_that_is_no_run_is_named(command, words: tuple[str, ...], file: str, parts: tuple[str, ...]) -> None:
    expect(command(*words, file), 2, *parts)


def test_a_run_in_which_nothing_can_be_scored_gets_a_reason_and_no_empty_table(command, tmp_path: Path) -> None:
    run = Run.from_arrays(time=[0.0, 1.0, 2.0], voltage=[0.0, 1.0, 1.0], current=[np.nan] * 3)
    write_run(run, tmp_path / "silent.nc")
    assert command("validate", "friend-2", "silent.nc").out == (
        "No score of current in silent.nc: no usable sample of this output.\n"
        "friend-2:\nNothing could be scored in 1 run that was not given to its fit.\n"
    )


def test_a_foreign_record_gets_the_command_that_imports_it(command, tmp_path: Path) -> None:
    expect(command("check", "record.csv"), 2, "ipmclab import record.csv --out record.nc")
    (tmp_path / "my record.csv").write_text("1,2")
    told = command("check", "my record.csv").err  # as a terminal takes it
    assert "import 'my record.csv' --out 'my record.nc'" in told.replace('"', "'")


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        ("time,voltage,current\n0,0,0\n0.02,1,nan\n0.02,1,0.05\n", ("time", "line 4", "that of the row before")),
        ("time,voltage,current\n0,0,0\n0.04,1,0\n0.02,1,0.05\n", ("time", "line 4", "not after")),
        ("time,voltage,current\n0,0,0\n0.02,nan,0\n0.04,1,0.05\n", ("voltage", "NaN")),
        ("time,voltage\n0,0\n0.02,1\n", ("current",)),
        ("", ("record.csv", "empty")),
        ("time,voltage,current\n", ("record.csv",)),
        ("time,voltage,current\n0,0,zero\n0.02,1,1\n", ("zero",)),
    ],
)
def test_a_foreign_record_that_cannot_be_used(command, tmp_path: Path, content: str, parts: tuple[str, ...]) -> None:
    (tmp_path / "record.csv").write_text(content, encoding="utf-8")
    (tmp_path / "map.toml").write_text(MAP, encoding="utf-8")
    expect(command("import", "record.csv", "--map", "map.toml", "--out", "out.nc"), 2, *parts)


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("identify", "friend-2", "step.nc", "--free", "electricl", "--out", "o.toml"), ("electricl", "electrical")),
        (("identify", "friend-2", "step.nc", "--free", "coupling.gian", "--out", "o.toml"), ("coupling.gain",)),
        (("identify", "friend-2", "step.nc", "--free", ",", "--out", "o.toml"), ("nothing is free", "electrical")),
        (
            (
                "identify",
                "friend-2",
                "step.nc",
                "--free",
                "electrical",
                "--per-run",
                "circuit.cntact",
                "--out",
                "o.toml",
            ),
            ("circuit.cntact",),
        ),
        (("identify", "friend-2", "step.nc", "--free", "electrical", "--out", "o.nc"), ("o.nc", ".toml")),
        (("check", "step.nc", "--fail-on", "warn"), ("--fail-on", "'warn'", "warning")),
        ((*simulate(signal="step"), "1", "V"), ("(1 V); put a text or a path that has blanks in quotes",)),
        (("plot", "step.nc", "--out", "plot.gif"), ("plot.gif", ".svg")),
        (("export", "step.nc", "--out", "step.docx"), ("step.docx", ".csv or .xlsx or .mat")),
        (
            ("export", "strip.toml", "--out", "o.csv"),
            ("an actuator; write for example: ipmclab export strip.toml",),
        ),
        (("export", "friend-2", "--out", "o.m"), ("ipmclab export friend-2 --to matlab --out strip.m",)),
        (("export", "step.nc", "--to", "matlab", "--out", "o.m"), ("a run; ", "ipmclab export step.nc --out step.csv")),
        (("export", ".", "--out", "o.csv"), ("this is a folder; write for example: ipmclab export . --to ro-crate",)),
        (("export", "step.nc", "--to", "crate", "--out", "o.zip"), ("did you mean 'ro-crate'?",)),
        (("export", "step", "--out", "o.csv"), ("step: no such file",)),
        (("export", "freind-2", "--to", "matlab", "--out", "o.m"), ("did you mean 'friend-2'",)),
        (("report", "step.nc", "--runs", "step.nc", "--out", "r.html"), ("step.nc",)),
        (("report", "strip.toml", "--runs", "step.nc", "--out", "r.html"), ("strip.toml", "[fit]")),
        (("report", "friend-2", "--runs", "step.nc", "--out", "r.html"), ("friend-2", "[fit]")),
        (("validate", "friend-2", "step.nc", "--also", "freind-2"), ("freind-2", "did you mean 'friend-2'")),
        (("plot", "strip.toml", "--out", "p.svg"), ("this is an actuator, not a run",)),
        (("check", "step.nc", "freind-2"), ("did you mean 'friend-2'",)),
        (("check", "no.toml"), ("no.toml",)),
        (("check", "map.toml"), ("this is an import map, not a run", "ipmclab import RECORD --map map.toml")),
        (("check", "note.toml"), ("this is a TOML file, not a run", "ends in .nc")),
        (
            ("validate", "step.nc", "strip.toml"),
            ("step.nc: this is a run, not an actuator", "the actuator comes first"),
        ),
        (
            ("identify", "step.nc", "strip.toml", "--free", "electrical", "--out", "o.toml"),
            ("step.nc: this is a run, not an actuator", "the actuator comes first, then the runs"),
        ),
        (("validate", "folder.nc", "step.nc"), ("folder.nc: this is a folder, not an actuator",)),
        (("import", "record.csv", "--map", "nomap.toml", "--out", "o.nc"), ("nomap.toml",)),
        (("import", "nofile.csv", "--map", "strip.toml", "--out", "o.nc"), ()),
    ],
)
def test_other_verbs_refuse(command, tmp_path: Path, words: tuple[str, ...], parts: tuple[str, ...]) -> None:
    (tmp_path / "strip.toml").write_text(ACTUATOR, encoding="utf-8")
    (tmp_path / "map.toml").write_text(MAP, encoding="utf-8")
    (tmp_path / "note.toml").write_text("note = 1", encoding="utf-8")
    expect(command(*words), 2, *parts)


def test_more_unknowns_than_data(command, tmp_path: Path) -> None:
    write_run(
        Run.from_arrays(time=[0.0, 0.02, 0.04], voltage=[1.0, 1.0, 1.0], current=[0.06, 0.05, 0.04]),
        tmp_path / "short.nc",
    )
    done = command("identify", "friend-2", "short.nc", "--free", "electrical", "--out", "o.toml")
    expect(done, 2, "5 unknowns", "3 usable readings")


def test_a_file_that_may_not_be_read(command, tmp_path: Path) -> None:
    if os.name == "nt" or os.geteuid() == 0:
        pytest.skip("this user may read every file")
    (tmp_path / "step.nc").chmod(0)
    expect(command("check", "step.nc"), 2, "step.nc")


@pytest.mark.skipif(os.name == "nt", reason="a folder of Windows has no such bits")
def test_a_folder_that_lets_nobody_write_is_told_before_the_work(command, tmp_path: Path, monkeypatch) -> None:
    """A fit of minutes was made first, and was lost."""
    (tmp_path / "closed").mkdir(mode=0o555)
    if os.geteuid() == 0:  # who may write everywhere: the bits speak in place of the system
        monkeypatch.setattr("os.access", lambda path, mode: bool(os.stat(path).st_mode & 0o200))
    command(*simulate(out="step.nc"))
    monkeypatch.setattr("ipmclab.workflows.fitting.fit_of_runs", None)
    done = command("identify", "friend-2", "step.nc", "--free", "electrical", "--out", "closed/fit.toml")
    expect(done, 2, "you may not write in the folder 'closed'", "write elsewhere")
    expect(command("export", "friend-2", "--to", "matlab", "--out", "closed/strip.m"), 2, "you may not write")


def test_force_replaces_what_is_there(command) -> None:
    assert command(*simulate(out="step.nc"), "--force").status == 0


def test_every_failure_is_a_document_with_json(command) -> None:
    done = command(*simulate(rate="-50 Hz"), "--json")
    error = done.document["error"]
    assert set(error) == {"code", "message", "where", "repair"}
    assert (done.status, error["where"]) == (2, "--rate")
    assert error["message"] in done.err


WORDS = st.sampled_from(
    (
        *("step", "sine", "cosine", "square", "chirp", "multisine", "prbs", "random", "file", "samples", "then", "for"),
        *("1", "-1", "V", "mV", "Hz", "s", "phase=90", "deg", "delay=1", "1e9", "nan", ",", "="),
    )
)


@given(text=st.one_of(st.text(max_size=40), st.lists(WORDS, max_size=8).map(" ".join)))
def test_any_text_as_a_signal_gives_a_run_or_one_message(text: str, tmp_path: Path, capsys) -> None:
    capsys.readouterr()
    words = ["simulate", "friend-2", f"--signal={text}", "--duration", "0.1 s", "--rate", "50 Hz", "--json"]
    status = run([*words, "--out", str(tmp_path / "any.nc"), "--force"])
    captured = capsys.readouterr()
    document = json.loads(captured.out)
    assert status in (0, 2)
    assert ("error" in document) == (status == 2)
    assert captured.err.count("\n") == (status == 2)
