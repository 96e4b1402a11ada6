"""``ipmclab sweep`` as its user runs it, also one that kills it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ipmclab import read_sweep, run_sweep
from ipmclab.sweep.template import TEMPLATE

LONG = TEMPLATE.replace("base = 512", "base = 256").replace("\n[design]", "\nsets_per_file = 64\n[design]")
FILES = 256 * 5 // 64


def test_from_the_template_to_sobol_indices(command, tmp_path: Path) -> None:
    assert "[design]" in command("sweep", "--template").out
    assert command("sweep", "--template", "--out", "mine.toml").status == 0
    done = command("sweep", "mine.toml", "--out", "stiffness", "--json")
    assert done.status == 0
    document = done.document
    assert (document["sets"], document["files"], document["files_found"]) == (2560, 1, 0)
    first = document["sobol_indices"]["current.rms"]["circuit.dc_resistivity"]
    assert first["first_interval"][0] <= first["first"] <= first["first_interval"][1]
    assert first["first"] == pytest.approx(1.0, abs=0.05)  # neither beam nor coupling changes the current
    again = command("sweep", "mine.toml", "--out", "stiffness")
    assert again.status == 0
    assert "1 of 1 files were there already" in again.out
    assert "Sobol indices of displacement.peak" in again.out
    (row,) = [line.split() for line in again.out.splitlines() if line.startswith("displacement.peak ")]
    largest = document["metrics"]["displacement.peak"]["largest"]  # [m]: it was printed without a unit
    assert (float(row[3]), row[-1]) == (pytest.approx(1e3 * largest, rel=1e-4), "mm")


def test_workers_give_the_same_files_and_a_figure_shows_them(command, tmp_path: Path) -> None:
    text = TEMPLATE.replace('kind = "saltelli"', 'kind = "morris"').replace("base = 512", "base = 20")
    (tmp_path / "m.toml").write_text(text, encoding="utf-8")
    assert command("sweep", "m.toml", "--out", "here").status == 0
    done = command("sweep", "m.toml", "--out", "there", "--workers", "2", "--plot", "m.svg", "--json")
    assert (done.status, done.document["sets"], done.document["plot"]) == (0, 80, "m.svg")
    part = "part-00000000.parquet"
    assert (tmp_path / "there" / part).read_bytes() == (tmp_path / "here" / part).read_bytes()
    effects = done.document["morris_effects"]["force.rms"]
    assert effects["beam.modulus"]["magnitude"] > effects["circuit.dc_resistivity"]["magnitude"]
    drawn = (tmp_path / "m.svg").read_text(encoding="utf-8")
    assert all(words in drawn for words in ("coupling.gain", "magnitude", "force, rms [mN]"))
    told = command("sweep", "m.toml", "--out", "there", "--plot", "m.svg")
    assert (told.status, "m.svg" in told.err) == (2, True)  # it is there already
    assert "Morris's effects on force.rms along each range, in mN" in command("sweep", "m.toml", "--out", "there").out
    for words in (("--workers", "0"), ("--workers", "2", "--scheduler", "tcp://127.0.0.1:1")):
        assert command("sweep", "m.toml", "--out", "more", *words).status == 2


def test_sets_without_a_reading_are_counted(command, tmp_path: Path) -> None:
    begin = TEMPLATE[: TEMPLATE.index("[design]")]
    for before, after in (
        ('"friend-2" ', '"friend-2+laser" '),
        ("force.rms", "displacement.final"),
        ("sine", "cosine"),
    ):
        begin = begin.replace(before, after)
    (tmp_path / "far.toml").write_text(f'table = "far.csv"\n{begin}')
    (tmp_path / "far.csv").write_text("laser.range [mm]\n12\n0.001\n0.001\n")
    done = command("sweep", "far.toml", "--out", "far")
    assert "displacement.final: 2 of 3 sets have no reading" in done.out
    assert "displacement.peak: " not in done.out


def test_what_is_missing_is_said(command) -> None:
    assert "there is no sweep" in command("sweep").err
    assert command("sweep", "none.toml", "--out", "x").status == 2
    assert command("sweep", "--template", "--out", "mine.toml").status == 0
    assert "there is no folder for the results" in command("sweep", "mine.toml").err
    assert "exists already" in command("sweep", "--template", "--out", "mine.toml").err
    assert "this is a folder; name a file in it" in command("sweep", "--template", "--out", "").err
    assert "did you mean 'gpu'" in command("sweep", "mine.toml", "--out", "x", "--device", "gpo").err
    assert "it reads no sweep" in command("sweep", "mine.toml", "--template").err
    assert command("sweep", "--template", "--json").document == {"template": TEMPLATE, "out": None}


HELD = """
import sys
from contextlib import contextmanager

from ipmclab.cli.app import run
from ipmclab.sweep import parts

count, moment, words = int(sys.argv[1]), sys.argv[2], sys.argv[3:]
replacing, written = parts.replacing, 0


def wait_to_be_killed(now):
    if (written, now) == (count, moment):
        print("here", flush=True)
        sys.stdin.read()


@contextmanager
def held(path, **more):
    global written
    with replacing(path, **more) as temporary:
        yield temporary
        written += path.name.startswith("part-")
        wait_to_be_killed("within")
    wait_to_be_killed("behind")


parts.replacing = held
sys.exit(run(words))
"""
"""The command, which says so and waits behind one of its files, or within it, when it is not in its place yet."""


def test_killed_behind_a_file_and_within_one_it_goes_on_with_nothing_twice_and_nothing_missing(tmp_path: Path) -> None:
    """Each time it goes on behind what was complete."""
    path, folder = tmp_path / "long.toml", tmp_path / "out"
    path.write_text(LONG, encoding="utf-8")
    before = 0
    for further, moment, complete in ((1, "behind", 1), (9, "within", 8)):
        words = [sys.executable, "-c", HELD, str(further), moment, "sweep", str(path), "--out", str(folder)]
        pipe = subprocess.PIPE
        with subprocess.Popen(words, stdin=pipe, stdout=pipe, stderr=pipe) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            assert process.stdout.readline().strip() == b"here", process.stderr.read().decode()
            process.kill()
        assert len(list(folder.glob("part-*.parquet"))) == before + complete
        assert bool(list(folder.glob(".part-*.part"))) == (moment == "within")
        before += complete
    assert before < FILES
    swept = run_sweep(read_sweep(path), folder)
    assert swept.found == before
    expected = run_sweep(read_sweep(path), tmp_path / "at once").columns("set", "displacement.peak", "beam.modulus")
    found = swept.columns("set", "displacement.peak", "beam.modulus")
    assert np.array_equal(found["set"], np.arange(64 * FILES))
    for name, values in expected.items():
        assert np.array_equal(found[name], values)
