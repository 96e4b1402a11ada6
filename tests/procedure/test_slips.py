"""A slip of the pen is named where it was made, and what was done before it is shown."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ipmclab import InputError, follow_procedure, load_actuator, read_procedure, simulate, write_run
from ipmclab.cli.app import run
from ipmclab.measurement.uncertain import Uncertain, exact
from ipmclab.measurement.written import Written
from ipmclab.procedure.four_probe import FourProbes, sheet_resistance
from ipmclab.procedure.procedure_file import procedure_from_text
from ipmclab.procedure.step import Step

WIDTH = '{ readings = ["5.01 mm", "4.98 mm", "5.02 mm", "4.99 mm", "5.00 mm"], standard_uncertainty = "0.01 mm" }'
READ = '["2.6683 ohm", "2.6657 ohm", "2.6658 ohm", "2.6667 ohm", "2.6676 ohm"]'
ZERO = '["0.0003 ohm", "-0.0011 ohm", "0.0008 ohm", "0.0002 ohm", "-0.0004 ohm"]'
MASS = '{ value = "145.7 mg", standard_uncertainty = "0.5 mg" }'
FREE = '{ value = "25 mm", standard_uncertainty = "0.2 mm" }'


def text_of(*, width: str = WIDTH, read: str = READ, zero: str = ZERO, mass: str = MASS, free: str = FREE) -> str:
    """The procedure of the docs, as far as it needs no runs."""
    return f"""
