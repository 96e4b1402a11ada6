"""``ipmclab simulate`` of a fitted actuator: how sure it says to be."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from ipmclab import identify, prediction_bands, read_fit, read_run, simulate, write_fit, write_run
from tests.identification.many import FRIEND, noisy

WORDS = ("--signal", "sine 1 V 0.5 Hz", "--duration", "8 s", "--rate", "50 Hz", "--out", "run.nc", "--force")
DC = "circuit.dc_resistivity"


@pytest.fixture
def fitted(tmp_path: Path) -> Path:
    run = noisy(np.random.default_rng(20261121), "step 1 V", mounting="a")
    write_fit(identify(FRIEND, run, free="electrical"), tmp_path / "fitted.toml")
    return tmp_path / "fitted.toml"


def test_the_intervals_are_those_of_prediction_bands(command, fitted: Path) -> None:
    told = command("simulate", fitted.name, *WORDS, "--json").document
    run = read_run("run.nc")
    bands = prediction_bands(
        read_fit(fitted), simulate(read_fit(fitted).actuator, "sine 1 V 0.5 Hz", duration=8, rate=50)
    )
    assert run.current is not None
    peak = int(np.argmax(np.abs(run.current)))
    for key, row in (("peak", peak), ("end", -1)):
        one = told["outputs"]["current"][key]
        for name, of_readings in (("interval", False), ("interval_of_reading", True)):
            ends = [float(end[row]) for end in bands.interval("current", of_readings=of_readings)]
            assert one[name] == pytest.approx(ends, rel=1e-9)
        assert one["interval"][0] < one["value"] < one["interval"][1]
        assert one["interval_next_mounting"] is None
        assert told["outputs"]["force"][key]["interval"] is None
    assert told["fit"] | {"warnings": [], "next_mounting_unknown": ""} == {
        "level": 0.95,
        "why_no_interval": None,
        "mountings": ["a"],
        "left_out": [],
        "not_read": ["displacement", "force"],
        "next_mounting_unknown": "",
        "warnings": [],
    }
    assert "cannot be estimated from one mounting" in told["fit"]["next_mounting_unknown"]

    shown = command("simulate", fitted.name, *WORDS).out
    said = " ".join(shown.split())
    found = re.search(r"^current +\S+ s +(\S+) to (\S+) mA +(\S+) to (\S+) mA$", shown, re.MULTILINE)
    assert found is not None, shown
    ends = told["outputs"]["current"]["peak"]["interval"]
    assert [float(text) for text in found.groups()[:2]] == pytest.approx([1e3 * end for end in ends], rel=1e-4)
    assert "The 95 % intervals hold for mounting a." in said
    assert "There is none of displacement and force: the fit did not read them." in said
    assert "The value at another mounting cannot be estimated from one mounting: it takes three or more" in said


def test_the_next_mounting_has_a_column(command, tmp_path: Path) -> None:
    generator = np.random.default_rng(20261121)
    strips = [(FRIEND.replace(**{DC: value}), name) for value, name in ((38.0, "a"), (42.0, "b"), (47.0, "c"))]
    runs = [noisy(generator, "square 1 V 0.05 Hz", strip=strip, mounting=name) for strip, name in strips]
    write_fit(identify(FRIEND, runs, free=DC), tmp_path / "three.toml")
    said = " ".join(command("simulate", "three.toml", *WORDS).out.split())
    assert "95 % interval at at the next mounting" in said
    assert "of a reading" not in said
    assert "hold for the next mounting alone: mountings a, b and c differ by more than their errors" in said
    one = command("simulate", "three.toml", *WORDS, "--json").document["outputs"]["current"]["end"]
    assert one["interval"] is None
    low, high = one["interval_next_mounting"]
    assert low < one["value"] < high


@pytest.mark.parametrize(
    ("named", "why"),
    [
        ("fitted.toml+leak.cubic", "the fit in fitted.toml is of the actuator without leak.cubic"),
        ("edited.toml", "geometry.width is no longer what it was when its fit was made"),
        ("by-hand.toml", "the [fit] table is not one that identify writes"),
        ("nameless.toml", "the [fit] table is not one that identify writes"),
        ("other-output.toml", "the [fit] table is not one that identify writes"),
    ],
)
def test_no_wrong_number(command, fitted: Path, named: str, why: str) -> None:
    text = fitted.read_text("utf-8")
    Path("edited.toml").write_text(text.replace('width = "5 mm"', 'width = "6 mm"'), "utf-8")
    Path("by-hand.toml").write_text(text.partition("[fit]")[0] + "[fit]\nmine = 1\n", "utf-8")
    Path("nameless.toml").write_text(text.replace('name = "circuit.dc', 'nome = "circuit.dc', 1), "utf-8")
    Path("other-output.toml").write_text(text.replace("[fit.runs.noise]", "[fit.runs.noise]\nnan = 0.0"), "utf-8")
    done = command("simulate", named, *WORDS)
    assert (done.status, done.err) == (0, "")
    assert f"No interval: {why}." in " ".join(done.out.split())
    assert "95 %" not in done.out
    told = command("simulate", named, *WORDS, "--json").document
    assert told["fit"]["why_no_interval"] == why
    assert told["outputs"]["current"]["peak"]["interval"] is None


def test_an_actuator_without_a_fit_is_told_as_before(command) -> None:
    for named in ("friend-2", "friend-2+leak.cubic"):
        told = command("simulate", named, *WORDS, "--json").document
        assert "fit" not in told
        assert set(told["outputs"]["current"]["peak"]) == {"value", "unit", "time"}
        assert "nterval" not in command("simulate", named, *WORDS).out


def test_at_an_environment_the_condition_stands_in_title_document_and_run(command, tmp_path: Path) -> None:
    name = "friend-2+environment.coupling_gain"
    dry = command("simulate", name, *WORDS, "--at", "20 degC, 60 %RH")
    assert "at 20 degC, 60 %RH" in dry.out
    assert "water content as the run begins: 4.159" in dry.out
    peaks = []
    for at in ("20 degC, 80 %RH", "20 degC, 60 %RH", "0 s: 20 degC, 80 %RH; 8 s: 20 degC, 60 %RH", "air.nc"):
        if at == "air.nc":
            write_run(read_run("run.nc"), at)
        document = command("simulate", name, *WORDS, "--at", at, "--json").document
        peaks.append(document["outputs"]["displacement"]["peak"]["value"])
        assert document["environment"]["water_content_origin"] == (
            "computed" if ":" in at or ".nc" in at else "assumed"
        )
        assert document["environment"]["temperature"]["value"] == pytest.approx(20.0)
    assert peaks[1] == pytest.approx(peaks[0] * 4.159 / 7.219, rel=1e-3)
    assert peaks[1] < peaks[2] < peaks[0]
    run = read_run("run.nc")
    assert run.relative_humidity is not None
    assert run.metadata.water_content == pytest.approx(7.219)
    for at, said in (("20 degC", "is not an environment"), ("20 degC, 80 %RH; 5 s: 20 degC, 50 %RH", "has no time")):
        assert said in command("simulate", name, *WORDS, "--at", at).err


def test_what_the_fit_left_open_is_said_with_what_it_gives(command, tmp_path: Path) -> None:
    """Two resistances in series: their sum alone is known."""
    strip = FRIEND
    run = simulate(strip, "step 1 V", duration=10.0, rate=20.0)
    open_ones = ["circuit.sheet_resistance", "circuit.contact_resistance"]
    write_fit(identify(strip, run, free=open_ones), tmp_path / "fitted.toml")
    said = f"the fit does not determine {', '.join(open_ones)}: what depends on them is a guess"
    asked = ("simulate", "fitted.toml", "--signal", "step 1 V", "--duration", "2 s", "--rate", "20 Hz")
    assert said in command(*asked, "--out", "a.nc", "--json").document["warnings"]
    assert said in " ".join(command(*asked, "--out", "b.nc").err.split())
    assert command("export", "fitted.toml", "--to", "matlab", "--out", "script.m", "--json").document["warnings"] == [
        said
    ]
    assert said in " ".join(command("export", "fitted.toml", "--to", "matlab", "--out", "strip.m").err.split())
