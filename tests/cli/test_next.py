"""``ipmclab next`` says what ``propose_runs`` returns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ipmclab


@pytest.fixture
def fitted(tmp_path: Path) -> Path:
    strip = ipmclab.load_actuator("friend-2")
    clean = ipmclab.simulate(strip, "sine 1 V 0.1 Hz", duration="20 s", rate="25 Hz")
    noise = 1e-4 * np.random.default_rng(20261123).standard_normal(len(clean))
    run = ipmclab.Run.from_arrays(time=clean.time, voltage=clean.voltage, hold="zero", current=clean.current + noise)
    ipmclab.write_fit(ipmclab.identify(strip, run, free="electrical"), tmp_path / "fit.toml")
    return tmp_path / "fit.toml"


def test_the_plan_as_tables_and_as_a_document(command, fitted: Path) -> None:
    words = ("next", "fit.toml", "--minutes", "6", "--rate", "25 Hz", "--longest", "20 s")
    document = command(*words, "--json").document
    expected = ipmclab.propose_runs(
        ipmclab.read_fit(fitted), minutes=6.0, allowed=ipmclab.Allowance(rate=25.0, longest=20.0)
    )
    assert [run["signal"] for run in document["runs"]] == [str(run.candidate.signal) for run in expected.runs]
    assert {run["rate"] for run in document["runs"]} == {25.0}
    assert document["bench_time"] == pytest.approx(expected.time)
    shown = command(*words)
    assert shown.status == 0
    for run in expected.runs:
        assert str(run.candidate.signal) in shown.out
    assert shown.out.count("25 Hz  ") == len(expected.runs)
    assert "circuit.branches.0.permittivity" in shown.out


def test_what_is_refused(command, fitted: Path) -> None:
    assert "--limit" in command("next", "fit.toml", "--limit", "voltage").err
    assert "unknown key 'volts'" in command("next", "fit.toml", "--limit", "volts=3 V").err
    assert "the strip" not in command("next", "friend-2").out
    assert command("next", "friend-2").status == 2