name = "strip-7"
[geometry]
free_length = {free}
clamped_length = {{ value = "5 mm", standard_uncertainty = "0.2 mm" }}
width = {width}
thickness = {{ value = "0.245 mm", standard_uncertainty = "0.003 mm" }}
sensing_length = {{ value = "21 mm", standard_uncertainty = "0.2 mm" }}
[sheet_resistance]
spacing = {{ value = "10 mm", standard_uncertainty = "0.05 mm" }}
resistance = {read}
zero = {zero}
[density]
mass = {mass}
"""


def refused(text: str) -> InputError:
    with pytest.raises(InputError) as caught:
        follow_procedure(procedure_from_text(text, where="p.toml"))
    return caught.value


@pytest.mark.parametrize(
    ("text", "where", "source", "reading", "others"),
    [
        (
            text_of(width=WIDTH.replace("5.02 mm", "50.0 mm")),
            "p.toml: geometry.width.readings[2]",
            "scatter of the readings of the width",
            '"50.0 mm", number 3 of 5',
            "4.98 mm to 5.01 mm",
        ),
        (
            text_of(read=READ.replace("2.6683 ohm", "2.6683 kohm")),
            "p.toml: sheet_resistance.resistance[0]",
            "scatter of the readings of the meter",
            '"2.6683 kohm", number 1 of 5',
            "2.6657 ohm to 2.6676 ohm",
        ),
        (
            text_of(zero=ZERO.replace("-0.0004 ohm", "4 ohm")),
            "p.toml: sheet_resistance.zero[4]",
            "scatter of the readings of the zero of the meter",
            '"4 ohm", number 5 of 5',
            "-0.0011 ohm to 0.0008 ohm",
        ),
    ],
)
def test_the_reading_that_lies_apart_is_named(text: str, where: str, source: str, reading: str, others: str) -> None:
    error = refused(text)
    assert (error.code, error.where) == ("no-sheet-resistance", where)
    assert error.repair == "write it again; is its unit right?"
    for words in (source, reading, others):
        assert words in error.message
    assert "offset" not in error.message


@given(
    st.lists(st.floats(4.9, 5.1), min_size=3, max_size=9),
    st.sampled_from([10.0, 100.0, 1000.0]),
    st.data(),
)
def test_whichever_reading_of_the_width_has_a_wrong_digit_or_unit(
    readings: list[float], factor: float, data: st.DataObject
) -> None:
    place = data.draw(st.integers(0, len(readings) - 1))
    texts = [f"{one * (factor if k == place else 1.0):.4f} mm" for k, one in enumerate(readings)]
    error = refused(text_of(width=json.dumps(texts)))
    assert error.where == f"p.toml: geometry.width[{place}]"
    assert f'"{texts[place]}", number {place + 1} of {len(texts)}' in error.message
    assert error.repair == "write it again; is its unit right?"


@given(st.lists(st.floats(4.9, 5.1), min_size=1, max_size=30))
def test_readings_within_a_few_percent_have_none_that_lies_apart(readings: list[float]) -> None:
    """Not even where all others are alike: a meter shows steps."""
    assert Written("width", tuple(f"{one} mm" for one in readings), tuple(readings)).outlier is None


def test_where_no_single_reading_lies_apart_the_source_is_named() -> None:
    error = refused(text_of(width='["5.0 mm", "50 mm", "5.1 mm", "51 mm"]'))
    assert (error.code, error.where) == ("no-sheet-resistance", "p.toml: geometry.width")
    assert "scatter of the readings of the width" in error.message
    assert '"5.0 mm", "50 mm", "5.1 mm", "51 mm"' in error.message


def test_a_stated_uncertainty_that_is_too_large_is_named() -> None:
    error = refused(text_of(width='{ value = "5 mm", standard_uncertainty = "3 mm" }'))
    assert (error.code, error.where) == ("no-sheet-resistance", "p.toml: geometry.width.value")
    assert "100 % of its variance is the width" in error.message


def test_a_meter_that_reads_its_own_offset_is_still_blamed() -> None:
    error = refused(text_of(read='"0.04 ohm"', zero='{ value = "0.03 ohm", standard_uncertainty = "0.01 ohm" }'))
    assert "the meter reads 0.04 ohm, no more than its own offset may be: 0.03 ohm" in error.message


def test_a_reading_of_the_rig_that_lies_apart_is_named() -> None:
    read = Uncertain(
        535.8,
        {"scatter of the readings of the meter": 700.0},
        written={"meter": Written("readings", ("2.7 ohm", "2.6 ohm", "2668 ohm"), (2.7, 2.6, 2668.0))},
    )
    with pytest.raises(InputError, match=r'"2668 ohm", number 3 of 3, lies far from') as caught:
        sheet_resistance(FourProbes("line", read, exact(10e-3)), exact(5e-3), exact(30e-3))
    assert caught.value.where == "readings[2]"


def test_a_slip_among_many_readings_is_told_though_the_mean_can_be(tmp_path: Path) -> None:
    many = json.dumps(["145.7 mg", "145.6 mg"] * 10 + ["1457 mg"])
    step = follow_procedure(procedure_from_text(text_of(mass=many), where="p.toml")).steps[3]
    (finding,) = [one for one in step.findings if one.code == "reading-apart"]
    assert finding.severity == "warning"
    assert 'p.toml: density.mass[20]: "1457 mg", number 21 of 21' in finding.message
    clean = follow_procedure(procedure_from_text(text_of(), where="p.toml"))
    assert not [one for step in clean.steps for one in step.findings if one.severity != "info"]


def test_a_length_that_no_strip_has_is_refused_with_the_reading_that_makes_it_so() -> None:
    error = refused(text_of(free='["25.0 mm", "25.1 m", "24.9 mm"]'))
    assert (error.code, error.where) == ("out-of-range", "p.toml: geometry.free_length[1]")
    assert '"25.1 m", number 2 of 3' in error.message
    error = refused(text_of(free='"25 m"'))
    assert (error.code, error.where) == ("out-of-range", "p.toml: geometry.free_length")
    assert "outside the allowed" in error.message


def test_one_reading_that_makes_a_density_impossible_is_named() -> None:
    found = follow_procedure(procedure_from_text(text_of(mass='["145.7 mg", "145.7 g", "145.6 mg"]'), where="p.toml"))
    ((_, finding),) = found.impossible
    assert '"145.7 g", number 2 of 3, lies far from the others (145.6 mg to 145.7 mg)' in finding.message
    assert finding.repair == "write it again; is its unit right?"


PULLS = '[modulus]\ndisplacement = ["0 mm", "1 mm", "2 mm", "3 mm"]\nforce = ["0 mN", "-1 mN", "-2 mN", "-3 mN"]\n'
"""A strip that does not push back."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("mass", "said"),
    [('"145.7 g"', "3.965e+06"), ('"1.457 g"', "3.965e+04"), ('"0.01 mg"', "0.2721")],
)
def test_an_impossible_density_is_said_at_once_with_the_mass_as_it_was_written(
    mass: str, said: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("p.toml").write_text(text_of(mass=mass), encoding="utf-8")
    for words in ([], ["--out", "fitted.toml"]):
        assert run(["procedure", "p.toml", *words]) == 2
        shown = capsys.readouterr()
        assert "1. sheet resistance by four probes\n" in shown.out
        assert "1.3333" in shown.out or "1.333" in shown.out
        assert "4. density from mass and volume: cannot be" in shown.out
        for stream in (" ".join(shown.out.split()), shown.err):
            assert f"beam.density of {said} kg/m^3 cannot be: an IPMC has 500 to 21450 kg/m^3" in stream
            assert f"mass {mass}" in stream
            for made_of in ('free length "25 mm"', 'clamped length "5 mm"', 'width ["5.01 mm"', 'thickness "0.245 mm"'):
                assert made_of in stream
        assert shown.err.startswith("error: p.toml: density: ")
        assert "Next" not in shown.out
        assert not Path("fitted.toml").exists()


def test_a_program_learns_of_an_impossible_density(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("p.toml").write_text(text_of(mass='"145.7 g"'), encoding="utf-8")
    assert run(["procedure", "p.toml", "--json"]) == 2
    told = capsys.readouterr()
    document = json.loads(told.out)
    assert document["error"]["message"] in told.err
    step = document["steps"][3]
    assert not step["done"]
    assert step["results"] == []
    (finding,) = [one for one in step["findings"] if one["code"] == "impossible-value"]
    assert finding["severity"] == "error"
    assert "density" in document["missing"]
    assert run(["procedure", "p.toml", "--json", "--out", "fitted.toml"]) == 2
    assert json.loads(capsys.readouterr().out)["error"]["code"] == "impossible-value"


def test_a_density_from_elsewhere_that_cannot_be(folder: Path) -> None:
    given = text_of().replace(f"mass = {MASS}", 'value = "4e6 kg/m^3"')
    found = follow_procedure(procedure_from_text(given))
    ((step, finding),) = found.impossible
    assert step.name == "density"
    assert '"4e6 kg/m^3"' in finding.message
    assert "beam.density" not in found.staged


def test_what_no_strip_can_have_goes_no_further(folder: Path) -> None:
    """A push in newtons and micrometres for millinewtons and millimetres; the coupling waits for its modulus."""
    push = '[modulus]\ndisplacement = ["0 um", "1 um", "2 um", "3 um"]\nforce = ["0 N", "9 N", "18 N", "27 N"]\n'
    found = follow_procedure(procedure_from_text(text_of() + push))
    ((step, finding),) = found.impossible
    assert (step.name, step.done) == ("modulus", False)
    assert "beam.modulus" not in found.staged
    assert "beam.modulus" in step.also
    assert step.also["beam.modulus"].amount.value == pytest.approx(4 * 0.021**3 * 9e6 / (5e-3 * 0.245e-3**3))
    assert "1e+13 Pa" in finding.message
    assert "modulus" in found.steps[5].how


def test_the_steps_before_one_that_fails_are_shown(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("p.toml").write_text(text_of() + PULLS, encoding="utf-8")
    assert run(["procedure", "p.toml", "--out", "fitted.toml"]) == 2
    shown = capsys.readouterr()
    assert "1. sheet resistance by four probes" in shown.out
    assert "4. density from mass and volume\n" in shown.out
    assert "a strip pushes back" in shown.err
    assert run(["procedure", "p.toml", "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["error"]["code"] == "out-of-range"


SHORTED = {"read": '"0.04 ohm"', "zero": '{ value = "0.03 ohm", standard_uncertainty = "0.01 ohm" }'}
PUSHED = '[modulus]\ndisplacement = ["0 mm", "1 mm", "2 mm", "3 mm"]\nforce = ["0 mN", "3 mN", "6 mN", "9 mN"]\n'
STEADY = '[dc_resistance]\nvalue = { value = "70.9 ohm", standard_uncertainty = "0.5 ohm" }\n'


def test_what_does_not_need_a_step_that_cannot_be_used_is_carried_out(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The meter reads its own offset: the current needs the sheet resistance, mass and push do not."""
    whole = follow_procedure(procedure_from_text(text_of() + STEADY + PUSHED)).steps
    Path("p.toml").write_text(text_of(**SHORTED) + STEADY + PUSHED, encoding="utf-8")
    told: dict[str, Step] = {}
    with pytest.raises(InputError) as caught:
        follow_procedure(read_procedure("p.toml"), step_done=lambda step: told.update({step.name: step}))
    assert caught.value.code == "no-sheet-resistance"
    first, steady, branches, density, modulus, coupling = (told[step.name] for step in whole)
    (finding,) = first.findings
    assert (first.done, finding.code, finding.severity) == (False, "no-sheet-resistance", "error")
    assert caught.value.message in finding.message
    assert finding.repair == caught.value.repair
    assert "waits for the sheet resistance" in steady.how
    assert "waits for the sheet resistance" in branches.how
    assert (density.results, modulus.results) == (whole[3].results, whole[4].results)
    assert coupling.how == "waits for the sheet resistance, the branches"
    assert run(["procedure", "p.toml"]) == 2
    shown = capsys.readouterr()
    assert "1. sheet resistance by four probes: cannot be used\n" in shown.out
    assert "2. dc resistance from the steady state: waits for the sheet resistance\n" in shown.out
    assert "4. density from mass and volume\n" in shown.out
    assert f"beam.modulus {whole[4].results['beam.modulus'].said}" in " ".join(shown.out.split())
    assert finding.message in " ".join(shown.out.split())
    assert caught.value.message in shown.err
    assert "Next" not in shown.out


def test_every_step_that_cannot_be_used_is_told_and_the_first_is_the_error(folder: Path) -> None:
    told: dict[str, Step] = {}
    text = text_of(**SHORTED) + PULLS
    with pytest.raises(InputError, match="no more than its own offset"):
        follow_procedure(procedure_from_text(text), step_done=lambda step: told.update({step.name: step}))
    unusable = [name for name, step in told.items() if any(one.severity == "error" for one in step.findings)]
    assert unusable == ["sheet_resistance", "modulus"]
    assert told["density"].done
    assert told["coupling"].how == "waits for the sheet resistance, the branches, the modulus"


DISPLACEMENT = ("0 mm", "0.1 mm", "0.2 mm", "0.3 mm", "0.4 mm", "0.3 mm", "0.2 mm", "0.1 mm", "0 mm")
FORCE = ("0.01 mN", "0.28 mN", "0.57 mN", "0.87 mN", "1.15 mN", "0.87 mN", "0.58 mN", "0.28 mN", "0 mN")


def push_of(displacement: tuple[str, ...] = DISPLACEMENT, force: tuple[str, ...] = FORCE) -> str:
    return f"[modulus]\ndisplacement = {json.dumps(displacement)}\nforce = {json.dumps(force)}\ncalibration = 0.01\n"


def test_one_reading_of_a_push_that_hides_the_modulus_is_named() -> None:
    error = refused(text_of() + push_of(force=(*FORCE[:2], "57 mN", *FORCE[3:])))
    assert (error.code, error.where) == ("no-modulus", "p.toml: modulus.force[2]")
    assert error.repair == "write it again; is its unit right?"
    assert "the slope, " in error.message
    assert "is not known" in error.message
    said = '"57 mN" at "0.2 mm", number 3 of 9, is far from the line through the others, which has 0.57'
    assert said in error.message


def test_a_slip_by_which_a_strip_seems_not_to_push_back_is_named() -> None:
    error = refused(text_of() + push_of(force=(*FORCE[:4], "-115 mN", *FORCE[5:])))
    assert error.where == "p.toml: modulus.force[4]"
    assert '"-115 mN" at "0.4 mm", number 5 of 9' in error.message


@pytest.mark.parametrize(
    ("text", "where", "said"),
    [
        (push_of(force=(*FORCE[:2], "0.75 mN", *FORCE[3:])), "force[2]", '"0.75 mN" at "0.2 mm", number 3 of 9'),
        (
            push_of((*DISPLACEMENT[:6], "0.02 mm", *DISPLACEMENT[7:])),
            "force[6]",
            '"0.58 mN" at "0.02 mm", number 7 of 9',
        ),
    ],
)
def test_one_reading_of_a_push_that_lies_apart_is_told_beside_the_modulus(text: str, where: str, said: str) -> None:
    step = follow_procedure(procedure_from_text(text_of() + text, where="p.toml")).steps[4]
    (finding,) = [one for one in step.findings if one.code == "reading-apart"]
    assert finding.severity == "warning"
    assert f"p.toml: modulus.{where}: {said}" in finding.message
    assert step.done
    clean = follow_procedure(procedure_from_text(text_of() + push_of())).steps[4]
    assert not [one for one in clean.findings if one.severity != "info"]


def test_what_was_found_is_shown_before_the_fit_is_written(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that is full at the end takes nothing from the screen."""
    Path("p.toml").write_text(text_of(), encoding="utf-8")
    whole = follow_procedure(read_procedure("p.toml"))

    class Finished:
        steps, missing, compared, impossible = whole.steps, (), (), ()

        class joint:
            class fit:
                findings = ()

            findings = ()

    def full(*_: object, **__: object) -> None:
        raise InputError("no space left", code="not-written", where="fitted.toml", repair="free some")

    monkeypatch.setattr("ipmclab.follow_procedure", lambda *_, **__: Finished, raising=False)
    monkeypatch.setattr("ipmclab.write_fit", full, raising=False)
    assert run(["procedure", "p.toml", "--out", "fitted.toml"]) == 2
    shown = capsys.readouterr()
    assert "1. sheet resistance by four probes" in shown.out
    assert "no space left" in shown.err


def test_each_step_is_told_as_it_is_done(folder: Path) -> None:
    write_run(simulate(load_actuator("friend-2"), "step 1 V", duration=45.0, rate=20.0), "step.nc")
    Path("p.toml").write_text(text_of() + '[dc_resistance]\nruns = ["step.nc"]\n', encoding="utf-8")
    told: list[str] = []
    found = follow_procedure(read_procedure("p.toml"), step_done=lambda step: told.append(step.name))
    assert told[:2] == ["sheet_resistance", "dc_resistance"]
    assert set(told) >= {step.name for step in found.steps if step.done}


@pytest.mark.parametrize(
    ("text", "words", "status", "said"),
    [
        ("name = ", (), 2, "cannot be read"),
        (text_of() + PULLS, (), 2, "a strip that does not push back"),
        (text_of(mass='"145.7 g"'), (), 2, "no strip can have"),
        (text_of(), ("--out", "fitted.toml"), 1, "when there is `--out` and a step is missing"),
        (text_of(), (), 0, "else 0"),
    ],
)
def test_the_manual_names_the_exit_status(
    text: str, words: tuple[str, ...], status: int, said: str, folder: Path
) -> None:
    Path("p.toml").write_text(text, encoding="utf-8")
    assert run(["procedure", "p.toml", *words]) == status
    manual = (Path(__file__).parents[2] / "docs" / "commands.md").read_text(encoding="utf-8")
    section = manual.partition("\n## procedure\n")[2].partition("\n## ")[0]
    found = re.search(r"Exit status (\d) ([^;]*); (\d) ([^;]*); (else \d)", " ".join(section.split()))
    assert found is not None
    told = {int(found[1]): found[2], int(found[3]): found[4], 0: found[5]}
    assert said in told[status]
