"""Forecast, profile and bootstrap at the command line say what they say in Python."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import ipmclab


@pytest.fixture
def fitted(tmp_path: Path) -> Path:
    """A strip that was fitted to a noisy step."""
    strip = ipmclab.load_actuator("friend-2")
    clean = ipmclab.simulate(strip, "step 1 V delay=1 s", duration="20 s", rate="25 Hz")
    noise = 1e-4 * np.random.default_rng(20261121).standard_normal(len(clean))
    run = ipmclab.Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise)
    ipmclab.write_run(run, tmp_path / "step.nc")
    fit = ipmclab.identify(strip, run, free="circuit.dc_resistivity,circuit.branches.0.permittivity")
    ipmclab.write_fit(fit, tmp_path / "fitted.toml")
    return tmp_path / "fitted.toml"


def test_profile_and_bootstrap_free_what_the_fit_had_freed(command, fitted: Path) -> None:
    profiled = command("profile", "fitted.toml", "step.nc", "--json").document
    profiles = profiled["profiles"]
    drawn = command("bootstrap", "fitted.toml", "step.nc", "--count", "40", "--json").document
    assert drawn["count"] == 40
    fit = ipmclab.read_fit(fitted)
    for document in (drawn, profiled):  # what an interval is worth, its fit says
        assert "This fit can be used to predict the current" in document["fit"]["summary"]
        assert [one["code"] for one in document["fit"]["findings"]] == [one.code for one in fit.findings]
    for name in ("circuit.dc_resistivity", "circuit.branches.0.permittivity"):
        error = fit.parameters[name].standard_error
        for low, high in (profiles[name]["interval"], drawn["parameters"][name]["interval"]):
            # Of a nearly linear fit the three are one: 3.92 standard errors, 40 draws know them to a fifth.
            assert low < fit.parameters[name].value < high
            assert high - low == pytest.approx(3.92 * error, rel=0.45)
    shown = command("profile", "fitted.toml", "step.nc")
    assert "profile's 95 %" in shown.out
    assert "This fit can be used to predict the current" in shown.out
    (row,) = [line for line in shown.out.splitlines() if line.startswith("circuit.dc_resistivity")]
    for low, high in re.findall(r"(\S+) to (\S+)", row):  # both ends had four digits, which may be the same
        assert float(high) - float(low) == pytest.approx(
            3.92 * fit.parameters["circuit.dc_resistivity"].standard_error, rel=0.1
        )
    few = command("bootstrap", "fitted.toml", "step.nc", "--count", "5")
    assert few.status == 2
    assert "needs 40" in few.err
    bare = command("profile", "friend-2", "step.nc")
    assert bare.status == 2
    assert "nothing is free" in bare.err


@pytest.mark.parametrize("own", ["per_run", "per_mounting"])
def test_profile_asks_of_each_run_and_mounting_what_its_fit_had_asked(command, tmp_path: Path, own: str) -> None:
    """What each had for itself stays its own, also the zero of the current; else the answer is of another question."""
    strip, draws = ipmclab.load_actuator("friend-2"), np.random.default_rng(20261124)
    for place, signal in enumerate(("step 1 V", "sine 1 V 0.5 Hz")):
        clean = ipmclab.simulate(strip, signal, duration=8.0, rate=15.0)
        noisy = clean.current + 1e-4 * draws.standard_normal(len(clean))
        about = ipmclab.RunMetadata(mounting_id=f"m{place}")
        run = ipmclab.Run.from_arrays(time=clean.time, voltage=clean.voltage, current=noisy, metadata=about)
        ipmclab.write_run(run, tmp_path / f"{place}.nc")
    runs = [ipmclab.read_run(tmp_path / f"{place}.nc") for place in (0, 1)]
    free = ["circuit.sheet_resistance", "observation.offset.current"]
    fit = ipmclab.identify(strip, runs, free=free, **{own: "circuit.dc_resistivity"})
    ipmclab.write_fit(fit, tmp_path / "fitted.toml")
    told = command("profile", "fitted.toml", "0.nc", "1.nc", "--json").document["profiles"]
    assert set(told) == set(fit.parameters) - {f"observation.offset.current[{place}]" for place in (0, 1)}
    shown = command("profile", "fitted.toml", "0.nc", "1.nc", "--per-run", "circuit.sheet_resistance")
    assert "circuit.sheet_resistance[1]" in shown.out
    assert "circuit.dc_resistivity " in shown.out


def test_a_delay_of_the_fit_is_found_again_without_being_named(command, tmp_path: Path) -> None:
    """A foreign record has a delay, which nobody can free by name; the fit again finds its own."""
    strip = ipmclab.load_actuator("friend-2")
    clean = ipmclab.simulate(strip, "square 1 V 0.2 Hz", duration=20.0, rate=25.0)
    noisy = clean.current + 1e-4 * np.random.default_rng(20261127).standard_normal(len(clean))
    run = ipmclab.Run.from_arrays(time=clean.time, voltage=clean.voltage, current=noisy, hold="unknown")
    ipmclab.write_run(run, tmp_path / "foreign.nc")
    fit = ipmclab.identify(strip, run, free="circuit.dc_resistivity,circuit.branches.0.permittivity")
    assert "observation.delay[0]" in fit.parameters
    ipmclab.write_fit(fit, tmp_path / "fitted.toml")
    for words in (("profile",), ("bootstrap", "--count", "40")):
        again = command(words[0], "fitted.toml", "foreign.nc", *words[1:], "--json")
        assert again.status == 0, again.err


def test_intervals_of_a_fit_that_is_not_to_be_used_come_with_that_word(command, fitted: Path) -> None:
    thin = ipmclab.load_actuator("friend-2").replace(**{"circuit.sheet_resistance": 3.0})
    ipmclab.write_actuator(thin, fitted.parent / "thin.toml")
    for words in (("profile",), ("bootstrap", "--count", "40")):
        told = command(words[0], "thin.toml", "step.nc", "--free", "circuit.branches.0.permittivity", *words[1:])
        assert told.status == 0, told.err
        assert "Do not use this fit" in told.out
        assert "in series with the branches allow" in told.out.replace("\n", " ").replace("         ", " ")


def test_forecast_is_that_of_python(command, tmp_path: Path) -> None:
    strip = ipmclab.load_actuator("friend-2+relaxation.displacement")
    run = ipmclab.simulate(strip, "step 1 V", duration=40.0, rate=25.0)
    ipmclab.write_run(run, tmp_path / "run.nc")
    name = "friend-2+relaxation.displacement"
    document = command("forecast", name, "run.nc", "--origin", "20 s", "--json").document
    ahead = ipmclab.forecast(strip, run, origin=20.0)
    assert document["mean"]["values"] == pytest.approx(list(ahead.mean))
    assert document["time"]["values"][-1] == pytest.approx(30.0)
    shown = command("forecast", name, "run.nc", "--origin", "20000 ms")
    assert "displacement after 20 s" in shown.out
    for words, told in ((("--origin", "20"), "no unit"), (("--origin", "20 s", "--level", "x"), "between 0 and 1")):
        refused = command("forecast", name, "run.nc", *words)
        assert refused.status == 2
        assert told in refused.err


def test_a_fit_is_validated_as_its_actuator(fitted: Path) -> None:
    fit, run = ipmclab.read_fit(fitted), ipmclab.read_run(fitted.parent / "step.nc")
    one, other = ipmclab.validate(fit, run), ipmclab.validate(fit.actuator, run)
    assert one.as_dict() == other.as_dict()
    assert one.runs[0].used_in_fit


def test_durations_are_read_as_in_files() -> None:
    strip = ipmclab.load_actuator("friend-2")
    one = ipmclab.simulate(strip, "step 1 V", duration="0.5 min", rate="0.05 kHz")
    other = ipmclab.simulate(strip, "step 1 V", duration=30.0, rate=50.0)
    assert one.content_sha256 == other.content_sha256
    for duration in ("30", "30 Hz", "-1 s"):
        with pytest.raises(ipmclab.InputError, match="duration"):
            ipmclab.simulate(strip, "step 1 V", duration=duration, rate=50.0)


def test_the_shell_completes_verbs(tmp_path: Path) -> None:
    asked = {"_IPMCLAB_COMPLETE": "complete_bash", "COMP_WORDS": "ipmclab fore", "COMP_CWORD": "1"}
    called = [sys.executable, "-P", "-m", "ipmclab"]
    done = subprocess.run(called, env=os.environ | asked, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["forecast"]
    # From a shell, which is looked for among the parents of the process; what follows keeps the shell there.
    line = f"{shlex.join([*called, '--show-completion'])}; exit $?"
    shown = subprocess.run(["bash", "-c", line], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "_IPMCLAB_COMPLETE=complete_bash" in shown.stdout
