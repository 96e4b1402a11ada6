"""No option replaces a file that the same command reads, not even with --force."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Run, RunMetadata, Sample, load_actuator, write_actuator, write_run
from ipmclab.cli.app import VERBS
from ipmclab.cli.options import SpreadCommand
from tests.cli.conftest import Command, Outcome

PROCEDURE = """name = "strip"
[geometry]
free_length = "25 mm"
clamped_length = "5 mm"
width = "5 mm"
thickness = "0.245 mm"
sensing_length = "21 mm"
[dc_resistance]
runs = ["run.nc"]
[modulus]
run = "push.nc"
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

ELECTRICAL = ("--free", "circuit.dc_resistivity")
SAMPLED = ("--signal", "step 1 V", "--duration", "1 s", "--rate", "50 Hz")
PLAYED = ("--signal", "step 1 V for 1 s then file record.csv", "--duration", "1.05 s", "--rate", "50 Hz")
STAGE = "strip.toml+leak.cubic"

OUTPUTS = [
    # The words of a command without the output, the option that names the output, and a file that the command reads.
    (("identify", "friend-2", "run.nc", *ELECTRICAL), "--out", "run.nc"),
    (("identify", "strip.toml", "run.nc", *ELECTRICAL), "--out", "strip.toml"),
    (("identify", STAGE, "run.nc", *ELECTRICAL), "--out", "strip.toml"),
    (("posterior", "friend-2", "run.nc", *ELECTRICAL), "--out", "run.nc"),
    (("posterior", "strip.toml", "run.nc", *ELECTRICAL), "--out", "strip.toml"),
    (("posterior", "strip.toml", "run.nc", *ELECTRICAL, "--out", "samples.nc"), "--figure", "run.nc"),
    (("choose", "run.nc", "--actuator", "strip.toml", "--models", "branches=1,2"), "--out", "strip.toml"),
    (("choose", "run.nc", "--models", f"friend-2,{STAGE}"), "--out", "strip.toml"),
    (("choose", "run.nc", "--models", "friend-2"), "--report", "run.nc"),
    (("choose", "run.nc", "--models", "friend-2"), "--plot", "run.nc"),
    (("compare", "run.nc", "push.nc"), "--out", "push.nc"),
    (("compare", "run.nc", "--strip", "strip.toml"), "--out", "strip.toml"),
    (("report", "fitted.toml", "--runs", "run.nc"), "--out", "fitted.toml"),
    (("report", "fitted.toml", "--runs", "run.nc"), "--out", "run.nc"),
    (("report", "fitted.toml", "--runs", "run.nc", "--validation", "push.nc"), "--out", "push.nc"),
    (("sweep", "p.toml"), "--out", "p.toml"),
    (("sweep", "p.toml", "--out", "results"), "--plot", "p.toml"),
    (("simulate", "strip.toml", *SAMPLED), "--out", "strip.toml"),
    (("simulate", "friend-2", *PLAYED), "--out", "record.csv"),
    (("import", "record.csv", "--map", "map.toml"), "--out", "record.csv"),
    (("import", "record.csv", "--map", "map.toml"), "--out", "map.toml"),
    (("export", "run.nc"), "--out", "run.nc"),
    (("plot", "run.nc", "push.nc"), "--out", "push.nc"),
    (("plot", "run.nc", "--before", "strip.toml", "--after", "friend-2"), "--out", "strip.toml"),
    (("smooth", "run.nc", "--below", "5 Hz"), "--out", "run.nc"),
    (("procedure", "p.toml"), "--out", "p.toml"),
    (("procedure", "p.toml"), "--out", "run.nc"),
    (("procedure", "p.toml"), "--out", "push.nc"),
    (("runs", ".", "--sample", "strip-1"), "--out", "run.nc"),
    (("runs", ".", "--sample", "strip-1"), "--out", "catalogue.db"),
]

SUFFIXES = {
    "identify": ".toml",
    "posterior": ".nc",
    "choose": ".toml",
    "report": ".html",
    "simulate": ".nc",
    "sweep": ".toml",
    "compare": ".html",
    "smooth": ".nc",
}
SUFFIXES |= {"import": ".nc", "export": ".csv", "plot": ".svg", "procedure": ".toml", "runs": ".svg"}
SUFFIXES |= {"--figure": ".svg", "--report": ".html", "--plot": ".svg"}


