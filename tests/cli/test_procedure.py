"""``ipmclab procedure`` and ``ipmclab rig sheet`` as their users type them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import InputError, load_actuator, simulate, write_run
from ipmclab.procedure.procedure_file import procedure_from_text
from ipmclab.procedure.template import TEMPLATE
from tests.cli.conftest import Command

MEASURED = """
name = "strip-7"
[geometry]
free_length = "25 mm"
clamped_length = "5 mm"
width = { readings = ["5.01 mm", "4.99 mm", "5.00 mm"], standard_uncertainty = "0.01 mm" }
thickness = "0.245 mm"
sensing_length = "21 mm"
[sheet_resistance]
spacing = "10 mm"
resistance = ["2.667 ohm", "2.666 ohm", "2.668 ohm"]
[density]
mass = "145.7 mg"
"""


def test_the_template_is_a_procedure_and_every_step_in_it_can_be_taken(command: Command, tmp_path: Path) -> None:
    assert command("procedure", "--template", "--out", "mine.toml").status == 0
    assert Path("mine.toml").read_text(encoding="utf-8") == TEMPLATE
    done = command("procedure", "mine.toml", "--json")
    assert done.status == 0
    assert len(done.document["missing"]) == 6
    assert done.document["fit"] is None
    assert "sheet RIG" in done.document["next"]
    # Without the # in front of every line that is no sentence, all six steps are there.
    run = simulate(load_actuator("friend-2"), "step 1 V", duration=4.0, rate=10.0)
    for name in ("step", "sine", "force-step", "force-sine"):
        write_run(run, f"{name}.nc")
    found = procedure_from_text(re.sub(r"^# (\[\w+\]|\w+ = )", r"\1", TEMPLATE, flags=re.MULTILINE))
    assert found.sheet_resistance is not None
    assert found.modulus is not None
    assert found.mass is not None
    assert len(found.coupling) == len(found.branches) == 2
    assert found.contact_resistance.value == 0.05
    assert command("procedure", "--template", "--out", "mine.toml").status == 2  # it is there already
    assert command("procedure", "--template").out == TEMPLATE


def test_steps_are_told_with_what_makes_them_uncertain(command: Command) -> None:
    Path("p.toml").write_text(MEASURED, encoding="utf-8")
    shown = command("procedure", "p.toml")
    assert shown.status == 0
    assert " ± 0.020 ohm/sq" in shown.out
    assert "offset of the meter" in shown.out
    assert "nobody stated how well" in shown.out
    assert "Next: dc resistance from the steady state" in shown.out
    document = command("procedure", "p.toml", "--json").document
    sheet = document["steps"][0]
    assert sheet["results"][0]["value"] == pytest.approx(2.667 * 0.5, rel=1e-6)
    assert sum(sheet["results"][0]["shares"].values()) == pytest.approx(1.0)
    # 0.05 ohm as a limit, 0.1 mm of 10, 0.01 mm of 5; of three readings 4.303 times their standard error is 95 %.
    few = 4.303 / 1.96 / np.sqrt(3.0)
    parts = 0.05 / np.sqrt(3.0) / 2.667, 0.01, 0.01 / 5.0, few * 0.01 / 5.0, few * 0.001 / 2.667
    uncertainty = sheet["results"][0]["standard_uncertainty"] / sheet["results"][0]["value"]
    assert uncertainty == pytest.approx(np.linalg.norm(parts), rel=1e-3)
    assert [step["done"] for step in document["steps"]] == [True, False, False, True, False, False]


def test_an_unfinished_procedure_writes_nothing(command: Command) -> None:
    Path("p.toml").write_text(MEASURED, encoding="utf-8")
    for words in ((), ("--json",)):
        failed = command("procedure", "p.toml", "--out", "fitted.toml", *words)
        assert failed.status == 1
        assert "fitted.toml was not written: dc resistance from the steady state, branches" in failed.err
        assert not Path("fitted.toml").exists()
    assert failed.document["error"]["code"] == "procedure-unfinished"


def test_a_dc_resistance_from_a_run(command: Command) -> None:
    write_run(simulate(load_actuator("friend-2"), "step 1 V", duration=45.0, rate=20.0), "step.nc")
    Path("p.toml").write_text(MEASURED + '[dc_resistance]\nruns = ["step.nc"]\n', encoding="utf-8")
    shown = command("procedure", "p.toml")
    assert shown.status == 0
    assert "not-steady" in shown.out
    assert "read off there, the dc resistance would be" in " ".join(shown.out.split())


def _changed(old: str, new: str) -> str:
    assert old in MEASURED
    return MEASURED.replace(old, new)


@pytest.mark.parametrize(
    ("text", "where", "message"),
    [
        ("name = ", "p.toml", "not a TOML file"),
        (_changed("mass", "mas"), "density.mas", "unknown key 'mas'"),
        (_changed('spacing = "10 mm"', ""), "sheet_resistance.spacing", "this key is missing"),
        (_changed('"10 mm"', '"10"'), "sheet_resistance.spacing", "has no unit"),
        (_changed('"10 mm"', "10"), "sheet_resistance.spacing", "10 is not a length"),
        (_changed('"10 mm"', '"-10 mm"'), "sheet_resistance.spacing", "is not above 0"),
        (_changed('"10 mm"', '"10,0 mm"'), "sheet_resistance.spacing", "has a comma"),
        (_changed("standard_uncertainty", "uncertainty"), "geometry.width.uncertainty", "unknown key"),
        (_changed('"0.01 mm"', '"-0.01 mm"'), "geometry.width.standard_uncertainty", "below 0"),
        (_changed("readings = [", "readings = [], value = ["), "geometry.width", "either a value or readings"),
        (_changed('"21 mm"', '"31 mm"'), "geometry.sensing_length", "beyond the free length"),
        (
            _changed('["2.667 ohm", "2.666 ohm", "2.668 ohm"]', '"0.04 ohm"'),
            "sheet_resistance.resistance",
            "no more than its own offset may be: up to 0.05 ohm",
        ),
        (
            MEASURED + '[circuit]\ncontact_resistance = { value = "0 ohm", standard_uncertainty = "0.1 ohm" }',
            "circuit.contact_resistance",
            "a contact resistance of 0.00 ± 0.10 ohm cannot be",
        ),
        (_changed('"145.7 mg"', "[]"), "density.mass", "0 readings"),
        (MEASURED + '[dc_resistance]\nruns = ["no.nc"]', "dc_resistance.runs[0]", "there is no file 'no.nc'"),
        (MEASURED + "[dc_resistance]\nruns = []", "dc_resistance.runs", "no runs are named"),
        (MEASURED + "[dc_resistance]", "dc_resistance", "either runs or a value"),
        (MEASURED + '[branches]\nruns = ["no.nc"]\ncount = 0', "branches", ""),
        (MEASURED + "[modulus]", "modulus", "one of a push, a run, or a value"),
        (
            MEASURED + '[modulus]\ndisplacement = ["0 mm"]\nforce = ["0 mN", "1 mN"]',
            "modulus",
            "1 displacements and 2 forces",
        ),
        (MEASURED + '[modulus]\ndisplacement = ["0 mm"]', "modulus.force", "this key is missing"),
        (
            MEASURED + '[modulus]\ndisplacement = ["0 mm"]\nforce = ["0 mN"]\ncalibration = 2.0',
            "modulus.calibration",
            "2 is not a part",
        ),
        (
            _changed("[sheet_resistance]", '[sheet_resistance]\ncontacts = "ring"'),
            "sheet_resistance.contacts",
            "'ring'",
        ),
        (
            _changed("[sheet_resistance]", '[sheet_resistance]\ncontacts = "points"'),
            "spacing",
            "four contacts 10 mm apart do not lie on a sheet",
        ),
    ],
)
def test_bad_files(command: Command, text: str, where: str, message: str) -> None:
    # Four points 10 mm apart need 30 mm: of a strip that is a little shorter they hang over.
    Path("p.toml").write_text(text.replace('"25 mm"', '"24.5 mm"'), encoding="utf-8")
    failed = command("procedure", "p.toml", "--json")
    assert failed.status == 2
    error = failed.document["error"]
    assert where in error["where"]
    assert message in error["message"]
    assert error["repair"]
    assert "Traceback" not in failed.err


def test_what_is_no_procedure(command: Command, tmp_path: Path) -> None:
    assert "there is no such file" in command("procedure", "no.toml").err
    assert "this is a folder" in command("procedure", tmp_path).err
    assert "no procedure is given" in command("procedure").err
    assert command("procedure", "no.toml", "--template").status == 2


@given(st.text(max_size=60), st.sampled_from(["geometry", "sheet_resistance", "modulus", "density", "coupling"]))
def test_a_key_that_nobody_knows_is_refused_whatever_it_holds(text: str, table: str) -> None:
    document = f"{MEASURED}\n" if table in MEASURED else f"{MEASURED}\n[{table}]\n"
    with pytest.raises(InputError) as error:
        procedure_from_text(document + "x = " + json.dumps(text))
    assert error.value.repair


def test_the_sheet_resistance_of_a_virtual_strip(command: Command) -> None:
    shown = command("rig", "sheet", "thesis", "--width", "5 mm")
    assert shown.status == 0
    assert "1.333 ± 0.020 ohm/sq" in shown.out
    assert 'spacing = "10 mm"' in shown.out
    document = command(
        "rig", "sheet", "thesis", "--width", "5 mm", "--zero", "0 ohm", "--count", "5", "--json"
    ).document
    assert len(document["readings"]["value"]) == 5
    assert document["sheet_resistance"]["value"] == pytest.approx(4.0 / 3.0, rel=2e-3)
    assert "offset of the meter" not in document["sheet_resistance"]["shares"]
    shorted = command("rig", "sheet", "thesis", "--shorted", "--json").document
    assert shorted["sheet_resistance"] is None
    assert abs(shorted["resistance"]["value"]) < 2e-3
    for words, where in (
        ((), "--width"),
        (("--width", "0 mm"), "--width"),
        (("--width", "5 mm", "--count", "1"), "count"),
    ):
        failed = command("rig", "sheet", "thesis", *words, "--json")
        assert failed.status == 2
        assert where in failed.document["error"]["where"]
