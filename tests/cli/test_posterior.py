"""``ipmclab posterior`` as its user runs it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ipmclab import Run, RunMetadata, load_actuator, simulate, write_actuator, write_run
from ipmclab.posterior import convergence
from ipmclab.posterior.packages import bayes_package


@pytest.fixture
def run(command, tmp_path: Path) -> str:
    words = ("--signal", "step 1 V", "--duration", "5 s", "--rate", "20 Hz", "--out", "step.nc")
    assert command("simulate", "friend-2", *words).status == 0
    return "step.nc"


def test_it_writes_samples_and_says_how_the_chains_did(command, run: str, tmp_path: Path) -> None:
    known = {"circuit.sheet_resistance": 0.02, "circuit.dc_resistivity": 2.0}
    write_actuator(replace(load_actuator("friend-2"), standard_uncertainties=known), tmp_path / "strip.toml")
    done = command(
        *("posterior", "strip.toml", run, "--free", "circuit.dc_resistivity"),
        *("--prior", "circuit.dc_resistivity", "--out", "posterior.nc", "--figure", "pairs.svg"),
    )
    assert done.status == 0
    assert done.err == ""
    rows = {line.split()[0]: line for line in done.out.splitlines() if line.startswith("circuit.")}
    assert "with its prior" in rows["circuit.dc_resistivity"]
    # A fixed parameter of this strip whose uncertainty is stated, and which the readings feel.
    assert "fixed, as uncertain as stated" in rows["circuit.sheet_resistance"]
    assert "The chains agree after" in done.out
    data = bayes_package("arviz").from_netcdf(tmp_path / "posterior.nc")
    assert set(rows) == set(data.posterior.data_vars)
    assert (tmp_path / "pairs.svg").read_text("utf-8").count("<svg") == 1


def test_mountings_are_told_as_in_identify(command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same finding, and the interval of the next mounting, whatever the samples are worth."""
    monkeypatch.setattr(convergence, "LARGEST_R_HAT", 2.0)
    monkeypatch.setattr(convergence, "LEAST_SIZE", 10.0)
    monkeypatch.setattr(convergence, "LEAST_LENGTHS", 1.0)
    names = []
    for mounting, leak in (("a", 34.0), ("b", 40.0), ("c", 47.0)):
        strip = load_actuator("friend-2").replace(**{"circuit.dc_resistivity": leak})
        clean = simulate(strip, "square 1 V 0.1 Hz", duration=10, rate=10)
        noise = 1e-3 * np.random.default_rng(int(leak)).standard_normal(len(clean))
        about = RunMetadata(mounting_id=mounting, starts_from_rest=True)
        run = Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise, metadata=about)
        write_run(run, tmp_path / f"{mounting}.nc")
        names.append(f"{mounting}.nc")
    words = ("--free", "circuit.dc_resistivity", "--out", "posterior.nc", "--force")
    told = command("posterior", "friend-2", *names, *words, "--details")
    assert told.status == 0
    assert "next mounting" in told.out.splitlines()[0]
    assert "average of mountings that differ" in told.out
    assert "mountings-differ" in told.out


def test_chains_that_do_not_agree_write_nothing(
    command, run: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(convergence, "LARGEST_R_HAT", 0.9)
    words = ("--free", "circuit.dc_resistivity", "--steps", "400", "--out", "posterior.nc", "--json")
    done = command("posterior", "friend-2", run, *words)
    assert done.status == 1
    error = done.document["error"]
    assert error["code"] == "posterior-not-converged"
    assert error["message"].startswith(
        "the chains do not agree after 400 steps: R-hat of circuit.dc_resistivity is 1.0"
    )
    assert error["repair"].startswith("give more steps (--steps 4000), state what is known of circuit.dc_resistivity")
    assert not (tmp_path / "posterior.nc").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--out", "posterior.toml"), "must end in .nc"),
        (("--out", "p.nc", "--figure", "pairs.txt"), "must end in .svg or .png or .pdf"),
        (("--out", "p.nc", "--prior", "circuit.dc_resistivity"), "nothing is known beforehand"),
        (("--out", "p.nc", "--steps", "1"), "1 steps are too few"),
        (("--out", "p.nc", "--per-mounting", "circuit.contact_resistance"), "circuit.contact_resistance"),
    ],
)
def test_bad_input_is_refused(command, run: str, words: tuple[str, ...], message: str) -> None:
    done = command("posterior", "friend-2", run, "--free", "circuit.dc_resistivity", *words)
    assert done.status == 2
    assert message in " ".join(done.err.split())
