"""What ``ipmclab identify`` and ``ipmclab report`` say of how well runs tell parameters apart."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import ipmclab
from ipmclab.cli.identifiable import print_profiles
from ipmclab.fit.fit_file import read_fit
from tests.cli.conftest import Command

SEED = 20261121
SHEET = "circuit.sheet_resistance"


@pytest.fixture
def step(tmp_path: Path) -> Path:
    """A step with 0.1 mA of noise on its current."""
    clean = ipmclab.simulate(ipmclab.load_actuator("friend-2"), "step 1 V", duration=20.0, rate=50.0)
    assert clean.current is not None
    noise = 1e-4 * np.random.default_rng(SEED).standard_normal(len(clean))
    run = ipmclab.Run.from_arrays(time=clean.time, voltage=clean.voltage, current=clean.current + noise, hold="zero")
    ipmclab.write_run(run, tmp_path / "step.nc")
    return tmp_path / "step.nc"


def test_what_current_alone_leaves_open_is_never_a_number(command: Command, step: Path) -> None:
    words = ("identify", "friend-2", step.name, "--free", f"electrical,{SHEET}", "--out", "six.toml")
    outcome = command(*words, "--json")
    assert outcome.status == 0, outcome.err
    document = outcome.document["fit"]
    assert document["rank"] == 5
    assert {one["standard_error"] for one in document["parameters"].values()} == {None}
    assert set(document["collinearity"].values()) == {None}
    assert document["undetermined"][0]["cures"] == [f"measure {SHEET}", "record force", "record displacement"]
    # Behind a series resistance that is too large there is no branch: it is bounded from above, and from there alone.
    assert document["profiles"][SHEET]["is_open"] == [True, False]
    printed = command(*words, "--force", "--details")
    assert printed.status == 0, printed.err
    said = " ".join(printed.out.split())
    assert "measure the sheet resistance (four probes), add a force run" in said
    assert "±" not in said
    rows = {line.split()[0]: line for line in printed.out.splitlines() if line.startswith("circuit.")}
    assert "profile:" not in printed.out
    assert "Every value within the interval of" in said
    # What is in series with the branches moves into the dc resistance and back: R_s = 0 is as far as that goes.
    strip = ipmclab.load_actuator("friend-2")
    ends = [
        ipmclab.simulate(one, "step 1 V", duration=200.0, rate=1.0).current
        for one in (strip, strip.replace(**{SHEET: 1e-6}))
    ]
    assert ends[0] is not None
    assert ends[1] is not None
    dc = document["parameters"]["circuit.dc_resistivity"]
    assert dc["interval"] == pytest.approx(document["profiles"]["circuit.dc_resistivity"]["interval"], rel=0.01)
    assert dc["interval"][1] == pytest.approx(strip["circuit.dc_resistivity"] * ends[1][-1] / ends[0][-1], rel=0.02)
    assert dc["interval"][0] < strip["circuit.dc_resistivity"]
    assert rows["circuit.dc_resistivity"].split("not determined")[1].split()[0].startswith("4")
    assert command("report", "six.toml", "--runs", step.name, "--out", "six.html").status == 0
    page = (step.parent / "six.html").read_text("utf-8")
    assert "Correlation of the estimates" not in page
    assert "any positive value" not in page
    assert "Every value within the interval of" in page


def test_a_profile_is_told_where_it_ends_elsewhere_than_its_interval(capsys: pytest.CaptureFixture[str]) -> None:
    """A tenth of the interval's width is no other end; what is open on a side is told by the other."""
    ends = {
        "circuit.dc_resistivity": ((1.02, 1.98), (False, False)),
        SHEET: ((0.8, 2.0), (False, False)),
        "coupling.p1": ((1.0, 3.0), (True, False)),
        "coupling.gain": ((0.1, 9.0), (True, True)),
    }
    known = SimpleNamespace(determined=True, interval=(1.0, 2.0))
    fit = SimpleNamespace(
        actuator=ipmclab.load_actuator("friend-2"),
        practical=None,
        profiles={name: SimpleNamespace(interval=one, is_open=is_open) for name, (one, is_open) in ends.items()},
        parameters=dict.fromkeys(ends, known),
    )
    print_profiles(fit)  # type: ignore[arg-type]
    said = " ".join(capsys.readouterr().out.split())
    assert said.startswith("The profile of the likelihood ends elsewhere than the 95 % interval: ")
    assert f": {SHEET} 0.8 to 2 ohm/sq; coupling.p1 below 3 " in said
    assert "dc_resistivity" not in said
    assert "gain" not in said


def test_profiles_are_in_the_file_and_in_the_report(command: Command, step: Path) -> None:
    outcome = command("identify", "friend-2", step.name, "--free", "electrical", "--out", "fitted.toml", "--details")
    assert outcome.status == 0, outcome.err
    assert "collinearity" in outcome.out
    fit = read_fit(step.parent / "fitted.toml")
    assert set(fit.profiles) == set(fit.parameters)
    assert fit.practical is not None
    for name, profile in fit.profiles.items():
        low, high = fit.parameters[name].interval
        assert profile.interval == pytest.approx((low, high), rel=0.02)
    assert command("report", "fitted.toml", "--runs", step.name, "--out", "r.html").status == 0
    page = (step.parent / "r.html").read_text("utf-8")
    assert "How well these runs separate the parameters" in page
    assert 'id="profiles-title"' in page


def test_what_could_be_identified_is_asked_without_a_run(command: Command) -> None:
    words = ("identifiability", "friend-2", "--free", f"electrical,{SHEET}")
    shown = command(*words)
    assert "show 5 of 6 combinations" in shown.out
    assert "measure the sheet resistance (four probes)" in shown.out.replace("\n", " ")
    document = command(*words, "--json").document
    (open_one,) = document["undetermined"]
    assert (document["rank"], open_one["cures"]) == (5, [f"measure {SHEET}", "record force", "record displacement"])
    assert command(*words, "--outputs", "current,force", "--json").document["is_complete"]
    for more, told in ((("--outputs", "heat"), "'heat'"), (("--voltage", "0 V"), "above 0"), (("--free", "x"), "'x'")):
        refused = command(*words, *more)
        assert refused.status == 2
        assert told in refused.err