@pytest.fixture
def files(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path, dirs_exist_ok=True))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made")
    time = np.arange(100) * 0.02
    noise = 1e-4 * np.random.default_rng(20261122).standard_normal(100)
    about = RunMetadata(sample=Sample(id="strip-1"), starts_from_rest=True)
    for name, current in (("run", 0.01 + noise), ("push", noise)):
        run = Run.from_arrays(time=time, voltage=np.ones(100), current=current, force=noise, displacement=noise)
        write_run(Run.from_arrays(**{**run.channels, "time": time}, metadata=about), folder / f"{name}.nc")
    write_actuator(load_actuator("friend-2"), folder / "strip.toml")
    write_actuator(load_actuator("friend-2"), folder / "fitted.toml")
    (folder / "record.csv").write_text("time,voltage,current\n0,0,0\n0.02,1,0.06\n0.04,1,0.05\n", encoding="utf-8")
    (folder / "map.toml").write_text(MAP, encoding="utf-8")
    (folder / "p.toml").write_text(PROCEDURE, encoding="utf-8")
    return folder


def refused(done: Outcome, option: str, output: Path, victim: Path, content: bytes) -> None:
    assert done.status == 2, done
    assert (done.document["error"]["code"], done.document["error"]["where"]) == (
        "output-is-input",
        f"{option} {output}",
    )
    assert victim.read_bytes() == content


def named(words: tuple[str, ...], option: str, victim: Path) -> Path:
    """The victim under a name that such an output may have: its own, or that of a link to it."""
    suffix = SUFFIXES[words[0] if option == "--out" else option]
    if victim.suffix == suffix:
        return Path(victim.name)
    link = Path(f"link{suffix}")
    try:
        link.symlink_to(victim.name)
    except OSError:
        pytest.skip("this user may not make links")
    return link


@pytest.mark.parametrize(("words", "option", "read"), OUTPUTS, ids=lambda one: one if isinstance(one, str) else one[0])
def test_an_output_that_is_an_input_is_refused(
    command: Command, files: Path, words: tuple[str, ...], option: str, read: str
) -> None:
    victim = files / read
    if read == "catalogue.db":
        assert command("runs", ".").status == 0
    content = victim.read_bytes()
    output = named(words, option, victim)
    done = command(*words, option, output, "--force", "--json")
    if read == "catalogue.db":  # it may note when it looked
        assert victim.read_bytes().startswith(b"SQLite format 3")
        content = victim.read_bytes()
    refused(done, option, output, victim, content)


@pytest.mark.parametrize("spelling", ["absolute", "dotted", "through a folder", "hard link", "link to a link"])
def test_however_the_file_is_spelled(command: Command, files: Path, spelling: str) -> None:
    victim, content = files / "run.nc", (files / "run.nc").read_bytes()
    (files / "folder").mkdir()
    output = {
        "absolute": victim,
        "dotted": Path("./run.nc"),
        "through a folder": Path("folder/../run.nc"),
        "hard link": Path("other.nc"),
        "link to a link": Path("second.nc"),
    }[spelling]
    try:
        if spelling == "hard link":
            os.link(victim, output)
        elif spelling == "link to a link":
            Path("first.nc").symlink_to(victim)
            output.symlink_to("first.nc")
    except OSError:
        pytest.skip("this user may not make links")
    words = ("posterior", "friend-2", "run.nc", *ELECTRICAL, "--out", output, "--force", "--json")
    refused(command(*words), "--out", output, victim, content)


def test_no_option_that_names_an_output_is_left_out() -> None:
    """Every verb with --force stands above with each of its options that name a file to write."""
    import typer

    from ipmclab.cli.app import app

    tried = {(words[0], option) for words, option, _ in OUTPUTS}
    group = typer.main.get_command(app)
    for verb in VERBS:
        command = group.get_command(typer.Context(group), verb)  # type: ignore[attr-defined]
        parameters = command.params
        assert isinstance(command, SpreadCommand)
        if "--force" not in {option for one in parameters for option in one.opts}:
            continue
        writes = {one.opts[0] for one in parameters if (one.help or "").rstrip(".").startswith("Write a")}  # type: ignore[attr-defined]
        assert {(verb, option) for option in {"--out", *writes} - {"--template"}} <= tried
