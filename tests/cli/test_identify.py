"""``ipmclab identify``: what it tells of the runs that it was given."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ipmclab
from tests.cli.conftest import Command
from tests.identification.many import FRIEND, mounted, noisy


def test_a_voltage_beyond_what_the_model_holds_for_is_told(command: Command, tmp_path: Path) -> None:
    run = ipmclab.simulate(ipmclab.load_actuator("friend-2"), "step 2 V", duration=10.0, rate=25.0)
    ipmclab.write_run(run, tmp_path / "step.nc")
    outcome = command("identify", "friend-2", "step.nc", "--free", "electrical", "--out", "fitted.toml", "--details")
    assert outcome.status == 0, outcome.err
    said = " ".join(outcome.out.split())
    assert said.count("step.nc: the voltage reaches 2 V, water decomposes above 1.23 V") == 1
    codes = [finding.code for finding in ipmclab.read_fit(tmp_path / "fitted.toml").findings]
    assert codes.count("above-electrolysis") == 1


def test_what_mountings_and_runs_say_of_each_other_is_told(command: Command, tmp_path: Path) -> None:
    generator = np.random.default_rng(20261121)
    names = []
    for number in range(3):
        strip, _ = mounted(generator, 0.1)
        names.append(f"run{number}.nc")
        run = noisy(generator, "square 1 V 0.1 Hz", strip=strip, mounting=f"strip-7-{number}")
        ipmclab.write_run(run, tmp_path / names[-1])
    outcome = command("identify", "friend-2", *names, "--free", "electrical", "--out", "fitted.toml", "--details")
    assert outcome.status == 0, outcome.err
    said = " ".join(outcome.out.split())
    assert "next mounting" in said
    assert "between 3 mountings one standard deviation" in said
    assert "run left out" in said
    assert "warning mountings-differ" in said
    assert len(ipmclab.read_fit(tmp_path / "fitted.toml").left_out) == 3

    outcome = command("identify", "friend-2", *names[:2], "--free", "electrical", "--out", "two.toml", "--json")
    fit = json.loads(outcome.out)["fit"]
    assert all(one["interval_next_mounting"] is None for one in fit["parameters"].values())
    assert "cannot be estimated from two mountings" in fit["next_mounting_unknown"]
    assert fit["mountings"]["between"] == {}
    assert [len(one["fit_percent"]) for one in fit["left_out"]] == [1, 1]

    outcome = command(
        "identify", "friend-2", names[0], "--free", "circuit.dc_resistivity", "--per-mounting",
        "circuit.contact_resistance", "--out", "one.toml", "--details",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    assert "circuit.contact_resistance[mounting strip-7-0]" in outcome.out
    assert "The value at another mounting cannot be estimated from one mounting" in " ".join(outcome.out.split())


def test_the_share_of_readings_in_the_band_is_told(command: Command, tmp_path: Path) -> None:
    generator = np.random.default_rng(20261121)
    ipmclab.write_fit(ipmclab.identify(FRIEND, noisy(generator, "step 1 V")), tmp_path / "fitted.toml")
    ipmclab.write_run(noisy(generator, "sine 1 V 0.2 Hz"), tmp_path / "sine.nc")
    outcome = command("validate", "fitted.toml", "sine.nc", "--also", "friend-2")
    assert "in 95 % band" in outcome.out
    assert "in 95 % band" not in command("validate", "friend-2", "sine.nc").out
    told = json.loads(command("validate", "fitted.toml", "sine.nc", "--json").out)["validations"][0]
    assert 0.92 < told["scores"]["current"]["inside_band"] < 0.98


def test_what_is_left_stands_beside_the_residuals(command: Command, tmp_path: Path) -> None:
    run = ipmclab.simulate(ipmclab.load_actuator("friend-2"), "step 1 V", duration=10.0, rate=25.0)
    assert run.current is not None
    noise = 1e-4 * np.random.default_rng(20261121).standard_normal(len(run))
    read = ipmclab.Run.from_arrays(time=run.time, voltage=run.voltage, current=run.current + noise)
    ipmclab.write_run(read, tmp_path / "step.nc")
    words = ("identify", "friend-2", "step.nc", "--free", "electrical", "--out", "fitted.toml", "--force", "--details")
    outcome = command(*words)
    assert "what is left" in outcome.out
    assert "white noise" in outcome.out
    (one,) = command(*words, "--json").document["fit"]["diagnoses"]
    assert (one["output"], one["verdict"]) == ("current", "white")
    assert len(one["lags"]) == len(one["with_voltage"]) == len(one["autocorrelation"]) > 10


def test_each_strip_of_many_runs_has_a_fit_of_its_own(command: Command, tmp_path: Path) -> None:
    clean = ipmclab.simulate(ipmclab.load_actuator("friend-2"), "step 1 V", duration=10.0, rate=10.0)
    for seed, strip in enumerate(("7", "8", "7")):
        noise = 1e-4 * np.random.default_rng(seed).standard_normal(len(clean))
        run = ipmclab.Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise)
        metadata = replace(run.metadata, sample=ipmclab.Sample(strip))
        ipmclab.write_run(replace(run, metadata=metadata), tmp_path / f"{seed}.nc")
    words = ("identify", "friend-2", "0.nc", "1.nc", "2.nc", "--free", "circuit.dc_resistivity", "--out", "fits")
    told = command(*words, "--each-strip", "--workers", "2")
    assert told.status == 0, told.err
    assert "wrote fits/8.toml" in told.out.replace("\\", "/")
    assert [len(ipmclab.read_fit(tmp_path / "fits" / f"{name}.toml").observations) for name in ("7", "8")] == [2, 1]
    assert "exists" in command(*words, "--each-strip").err
    alone = command(*words, "--each-strip", "--force", "--json").document["fits"]["8"]["parameters"]
    assert alone["circuit.dc_resistivity"]["determined"]
    refused = command(*words, "--workers", "2")
    assert (refused.status, "add --each-strip" in refused.err) == (2, True)
    ipmclab.write_run(clean, tmp_path / "3.nc")
    assert "does not say which strip" in command(*words[:3], "3.nc", *words[5:], "--each-strip").err


def strip_runs(folder: Path, strips: tuple[str, ...], volts: float = 1.0) -> list[str]:
    """Steps, one of each strip, without noise; their files."""
    clean = ipmclab.simulate(ipmclab.load_actuator("friend-2"), "step 1 V", duration=2.0, rate=10.0)
    for place, strip in enumerate(strips):
        about = ipmclab.RunMetadata(sample=ipmclab.Sample(strip))
        run = ipmclab.Run.from_arrays(
            time=clean.time, voltage=volts * clean.voltage, current=clean.current, metadata=about
        )
        ipmclab.write_run(run, folder / f"{place}.nc", overwrite=True)
    return [f"{place}.nc" for place in range(len(strips))]


@pytest.mark.parametrize(
    ("strips", "told"), [(("A", "a"), "'A' and 'a' would have one file"), (("1", "Com1"), "cannot be the name")]
)
def test_a_strip_whose_file_another_system_cannot_keep_is_refused(command, tmp_path: Path, strips, told: str) -> None:
    """Where capitals do not count, the fit of one strip would take the place of the other's."""
    runs = strip_runs(tmp_path, strips)
    refused = command("identify", "friend-2", *runs, "--each-strip", "--out", "fits")
    assert (refused.status, told in refused.err) == (2, True)
    assert not (tmp_path / "fits").exists()


def test_strips_that_cannot_be_fitted_leave_one_document(command, tmp_path: Path) -> None:
    runs = strip_runs(tmp_path, ("1", "2"), volts=0.0)
    words = ("identify", "friend-2", *runs, "--each-strip", "--out", "fits")
    failed = command(*words, "--json")
    assert failed.status == 1
    assert set(failed.document["failed"]) == {"1", "2"}
    assert "2 of 2 strips could not be fitted" in failed.err
    assert command(*words).err.count("error:") == 1
